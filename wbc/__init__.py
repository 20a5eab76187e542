"""Whole-body control of humanoid robots, with the robot's inertia as a task like any other."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # "as" tells type checkers that a name is public
    from wbc import gait as gait
    from wbc import simulation as simulation
    from wbc import view as view
    from wbc.constraints import *
    from wbc.controllers import *
    from wbc.errors import WbcError as WbcError
    from wbc.laws import AccelerationLaw as AccelerationLaw
    from wbc.laws import VelocityLaw as VelocityLaw
    from wbc.motion import Motion as Motion
    from wbc.motion import RmpSeries as RmpSeries
    from wbc.motion import analyze as analyze
    from wbc.motion import read_motion as read_motion
    from wbc.problem import load_problem as load_problem
    from wbc.reduction import RmpState as RmpState
    from wbc.reduction import reduce as reduce
    from wbc.retargeting import Retargeted as Retargeted
    from wbc.retargeting import RetargetWeights as RetargetWeights
    from wbc.retargeting import retarget as retarget
    from wbc.robot import Robot as Robot
    from wbc.robot import Snapshot as Snapshot
    from wbc.robot import robot_names as robot_names
    from wbc.robot.collision import Obstacle as Obstacle
    from wbc.tasks import *
    from wbc.tracking.pendulum import pendulum_of as pendulum_of
    from wbc.tracking.plan_check import PlanMismatchError as PlanMismatchError
    from wbc.tracking.reference import PlanReference as PlanReference

__version__ = "0.2.0"

# Rooms of which every public name is wbc's too: a task is exported by its room, and nowhere else.
# Loaded when first used, so that the command line can print its help without loading Pinocchio.
_ROOMS = ("wbc.tasks", "wbc.constraints", "wbc.controllers")
_PACKAGES = ("gait", "simulation", "view")  # by their own names, as in wbc.view.Viewer
_NAMES = {
    "AccelerationLaw": "wbc.laws",
    "Motion": "wbc.motion",
    "Obstacle": "wbc.robot.collision",
    "PlanMismatchError": "wbc.tracking.plan_check",
    "PlanReference": "wbc.tracking.reference",
    "RmpSeries": "wbc.motion",
    "RmpState": "wbc.reduction",
    "RetargetWeights": "wbc.retargeting",
    "Retargeted": "wbc.retargeting",
    "Robot": "wbc.robot",
    "Snapshot": "wbc.robot",
    "VelocityLaw": "wbc.laws",
    "WbcError": "wbc.errors",
    "analyse": "wbc.motion",  # the name of analyze until 0.2
    "analyze": "wbc.motion",
    "load_problem": "wbc.problem",
    "pendulum_of": "wbc.tracking.pendulum",
    "read_motion": "wbc.motion",
    "reduce": "wbc.reduction",
    "retarget": "wbc.retargeting",
    "robot_names": "wbc.robot",
}


if not TYPE_CHECKING:  # to a checker, a module with this function has every name

    def __getattr__(name: str) -> Any:
        if name == "__all__":
            return __dir__()
        if name in _PACKAGES:
            return import_module(f"wbc.{name}")
        rooms = [_NAMES[name]] if name in _NAMES else [] if name.startswith("_") else _ROOMS
        for module in map(import_module, rooms):
            if name in _NAMES or name in module.__all__:
                return globals().setdefault(name, getattr(module, name))  # not asked again
        raise import_module("wbc.errors").no_attribute("module 'wbc'", name, __dir__())


def __dir__() -> list[str]:
    rooms = (import_module(room).__all__ for room in _ROOMS)
    names = {"__version__", *_NAMES, *_PACKAGES} - {"analyse"}
    return sorted(names | {name for each in rooms for name in each})
