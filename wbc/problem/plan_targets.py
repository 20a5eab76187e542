"""Tasks that follow a plan or a motion: reading it, checking it, and driving their targets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wbc.constraints import Contact
from wbc.files import beside
from wbc.gait.legs import SIDES
from wbc.problem.kinds.frame import OrientationSpec
from wbc.problem.mistakes import Misplaced, Mistakes
from wbc.problem.spec import ProblemSpec
from wbc.problem.support import contacts_of
from wbc.problem.targets import Followed, FromMotion, FromPlan, LoopTarget
from wbc.problem.task_spec import TaskSpec
from wbc.problem.yaml_reader import read_source
from wbc.robot import Snapshot
from wbc.run.phase_support import held_feet
from wbc.run.ramps import Course, TargetedTask
from wbc.tracking.reference import PlanReference
from wbc.validate import Array

if TYPE_CHECKING:  # plans load CasADi, motions SciPy
    from wbc.retargeting.reference import MotionReference
    from wbc.rmp.plan import Plan


SAME_START = 1e-3  # m or rad: tolerance of the start, because soles are put on the ground


@dataclass(frozen=True, eq=False)
class ReferenceCourse:
    """One task's trajectory in a plan or motion: names of value, rate and acceleration."""

    reference: PlanReference | MotionReference
    names: tuple[str, ...]

    @property
    def duration(self) -> float:
        """When the plan has ended [s]."""
        return self.reference.ends

    def at(self, t: float) -> tuple[Array, Array, Array]:
        """Return value, rate and acceleration at ``t`` [s]."""
        target = self.reference.at(t)
        value, *moving = (getattr(target, name) for name in self.names)
        rate, acceleration, *_ = (*moving, np.zeros_like(value), np.zeros_like(value))
        return value, rate, acceleration


def follow_plan(
    spec: ProblemSpec,
    built: Mapping[str, TargetedTask],
    start: Snapshot,
    contacts: Sequence[Contact],
    folder: Path,
    mistakes: Mistakes,
) -> tuple[dict[str, TargetedTask], PlanReference | MotionReference | None]:
    """Return the tasks, with targets driven by their plan or motion, and that, or None.

    ``built``: the tasks by name.
    ``contacts``: held throughout.
    ``folder``: from which relative paths start.
    """
    targets = {name: task.target for name, task in spec.tasks.items() if name in built}
    following = {name: one for name, one in targets.items() if isinstance(one, Followed)}
    if not following:
        return dict(built), None
    first, wanted = next(iter(following.items()))
    reference: PlanReference | MotionReference | None = None
    with mistakes.at("tasks", first, "target"):
        if isinstance(wanted, FromMotion):
            reference = _motion(spec, wanted, start, contacts, folder)
        else:
            reference = _reference(spec, wanted, start, contacts, folder)
    led = dict(built)
    for name, target in following.items():
        with mistakes.at("tasks", name):
            if target != wanted:
                raise Misplaced(
                    f"all tasks of a problem follow the same plan or motion, and {first!r} follows"
                    f" {_words(wanted)}",
                    "target",
                )
            if getattr(spec.tasks[name], "ramp", None) is not None:
                raise Misplaced("a plan says itself how its target moves; leave this out", "ramp")
            if reference is not None:
                led[name] = replace(
                    built[name], course=_course_of_task(spec.tasks[name], reference)
                )
    return led, reference


def _course_of_task(task: TaskSpec, reference: PlanReference | MotionReference) -> Course:
    if isinstance(task, OrientationSpec) and not isinstance(reference, PlanReference):
        from wbc.retargeting.reference import FrameRotation

        return FrameRotation(reference, task.frame)
    return ReferenceCourse(reference, task.of_plan)


def _words(wanted: Followed) -> str:
    file = wanted.plan if isinstance(wanted, FromPlan) else wanted.motion
    return f"{file} from {wanted.begins:g} s on"


def refuse_course(target: object, before: object) -> None:
    """Refuse a target of a phase that would follow a plan or a loop, or that would leave a plan.

    ``target``, ``before``: in the phase, and until then.
    """
    if isinstance(target, LoopTarget):
        raise Misplaced("a loop is gone round from the start on, in a run without phases", "target")
    if isinstance(target, Followed):
        raise Misplaced(
            "a plan is followed from the start on: give it in the section tasks", "target"
        )
    if isinstance(before, Followed):
        raise Misplaced(
            "the task follows a plan, in all phases in which it is active; give active: false, and"
            " another task this target",
            "target",
        )


