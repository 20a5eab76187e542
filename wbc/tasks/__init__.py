"""Tasks: what the robot should do, each as an error and its derivatives."""

from wbc.tasks.com import ComTask
from wbc.tasks.frame import AxisTask, OrientationTask, PoseTask, PositionTask
from wbc.tasks.inertia import InertiaTask
from wbc.tasks.momentum import MomentumTask
from wbc.tasks.posture import PostureTask
from wbc.tasks.principal_inertia import PrincipalInertiaTask
from wbc.tasks.task import Residual, Task

__all__ = [
    "AxisTask",
    "ComTask",
    "InertiaTask",
    "MomentumTask",
    "OrientationTask",
    "PoseTask",
    "PositionTask",
    "PostureTask",
    "PrincipalInertiaTask",
    "Residual",
    "Task",
]
