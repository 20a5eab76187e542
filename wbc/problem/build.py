"""From a validated description to robot, tasks, contacts, limits and controller.

Every name and number is checked here, before anything moves; see :mod:`wbc.problem.mistakes`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from wbc.constraints import Contact, Limits
from wbc.controllers import KinematicController, PseudoInverseController, Tick
from wbc.controllers.joint_weights import moved_by
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.problem.build_constraints import Surroundings, surroundings
from wbc.problem.build_tasks import BuiltTask, build_task
from wbc.problem.controller_specs import GlobalSpec, PseudoInverseSpec, QpSettings
from wbc.problem.mistakes import Mistakes
from wbc.problem.part_specs import ContactSpec, LimitsSpec, RobotSpec, StartSpec
from wbc.problem.plan import Phase, plan
from wbc.problem.shaping_checks import check_global, global_shaping
from wbc.problem.source import Source
from wbc.problem.spec import ProblemSpec
from wbc.problem.standing import contacts_of
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
    built:
        The tasks, and how their targets are moved.
    contacts:
        What is held in the first phase.
    phases:
        What happens, in order; a run without phases is one.
    """

    robot: Robot
    start: Array
    built: tuple[BuiltTask, ...]
    contacts: tuple[Contact, ...]
    phases: tuple[Phase, ...]
    limits: Limits | None
    surroundings: Surroundings
    contact_slack: Mapping[str, float]

    @property
    def tasks(self) -> tuple[Task, ...]:
        """All tasks, in the order of the file."""
        return tuple(one.task for one in self.built)

    def controller(
        self,
        spec: QpSettings | PseudoInverseSpec,
        tasks: Sequence[Task],
        contacts: Sequence[Contact],
        snapshot: Snapshot,
    ) -> Controller:
        """Return a new controller, which remembers nothing of earlier runs.

        CoM supports are those of the contacts as they are at ``snapshot``.
        """
        constraints = self.surroundings.around(snapshot, contacts)
        frames = [contact.frame for contact in contacts]
        slack = {frame: w for frame, w in self.contact_slack.items() if frame in frames}
        slack |= self.surroundings.slack_of(constraints)
        common: dict[str, Any] = {
            "contacts": contacts,
            "constraints": constraints,
            "slack": slack,
            "limits": self.limits,
            "dt": spec.dt,
            "damping": spec.damping,
            "joint_weights": spec.joint_weights,
        }
        if isinstance(spec, PseudoInverseSpec):
            return PseudoInverseController(self.robot, tasks, **common)
        return KinematicController(
            self.robot,
            tasks,
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
    built = dict[str, BuiltTask]()
    for name, task_spec in spec.tasks.items():
        with mistakes.at("tasks", name):
            built[name] = build_task(name, task_spec, start)
    contacts = list[Contact]()
    with mistakes.at("support"):
        contacts += contacts_of(spec.support, start)
    phases = plan(spec, built, start, source, mistakes)
    if isinstance(spec.controller, QpSettings):
        with mistakes.at("controller"):
            _backend(spec.controller)
    for pattern in spec.controller.joint_weights:
        with mistakes.at("controller", "joint_weights", pattern):
            moved_by(robot, pattern)
    _check_stop(spec, mistakes)
    if isinstance(spec.controller, GlobalSpec):
        check_global(spec, mistakes)
    limits = mistakes.require(("limits",), partial(_limits, spec.limits, robot))
    around = surroundings(spec.constraints, start, limits, mistakes)
    mistakes.raise_any()
    parts = Parts(
        robot=robot,
        start=start.q,
        built=tuple(built.values()),
        contacts=contacts_of(phases[0].support, start),
        phases=phases,
        limits=limits,
        surroundings=around,
        contact_slack=_contact_slack(spec),
    )
    make = partial(parts.controller, spec.controller, parts.tasks, parts.contacts, start)
    mistakes.require(("controller",), make)
    if isinstance(spec.controller, GlobalSpec):
        search = partial(global_shaping, parts, spec, spec.controller)
        mistakes.require(("controller",), search)
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


def _contact_slack(spec: ProblemSpec) -> dict[str, float]:
    """Return the slack weights of contacts, by frame; a later phase's count over an earlier's."""
    supports = [spec.support, *(phase.support for phase in (spec.phases or {}).values())]
    listed = [one for support in supports if not isinstance(support, str) for one in support or ()]
    return {
        one.frame: one.slack
        for one in listed
        if isinstance(one, ContactSpec) and one.slack is not None
    }


def _backend(spec: QpSettings) -> Backend:
    settings = {} if spec.eps is None else {"eps": spec.eps}
    return make_backend(spec.solver, **settings)


def _check_stop(spec: ProblemSpec, mistakes: Mistakes) -> None:
    for name in spec.stop.accept:
        with mistakes.at("stop", "accept", name):
            if name not in spec.tasks:
                raise UnknownNameError("task", name, spec.tasks)
    stop, where = spec.whole_stop, ("stop", "duration") if spec.phases is None else ("phases",)
    ticks = stop.duration / spec.controller.dt
    with mistakes.at(*where):
        if ticks > MAX_TICKS:
            raise InvalidInputError(
                f"{stop.duration:g} s at a time step of {spec.controller.dt:g} s are "
                f"{ticks:.3g} ticks; at most {MAX_TICKS:,} are possible"
            )
    if spec.phases is None:
        _check_ramps(spec, mistakes)
    else:
        _check_no_times(spec, mistakes)
    if spec.phases is None and not any(task.active for task in spec.tasks.values()):
        with mistakes.at("tasks"):
            raise InvalidInputError("no task is active; there is nothing to do")


def _check_ramps(spec: ProblemSpec, mistakes: Mistakes) -> None:
    for name, ramp in _ramps(spec):
        with mistakes.at("tasks", name, "ramp"):
            if ramp > spec.stop.duration:
                raise InvalidInputError(
                    f"{ramp:g} s is longer than the run (stop.duration, {spec.stop.duration:g} s)"
                )


def _check_no_times(spec: ProblemSpec, mistakes: Mistakes) -> None:
    """Refuse what phases decide: how long the run is, and how long its targets move."""
    for key in sorted(spec.stop.model_fields_set & {"duration", "speed"}):
        with mistakes.at("stop", key):
            raise InvalidInputError("a run with phases ends after the last; leave this out")
    for name, _ in _ramps(spec):
        with mistakes.at("tasks", name, "ramp"):
            raise InvalidInputError(
                "with phases a target begins where this section says and moves in the phases that "
                "give it another; leave this out"
            )


def _ramps(spec: ProblemSpec) -> list[tuple[str, float]]:
    tasks = spec.tasks.items()
    ramps = [(name, getattr(task, "ramp", None)) for name, task in tasks]
    return [(name, ramp) for name, ramp in ramps if ramp is not None]
