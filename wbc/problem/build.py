"""Build robot, tasks, contacts, limits and controller from a validated description.

Every name and number is checked here, before the run; see :mod:`wbc.problem.mistakes`.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from wbc.constraints import Constraint, Contact, Limits, Obstacles
from wbc.constraints.margin import SKIN
from wbc.controllers import Controller
from wbc.controllers.joint_weights import moved_by
from wbc.controllers.torque import TorqueController
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.gait.hand_support import HandSupport
from wbc.gait.legs import Legs, check_biped
from wbc.problem.components import Parts
from wbc.problem.constraint_spec import surroundings
from wbc.problem.controller_spec import GlobalSpec, PseudoInverseSpec, SolverSettings
from wbc.problem.global_search import check_global, global_shaping
from wbc.problem.levels import REMEDY, TORQUE, check_level
from wbc.problem.mistakes import Mistakes
from wbc.problem.plan import plan
from wbc.problem.plan_targets import check_loops, follow_plan
from wbc.problem.robot_spec import RobotSpec
from wbc.problem.simulation_spec import rotated_to_plane
from wbc.problem.source import Source
from wbc.problem.spec import ProblemSpec
from wbc.problem.support import (
    check_feet_on_ground,
    check_support_given,
    contacts_of,
    slack_by_frame,
    tell_below_ground,
)
from wbc.problem.walk import WalkSpec, walker_of
from wbc.robot import Snapshot
from wbc.run.phase_support import held_feet
from wbc.run.phases import Phase
from wbc.run.ramps import TargetedTask

MAX_TICKS = 1_000_000
SHAPE_TOLERANCE = 0.05  # m: simple shapes may exceed the bodies that they represent by less


def build(spec: ProblemSpec, source: Source, folder: Path) -> Parts:
    """Return the parts of a problem; relative paths start from ``folder``.

    Raises ProblemFileError: with every mistake found, each with its line and key path.
    """
    mistakes = Mistakes(source)
    start = _start(spec, folder, mistakes)
    robot = start.robot
    if isinstance(spec, WalkSpec):
        mistakes.require(("gait",), partial(check_biped, robot))
    built = dict[str, TargetedTask]()
    for name, task in spec.tasks.items():
        with mistakes.at("tasks", name):
            built[name] = task.build(name, start)
    contacts = list[Contact]()
    with mistakes.at("support"):
        first = next((phase.support for phase in (spec.phases or {}).values()), None)
        check_support_given(spec.support or first, robot)
        contacts += contacts_of(spec.support, start, spec.controller.friction_cone)
        if not spec.phases:  # each phase checks its own feet
            turned = spec.ground_height is not None and not robot.fixed_base
            slope = spec.simulation.terrain.slope if turned else (0.0, 0.0)
            check_feet_on_ground(spec.support, start, slope)
    check_level(spec, mistakes)
    check_loops(spec, built, mistakes)
    built, reference = follow_plan(spec, built, start, contacts, folder, mistakes)
    phases = plan(spec, built, start, mistakes)
    if isinstance(spec.controller, SolverSettings):
        with mistakes.at("controller"):
            spec.controller.backend()
    for pattern in spec.controller.joint_weights:
        with mistakes.at("controller", "joint_weights", pattern):
            moved_by(robot, pattern)
    _check_stop(spec, mistakes)
    if isinstance(spec.controller, GlobalSpec):
        check_global(spec, mistakes)
    for name, constraint in spec.constraints.items():
        if isinstance(spec.controller, PseudoInverseSpec) and constraint.slack is None:
            text = "a pseudo-inverse keeps no hard constraint; give slack, or leave this out"
            mistakes.note(("constraints", name), text)
    limits: Limits | None = None
    if not isinstance(spec.limits, str):
        limits = mistakes.require(("limits",), partial(spec.limits.build, robot))
    constraints_at = surroundings(spec.constraints, start, limits, mistakes)
    mistakes.raise_any()
    _check_contact_frames(spec, phases, start, mistakes)
    if spec.controller.level == TORQUE:
        _check_where_forces_act(spec, phases, start, mistakes)
    mistakes.raise_any()
    supports = [spec.support, *(phase.support for phase in (spec.phases or {}).values())]
    if spec.start.on_ground and not any(spec.simulation.terrain.slope):
        tell_below_ground(phases[0].hold(start), start)
    parts = Parts(
        robot=robot,
        start=start.q,
        targeted=tuple(built.values()),
        contacts=tuple(phases[0].hold(start)),
        phases=phases,
        limits=limits,
        surroundings=constraints_at,
        contact_slack=slack_by_frame(start.robot, supports),
        plan=reference,
    )
    _check_parts(spec, parts, start, mistakes)
    return parts


def _start(spec: ProblemSpec, folder: Path, mistakes: Mistakes) -> Snapshot:
    """Return the robot's state at the start."""
    robot_spec = RobotSpec(model=spec.robot) if isinstance(spec.robot, str) else spec.robot
    robot = mistakes.require(("robot",), partial(robot_spec.load, folder))
    spec.start.check(robot, mistakes)
    mistakes.raise_any()
    q = mistakes.require(("start",), partial(spec.start.configuration, robot, folder))
    if spec.ground_height is not None and not robot.fixed_base:
        q = rotated_to_plane(q, spec.simulation.ground().normal)
    return robot.snapshot(q, np.zeros(robot.nv))


