"""Episodes of the golden file: a controller's parts as plain data, and their construction.

An episode is a dictionary of numbers and words, so that a file holds all of it and no later code
can understand another target than the one that was recorded:

    robot, level, category
    tasks        [{kind, arguments, motion}]: a class of wbc and its keywords; what set_target gets
    contacts     [{tick, held: [{kind, frame, position, rotation, friction}]}]: from which tick on
    limits       keywords of wbc.Limits, or None
    constraints  [{kind, arguments}]
    options      keywords of the controller
"""

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

import numpy as np
from golden_optimum import exact_answer

import wbc
from wbc.errors import UnknownNameError
from wbc.validate import Array

Episode = Mapping[str, Any]
LEVELS = {"velocity": wbc.KinematicController, "torque": wbc.TorqueController}
# The exact method's names, new and old: the first that a code knows is taken.
_EXACT = ("active_set", "daqp")
SUCCESSORS = dict.fromkeys(_EXACT, _EXACT)


class HeightTask(wbc.Task):
    """A user's own task, in Python: the origin of a frame at a height."""

    def __init__(self, robot: wbc.Robot, frame: str, height: float, **law: Any) -> None:
        super().__init__(robot, f"{frame} height", ("z",), **law)
        self.frame, self.height = frame, height

    def residual(self, snapshot: wbc.Snapshot) -> wbc.Residual:
        error = snapshot.position(self.frame)[2:] - self.height
        return wbc.Residual(error, snapshot.jacobian(self.frame)[2:3], np.zeros(1))

    def drift(self, snapshot: wbc.Snapshot) -> Array:
        return snapshot.drift(self.frame)[2:3]


class LevelBase(wbc.Constraint):
    """A user's own constraint, in Python: the base turns about its x and y axes no faster."""

    def __init__(self, robot: wbc.Robot, rate: float) -> None:
        self.robot, self.name, self.rate = robot, "level base", rate

    def rows(self, snapshot: wbc.Snapshot, dt: float) -> wbc.Bounds:
        matrix = np.zeros((2, self.robot.nv))
        matrix[0, 3] = matrix[1, 4] = 1.0
        bound = np.full(2, self.rate)
        return wbc.Bounds(("base roll rate", "base pitch rate"), matrix, -bound, bound)


OWN = {"HeightTask": HeightTask, "LevelBase": LevelBase}


class Replay:
    """The controller of an episode, and its contacts by tick."""

    def __init__(self, robot: wbc.Robot, episode: Episode, solver: str | None = None) -> None:
        given, level = episode["limits"], episode["level"]
        limits = None if given is None else wbc.Limits(robot, **given)
        options = dict(episode["options"])
        options.pop("formulation", None)  # of older files: it made no difference
        options["solver"] = solver_known(solver or options["solver"])
        self.robot = robot
        self._contacts = {
            at["tick"]: [contact_of(robot, one) for one in at["held"]] for at in episode["contacts"]
        }
        self.controller = LEVELS[level](
            robot,
            [task_of(robot, one) for one in episode["tasks"]],
            contacts=self._contacts[0],
            limits=limits,
            constraints=[constraint_of(robot, one) for one in episode["constraints"]],
            **options,
        )

    def step(self, tick: int, q: Array, v: Array) -> wbc.Tick:
        """Return the answer at a state, after all earlier ticks were made."""
        if tick and tick in self._contacts:
            self.controller.set_contacts(self._contacts[tick])
        return self.controller.step(self.robot.snapshot(q, v))


def task_of(robot: wbc.Robot, one: Mapping[str, Any]) -> wbc.Task:
    """Return a task from its description."""
    task = _class(one["kind"])(robot, **one["arguments"])
    if one.get("motion"):
        task.set_target(**one["motion"])
    return task


def contact_of(robot: wbc.Robot, one: Mapping[str, Any]) -> wbc.Contact:
    """Return a contact from its description."""
    friction = one["friction"]
    cone = None if friction is None else wbc.FrictionCone(**friction)
    place = one["position"], one["rotation"]
    return _class(one["kind"])(robot, one["frame"], *place, friction=cone)


def constraint_of(robot: wbc.Robot, one: Mapping[str, Any]) -> wbc.Constraint:
    """Return a constraint from its description."""
    if one["kind"] == "SelfCollision":
        return self_collision(robot)
    return _class(one["kind"])(robot, **one["arguments"])


@cache
def self_collision(robot: wbc.Robot) -> wbc.SelfCollision:
    """Return the margins between a robot's bodies, cached: building them takes seconds."""
    return wbc.SelfCollision(robot, limits=wbc.Limits(robot))


@cache
def solver_known(name: str) -> str:
    """Return this code's name of a solver."""
    for known in SUCCESSORS.get(name, (name,)):
        try:
            wbc.KinematicController(_ANY, [wbc.DampingTask(_ANY)], contacts=(), solver=known)
        except UnknownNameError:
            continue
        return known
    raise SystemExit(f"solver {name!r}: this code knows none of {SUCCESSORS.get(name, (name,))}")


def replayed(replay: Replay, states: Iterator[tuple[Array, Array]]) -> Iterator[dict[str, Any]]:
    """Yield a controller's answers at given states; an exception is an answer, too."""
    for k, (q, v) in enumerate(states):
        try:
            tick = replay.step(k, q, v)
            yield answer_of(tick, exact_answer(replay.controller, q, v, tick))
        except Exception as error:  # its name is compared as a status is
            yield {"status": f"raised {type(error).__name__}", "policy": "", "step_scale": 1.0}


def answer_of(tick: wbc.Tick, optimum: Mapping[str, Array] | None) -> dict[str, Any]:
    """Return the fields of a tick that the file keeps."""
    found = {
        "velocity": tick.velocity,
        "status": str(tick.status.value),
        "policy": tick.policy or "",
        "step_scale": float(tick.step_scale),
    }
    if isinstance(tick, wbc.TorqueTick):
        found["torque"] = tick.torque
    if optimum is not None:
        found |= {f"exact_{name}": value for name, value in optimum.items()}
    return found


def _class(kind: str) -> Any:
    return OWN.get(kind) or getattr(wbc, kind)


_ANY = wbc.Robot.load("hoap2_like")
