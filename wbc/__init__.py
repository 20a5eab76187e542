"""Whole-body control of humanoid robots, with the robot's inertia as a task like any other."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wbc.constraints import (
        ComSupport,
        Contact,
        Limits,
        Obstacles,
        PointContact,
        PositionBox,
        SelfCollision,
        support,
    )
    from wbc.controllers import Controller, KinematicController, Tick
    from wbc.errors import WbcError
    from wbc.motion import Motion, RmpSeries, analyse, read_motion
    from wbc.problem import load_problem
    from wbc.reduction import RmpState, reduce
    from wbc.robot import Robot, Snapshot, robot_names
    from wbc.tasks import (
        AxisTask,
        ComTask,
        InertiaTask,
        MomentumTask,
        OrientationTask,
        PoseTask,
        PositionTask,
        PostureTask,
        PrincipalInertiaTask,
        Task,
    )

__version__ = "0.1.0"

# Public names and where they live. Loaded when first used, so that the command line can print its
# help without loading Pinocchio.
_HOMES = {
    "AxisTask": "wbc.tasks",
    "ComSupport": "wbc.constraints",
    "ComTask": "wbc.tasks",
    "Controller": "wbc.controllers",
    "Contact": "wbc.constraints",
    "InertiaTask": "wbc.tasks",
    "KinematicController": "wbc.controllers",
    "Limits": "wbc.constraints",
    "MomentumTask": "wbc.tasks",
    "Motion": "wbc.motion",
    "Obstacles": "wbc.constraints",
    "OrientationTask": "wbc.tasks",
    "PointContact": "wbc.constraints",
    "PoseTask": "wbc.tasks",
    "PositionBox": "wbc.constraints",
    "PositionTask": "wbc.tasks",
    "PostureTask": "wbc.tasks",
    "PrincipalInertiaTask": "wbc.tasks",
    "RmpSeries": "wbc.motion",
    "RmpState": "wbc.reduction",
    "Robot": "wbc.robot",
    "SelfCollision": "wbc.constraints",
    "Snapshot": "wbc.robot",
    "Task": "wbc.tasks",
    "Tick": "wbc.controllers",
    "WbcError": "wbc.errors",
    "analyse": "wbc.motion",
    "load_problem": "wbc.problem",
    "read_motion": "wbc.motion",
    "reduce": "wbc.reduction",
    "robot_names": "wbc.robot",
    "support": "wbc.constraints",
}

__all__ = [
    "AxisTask",
    "ComSupport",
    "ComTask",
    "Contact",
    "Controller",
    "InertiaTask",
    "KinematicController",
    "Limits",
    "MomentumTask",
    "Motion",
    "Obstacles",
    "OrientationTask",
    "PointContact",
    "PoseTask",
    "PositionBox",
    "PositionTask",
    "PostureTask",
    "PrincipalInertiaTask",
    "RmpSeries",
    "RmpState",
    "Robot",
    "SelfCollision",
    "Snapshot",
    "Task",
    "Tick",
    "WbcError",
    "analyse",
    "load_problem",
    "read_motion",
    "reduce",
    "robot_names",
    "support",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'wbc' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