def check_loops(spec: ProblemSpec, built: Mapping[str, TargetedTask], mistakes: Mistakes) -> None:
    """Note loops in a run with phases, and those that end after the run."""
    for name, one in built.items():
        with mistakes.at("tasks", name):
            if not isinstance(spec.tasks[name].target, LoopTarget) or one.course is None:
                continue
            if spec.phases is not None:
                refuse_course(spec.tasks[name].target, None)
            _check_ends(spec, "the loop", one.course.duration, "target")


def _check_ends(spec: ProblemSpec, what: str, ends: float, *below: str) -> None:
    """Raise Misplaced, at ``below``, for a target that still moves [s] after the run."""
    duration = spec.whole_stop.duration
    if ends > duration + spec.controller.dt:
        where = f"{spec.timed_by}.duration" if spec.phases is None else "all phases"
        text = f"{what} ends at {ends:.4g} s, after the run ({where}, {duration:g} s)"
        raise Misplaced(text, *below)


def _motion(
    spec: ProblemSpec,
    wanted: FromMotion,
    start: Snapshot,
    contacts: Sequence[Contact],
    folder: Path,
) -> MotionReference:
    """Return the motion that a problem's tasks follow.

    Raises WbcError: no such motion, one of another robot, on other feet or longer than the run, or
    one that does not begin where the robot starts.
    """
    from wbc.retargeting.reference import MotionReference  # only now: it loads SciPy
    from wbc.retargeting.standing import StandingMotion

    if spec.phases is not None:
        raise Misplaced("a motion is followed in a run without phases")
    if set(held_feet(contacts)) != set(SIDES):
        raise Misplaced("a motion is followed on both feet; give support: double")
    motion = StandingMotion.read(beside(folder, wanted.motion), start.robot)
    off = np.abs(start.robot.difference(motion.start, start.q))
    if off.max() > SAME_START:
        raise Misplaced(
            "the robot does not start where the motion begins; give start:"
            f" {{motion: {wanted.motion}}}"
        )
    options = wanted.model_dump(exclude={"motion"})
    options["friction"] = spec.controller.friction_cone.coefficient
    reference = MotionReference(motion, **options)
    _check_ends(spec, "the motion", reference.ends)
    return reference


def _reference(
    spec: ProblemSpec, wanted: FromPlan, start: Snapshot, contacts: Sequence[Contact], folder: Path
) -> PlanReference:
    """Return the plan that a problem's tasks follow.

    Raises WbcError: no such plan, one that is not for this robot or longer than the run, or that
    flies where no phase lets go of the ground.
    """
    feet = held_feet(contacts)
    if not feet:
        raise Misplaced("a plan needs feet on the ground; give support: double, left or right")
    flights = False
    for name, phase in (spec.phases or {}).items():
        if phase.support == "floating":
            flights = True
        elif phase.support is not None and held_feet(contacts_of(phase.support, start)) != feet:
            raise Misplaced(
                f"a plan is followed on the same feet in all phases but flights, and phase {name!r}"
                " has others"
            )
    plan = read_plan(beside(folder, wanted.plan))
    reference = PlanReference(plan, start, feet=feet, begins=wanted.begins, flights=flights)
    _check_ends(spec, "the plan", reference.ends)
    return reference


def read_plan(path: Path) -> Plan:
    """Return the plan of a .npz file, or of a problem file that describes one, which is solved.

    Raises WbcError: no such file, nothing about a plan, or a plan that does not exist.
    """
    if path.suffix not in (".yaml", ".yml"):
        from wbc.rmp.plan import load_plan  # only now: it loads CasADi

        return load_plan(path)
    from wbc.problem.pendulum.plan import Planning
    from wbc.problem.pendulum.problem import load_pendulum

    source = read_source(path)
    if "plan" not in source.data:
        raise Misplaced(f"{path} plans nothing: it has no key plan", "plan")
    parts = load_pendulum(source, {}, path.parent).parts
    if not isinstance(parts, Planning):
        raise Misplaced(f"{path} plans nothing: it simulates a law", "plan")
    return parts.solve()
