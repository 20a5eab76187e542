"""From a validated description to robot, tasks, contacts, limits and controller.

Every name and number is checked here, before anything moves; see :mod:`wbc.problem.mistakes`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from wbc.constraints import Contact, Limits, PointContact, support
from wbc.controllers import KinematicController, PseudoInverseController, Tick
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.problem.build_tasks import BuiltTask, build_task
from wbc.problem.controller_specs import PseudoInverseSpec, QpSpec
from wbc.problem.mistakes import Misplaced, Mistakes
from wbc.problem.part_specs import ContactSpec, LimitsSpec, RobotSpec, StartSpec, Support
from wbc.problem.ramps import MovingTarget
from wbc.problem.source import Source
from wbc.problem.spec import ProblemSpec
from wbc.problem.task_specs import ComSpec, InertiaSpec, PositionSpec
from wbc.qp.backend import Backend, make_backend
from wbc.robot import FootSpec, Robot, Snapshot
from wbc.tasks import Task
from wbc.validate import Array

MAX_TICKS = 1_000_000


class Controller(Protocol):
    """From a snapshot to a command."""

    def step(self, snapshot: Snapshot) -> Tick:
        """Return the command for ``snapshot``."""
        ...


@dataclass(frozen=True, eq=False)
class Parts:
    """What a problem is made of, at its start.

    Attributes
    ----------
    start:
        Configuration (nq,).
    """

    robot: Robot
    start: Array
    tasks: tuple[Task, ...]
    moving: tuple[MovingTarget, ...]
    contacts: tuple[Contact, ...]
    limits: Limits | None

    def controller(self, spec: QpSpec | PseudoInverseSpec) -> Controller:
        """Return a new controller, which remembers nothing of earlier runs."""
        common: dict[str, Any] = {
            "contacts": self.contacts,
            "limits": self.limits,
            "dt": spec.dt,
            "damping": spec.damping,
        }
        if isinstance(spec, PseudoInverseSpec):
            return PseudoInverseController(self.robot, self.tasks, **common)
        return KinematicController(
            self.robot,
            self.tasks,
            solver=_backend(spec),
            formulation=spec.formulation,
            on_failure=spec.on_failure,
            **common,
        )


def build(spec: ProblemSpec, source: Source, folder: Path) -> Parts:
    """Return the parts of a problem; relative paths start from ``folder``.

    Raises
    ------
    ProblemFileError
        With every mistake found, each with its line and key path.
    """
    mistakes = Mistakes(source)
    robot = mistakes.require(("robot",), partial(_robot, spec.robot, folder))
    _check_start(spec.start, robot, mistakes)
    mistakes.raise_any()
    q = robot.posture(spec.start.posture, spec.start.joints)
    start = robot.snapshot(q, np.zeros(robot.nv))
    tasks = list[BuiltTask]()
    for name, task_spec in spec.tasks.items():
        with mistakes.at("tasks", name):
            tasks.append(build_task(name, task_spec, start))
    contacts = list[Contact]()
    with mistakes.at("support"):
        contacts += _contacts(spec.support, start)
    if isinstance(spec.controller, QpSpec):
        with mistakes.at("controller"):
            _backend(spec.controller)
    _check_stop(spec, mistakes)
    limits = mistakes.require(("limits",), partial(_limits, spec.limits, robot))
    parts = Parts(
        robot=robot,
        start=start.q,
        tasks=tuple(built.task for built in tasks),
        moving=tuple(built.moving for built in tasks if built.moving is not None),
        contacts=tuple(contacts),
        limits=limits,
    )
    mistakes.require(("controller",), partial(parts.controller, spec.controller))
    return parts


def _robot(choice: str | RobotSpec, folder: Path) -> Robot:
    spec = RobotSpec(model=choice) if isinstance(choice, str) else choice
    feet = None
    if spec.feet is not None:
        feet = {name: FootSpec(**foot.model_dump()) for name, foot in spec.feet.items()}
    return Robot.load(
        _located(spec.model, folder),
        locked=spec.locked,
        feet=feet,
        srdf=None if spec.srdf is None else folder / Path(spec.srdf).expanduser(),
        package_dirs=[folder / Path(name).expanduser() for name in spec.package_dirs or ()],
    )


def _located(model: str, folder: Path) -> str | Path:
    """Return a name as it is, and a file (it has a folder or an ending) relative to ``folder``."""
    path = Path(model).expanduser()
    return folder / path if "/" in model or path.suffix else model


def _check_start(spec: StartSpec, robot: Robot, mistakes: Mistakes) -> None:
    with mistakes.at("start", "posture"):
        robot.posture(spec.posture)
    for pattern, value in spec.joints.items():  # one by one, so that each mistake has its line
        with mistakes.at("start", "joints", pattern):
            robot.posture(joints={pattern: value})


def _contacts(spec: Support, start: Snapshot) -> tuple[Contact, ...]:
    if isinstance(spec, str):
        return support(start, spec)
    wanted = [ContactSpec(frame=one) if isinstance(one, str) else one for one in spec]
    frames = [one.frame for one in wanted]
    for k, frame in enumerate(frames):
        if frame in frames[:k]:
            raise Misplaced(f"frame {frame!r} is named twice", k)
    kinds = {"fixed": Contact, "point": PointContact}
    return tuple(kinds[one.type].hold(start, one.frame, gain=one.gain) for one in wanted)


def _limits(spec: str | LimitsSpec, robot: Robot) -> Limits | None:
    if isinstance(spec, str):
        return None
    values = spec.model_dump(exclude={"acceleration"})
    if isinstance(spec.acceleration, float | int | None):
        return Limits(robot, acceleration=spec.acceleration, **values)
    acceleration = Limits(robot, **values).acceleration.copy()
    for pattern, value in spec.acceleration.items():
        acceleration[np.array(robot.joint_indices(pattern)) - 6] = value
    return Limits(robot, acceleration=acceleration, **values)


def _backend(spec: QpSpec) -> Backend:
    settings = {} if spec.eps is None else {"eps": spec.eps}
    return make_backend(spec.solver, **settings)


def _check_stop(spec: ProblemSpec, mistakes: Mistakes) -> None:
    for name in spec.stop.accept:
        with mistakes.at("stop", "accept", name):
            if name not in spec.tasks:
                raise UnknownNameError("task", name, spec.tasks)
    ticks = spec.stop.duration / spec.controller.dt
    with mistakes.at("stop"):
        if ticks > MAX_TICKS:
            raise Misplaced(
                f"{spec.stop.duration:g} s at a time step of {spec.controller.dt:g} s are "
                f"{ticks:.3g} ticks; at most {MAX_TICKS:,} are possible",
                "duration",
            )
    for name, task in spec.tasks.items():
        ramp = task.ramp if isinstance(task, InertiaSpec | ComSpec | PositionSpec) else None
        with mistakes.at("tasks", name, "ramp"):
            if ramp is not None and ramp > spec.stop.duration:
                raise InvalidInputError(
                    f"{ramp:g} s is longer than the run (stop.duration, {spec.stop.duration:g} s)"
                )