def _check_parts(spec: ProblemSpec, parts: Parts, start: Snapshot, mistakes: Mistakes) -> None:
    """Find mistakes in the combination of parts, by making the controller once."""
    if spec.controller.level == TORQUE:
        feet, duration = held_feet(parts.contacts), spec.whole_stop.duration
        spec.simulation.check(start, feet, spec.controller.dt, duration, mistakes)
    for name, one in parts.surroundings.constraints.items():  # contacts are known now
        with mistakes.at("constraints", name):
            check_outside(one.during(start, parts.contacts), start)
    mistakes.raise_any()
    for key, there in (("gait", isinstance(spec, WalkSpec)), ("phases", bool(spec.phases))):
        if spec.hands is not None and there:
            mistakes.note(("hands",), f"is for a robot that stands, and there are {key}")
    if isinstance(spec, WalkSpec):
        given = start.robot, parts.limits, spec.controller.torque_limits
        legs = mistakes.require(("gait",), partial(Legs.of, *given))
        spec.gait.check(start, legs, spec.whole_stop.duration, spec.ground_height, mistakes)
        for targeted in parts.targeted:
            if targeted.attendant is not None:
                text = "is for a robot that stands: a walk leads the capture point; leave it out"
                mistakes.note(("tasks", targeted.task.name, "law", "spin"), text)
        mistakes.require(("gait",), partial(walker_of, spec, parts))
        return
    make = partial(parts.controller, spec.controller, parts.tasks, parts.contacts, start)
    controller = mistakes.require(("controller",), make)
    with mistakes.at("hands"):
        hand_support(spec, parts, controller)
    mistakes.raise_any()
    if isinstance(spec.controller, GlobalSpec):
        search = partial(global_shaping, parts, spec, spec.controller)
        mistakes.require(("controller",), search)


def hand_support(spec: ProblemSpec, parts: Parts, controller: Controller) -> HandSupport | None:
    """Return the support of hands on walls, with a controller for it; None if there are no hands.

    Raises WbcError: a problem without walls, or of the velocity level, or walls out of reach.
    """
    if spec.hands is None:
        return None
    if not isinstance(controller, TorqueController):
        raise InvalidInputError(f"belongs to the torque level; {REMEDY[TORQUE]}")
    walls = spec.simulation.terrain.walls
    if not walls:
        raise InvalidInputError("there are no walls to lean on: give simulation.terrain.walls")
    friction = spec.controller.friction_cone.coefficient
    return spec.hands.support(controller, parts.at_start, walls, friction)


def check_outside(constraint: Constraint | None, start: Snapshot) -> None:
    """Refuse obstacles that the robot touches at the start."""
    if not isinstance(constraint, Obstacles):
        return
    distances = constraint.distances(start)
    depth = -(distances.clearance + SKIN + constraint.margin)
    worst = int(depth.argmax())
    if depth[worst] > SHAPE_TOLERANCE:
        raise InvalidInputError(
            f"the robot is inside an obstacle at the start: {constraint.labels(distances)[worst]},"
            f" by {1e3 * depth[worst]:.3g} mm; move one of them, or name the links that keep clear"
        )


