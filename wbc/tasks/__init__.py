"""Tasks: what the robot should do, each as an error and its derivatives."""

from wbc.laws import Residual
from wbc.tasks.axis import AxisTask
from wbc.tasks.contact_force import ContactForceTask, ForceRateTask, LoadShareTask
from wbc.tasks.cop import CopTask
from wbc.tasks.damping import DampingTask
from wbc.tasks.distance import DistanceTask
from wbc.tasks.force_task import Affine, Dynamics, ForceTask
from wbc.tasks.frame import OrientationTask, PoseTask
from wbc.tasks.inertia import InertiaTask
from wbc.tasks.keywords import Gains
from wbc.tasks.momentum import MomentumTask
from wbc.tasks.point import ComTask, PositionTask
from wbc.tasks.posture import PostureTask
from wbc.tasks.principal_inertia import PrincipalInertiaTask
from wbc.tasks.relative_pose import RelativePoseTask
from wbc.tasks.task import Task
from wbc.tasks.torque import TorqueTask

__all__ = [
    "Affine",
    "AxisTask",
    "ComTask",
    "ContactForceTask",
    "CopTask",
    "DampingTask",
    "DistanceTask",
    "Dynamics",
    "ForceRateTask",
    "ForceTask",
    "Gains",
    "InertiaTask",
    "LoadShareTask",
    "MomentumTask",
    "OrientationTask",
    "PoseTask",
    "PositionTask",
    "PostureTask",
    "PrincipalInertiaTask",
    "RelativePoseTask",
    "Residual",
    "Task",
    "TorqueTask",
]
