"""Whole-body control of humanoid robots, with the robot's inertia as a task like any other."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from wbc import gait, simulation, view
    from wbc.constraints import *
    from wbc.controllers import *
    from wbc.errors import WbcError
    from wbc.laws import AccelerationLaw, VelocityLaw
    from wbc.motion import Motion, RmpSeries, analyse, read_motion
    from wbc.problem import load_problem
    from wbc.reduction import RmpState, reduce
    from wbc.robot import Robot, Snapshot, robot_names
    from wbc.robot.collision import Obstacle
    from wbc.tasks import *
    from wbc.tracking.fit import PlanMismatchError
    from wbc.tracking.pendulum import pendulum_of
    from wbc.tracking.reference import PlanReference

__version__ = "0.1.0"

# Rooms of which every public name is wbc's too: a task is exported by its room, and nowhere else.
# Loaded when first used, so that the command line can print its help without loading Pinocchio.
_ROOMS = ("wbc.tasks", "wbc.constraints", "wbc.controllers")
_PACKAGES = ("gait", "simulation", "view")  # by their own names, as in wbc.view.Viewer
_NAMES = {
    "AccelerationLaw": "wbc.laws",
    "Motion": "wbc.motion",
    "Obstacle": "wbc.robot.collision",
    "PlanMismatchError": "wbc.tracking.fit",
    "PlanReference": "wbc.tracking.reference",
    "RmpSeries": "wbc.motion",
    "RmpState": "wbc.reduction",
    "Robot": "wbc.robot",
    "Snapshot": "wbc.robot",
    "VelocityLaw": "wbc.laws",
    "WbcError": "wbc.errors",
    "analyse": "wbc.motion",
    "load_problem": "wbc.problem",
    "pendulum_of": "wbc.tracking.pendulum",
    "read_motion": "wbc.motion",
    "reduce": "wbc.reduction",
    "robot_names": "wbc.robot",
}


def __getattr__(name: str) -> Any:
    if name == "__all__":
        return __dir__()
    if name in _NAMES:
        return getattr(import_module(_NAMES[name]), name)
    if name in _PACKAGES:
        return import_module(f"wbc.{name}")
    for room in _ROOMS if not name.startswith("_") else ():
        module = import_module(room)
        if name in module.__all__:
            return getattr(module, name)
    hint = ""
    if not name.startswith("_"):
        hint = import_module("wbc.errors").suggest(name, __dir__(), listed=0)
    raise AttributeError(f"module 'wbc' has no attribute {name!r}{hint}")


def __dir__() -> list[str]:
    rooms = (import_module(room).__all__ for room in _ROOMS)
    names = {"__version__", *_NAMES, *_PACKAGES}
    return sorted(names | {name for each in rooms for name in each})