def _check_contact_frames(
    spec: ProblemSpec, phases: Sequence[Phase], start: Snapshot, mistakes: Mistakes
) -> None:
    """Note frames of a force task that are not contacts in any phase in which it is used.

    In phases in which only some are contacts, the task ignores the others.
    """
    held = [{contact.frame for contact in phase.hold(start)} for phase in phases]
    for name, task in spec.tasks.items():
        used = [k for k, phase in enumerate(phases) if phase.changes[name].weight is not None]
        known = set[str]().union(*(held[k] for k in used))
        for frame in task.contact_frames if used else ():
            if frame not in known:
                held_then = ", ".join(sorted(known)) or "nothing"
                remedy = f"the support never holds it while the task is on (held: {held_then})"
                error = UnknownNameError("contact", frame, known, remedy)
                mistakes.note(("tasks", name), error)


def _check_where_forces_act(
    spec: ProblemSpec, phases: Sequence[Phase], start: Snapshot, mistakes: Mistakes
) -> None:
    """Note contacts, of the problem or of a phase, of which it is not known where they bear."""
    for k, phase in enumerate(phases):
        own = spec.phases is not None and spec.phases[phase.name].support is not None
        if k and not own:  # it has that of the phase before
            continue
        for contact in phase.hold(start):
            if contact.friction is not None and contact.corners is None:
                frame, where = contact.frame, ("phases", phase.name, "support")
                text = (
                    f"where forces act on {frame!r} is not known, it is no sole of"
                    f" {start.robot.name}: write {{frame: {frame}, type: point}}, or give corners:"
                    " [[x, y], ...] in its axes, or friction: grip if it also pulls and twists"
                )
                place = mistakes.source.find(frame, where if own else ("support",))
                mistakes.note(place, text)


def _check_stop(spec: ProblemSpec, mistakes: Mistakes) -> None:
    for name in spec.stop.accept:
        if name not in spec.tasks:
            mistakes.note(("stop", "accept", name), UnknownNameError("task", name, spec.tasks))
    _check_times(spec, mistakes)
    if spec.controller.level != TORQUE and "simulation" in spec.model_fields_set:
        mistakes.note(("simulation",), f"belongs to the torque level; {REMEDY[TORQUE]}")
    still = spec.phases is None and not isinstance(spec, WalkSpec)
    if still and not any(one.active for one in spec.tasks.values()):
        mistakes.note(("tasks",), "no task is active; there is nothing to do")


def _check_times(spec: ProblemSpec, mistakes: Mistakes) -> None:
    """Note runs and ramps that are too long, and times that something else defines."""
    duration, dt = spec.whole_stop.duration, spec.controller.dt
    timed = ("phases",) if spec.phases is not None else (spec.timed_by, "duration")
    if duration / dt > MAX_TICKS:
        mistakes.note(
            timed,
            f"{duration:g} s at a time step of {dt:g} s are {duration / dt:.3g} ticks; at most"
            f" {MAX_TICKS:,} are possible",
        )
    elsewhere, text = spec.stop.model_fields_set & {"duration", "speed"}, ""
    if spec.phases is not None:
        text = "a run with phases ends after the last; leave this out"
        if "duration" in spec.simulation.model_fields_set:
            mistakes.note(("simulation", "duration"), text)
    elif spec.controller.level == TORQUE:
        text = "belongs to the velocity level; a simulation lasts for simulation.duration"
    for key in sorted(elsewhere) if text else ():
        mistakes.note(("stop", key), text)
    if not text and spec.surroundings_move and spec.stop.speed and "speed" in elsewhere:
        moving = "obstacles move, so that the whole duration is run; leave this out"
        mistakes.note(("stop", "speed"), moving)
    for name, task in spec.tasks.items():
        ramp = getattr(task, "ramp", None)
        if ramp is not None and spec.phases is not None:
            mistakes.note(
                ("tasks", name, "ramp"),
                "with phases a target begins where this section says and moves in the phases that "
                "give it another; leave this out",
            )
        elif ramp is not None and ramp > duration:
            run = f"{spec.timed_by}.duration, {duration:g} s"
            mistakes.note(("tasks", name, "ramp"), f"{ramp:g} s is longer than the run ({run})")
