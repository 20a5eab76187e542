"""The core's QPs and ticks against Python's, in episodes of random tasks and contacts."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
from native_agreement_found import Found, apart, correction, of_qps
from native_agreement_sides import Sides, without_core

import wbc
from wbc.constraints.margin import SKIN
from wbc.controllers.native_problem import NativeProblem
from wbc.controllers.native_tick import NativeController
from wbc.controllers.tick import ACTIVE, NEGLIGIBLE
from wbc.controllers.torque_tick import TorqueTick
from wbc.robot.names import BASE
from wbc.rotations import exp_rotation
from wbc.validate import Array

EPISODE = 50


def tasks_of(here: wbc.Snapshot, rng: np.random.Generator) -> list[wbc.Task]:
    """One of each kind that the core knows, targets moving."""
    robot, frames = here.robot, here.robot.frame_names
    frame = frames[rng.integers(len(frames))]
    turned = here.rotation(frame) @ exp_rotation(rng.uniform(-1.0, 1.0, 3))
    com, shape = wbc.ComTask(robot, here.com), wbc.InertiaTask(robot, here.inertia)
    turn = wbc.OrientationTask(robot, frame, turned, name="turn")
    posture = wbc.PostureTask(robot, here.q)
    com.set_target(here.com + 0.1 * rng.normal(size=3), *rng.normal(size=(2, 3)))
    shape.set_target(here.inertia * np.exp(0.3 * rng.normal()), 0.1 * here.inertia, here.inertia)
    turn.set_target(turned, *rng.normal(size=(2, 3)))
    posture.set_target(here.q, *rng.normal(size=(2, robot.nv)))
    local = wbc.InertiaTask(robot, here.inertia_in(BASE), frame=BASE, name="local")
    momentum = wbc.MomentumTask(robot, rng.normal(size=6))
    momentum.set_target(momentum.target, rng.normal(size=6))
    tasks = [com, shape, local, turn, posture, momentum]
    for task in tasks:
        task.weight = 10.0 ** rng.uniform(-2, 2)
    return tasks


def contacts_of(here: wbc.Snapshot, rng: np.random.Generator) -> list[wbc.Contact]:
    """Feet, and now and then a grip or a point."""
    frames = here.robot.frame_names
    contacts = list(wbc.support(here, str(rng.choice(["floating", "left", "right", "double"]))))
    held = {contact.frame for contact in contacts}
    name = frames[rng.integers(len(frames))]
    if rng.random() < 0.3 and name not in held:
        kind = wbc.PointContact if rng.random() < 0.5 else wbc.Contact
        contacts.append(kind.hold(here, name, friction=None))
    return contacts


def compare(sides: Sides, level: type[NativeController], rng: np.random.Generator) -> Found:
    """Compare the QPs of one episode."""
    limited, found, made = rng.random() < 0.8, Found(), []
    for side, chance in zip(sides, (rng, deepcopy(rng)), strict=True):
        robot = side.robot
        standing = robot.snapshot(robot.posture("standing"))
        contacts, tasks = contacts_of(standing, chance), tasks_of(standing, chance)
        limits = side.limits if limited else None
        made.append(level(robot, tasks, contacts=contacts, limits=limits, solver="active_set"))
    controller, plain = made
    native, robot = controller.native, sides.native.robot
    for _ in range(EPISODE):
        size = 10.0 ** rng.uniform(-4, -1)
        q = robot.integrate(robot.posture("standing"), size * rng.normal(size=robot.nv), 1.0)
        v = 10.0 ** rng.uniform(-1, 1) * size * rng.normal(size=robot.nv)
        ours = None if native is None else controller._native_problem(native, robot.snapshot(q, v))
        if ours is None:
            found.add(None)
            continue
        with without_core():
            theirs = plain.step(sides.plain.robot.snapshot(q, v))
        # By a policy it may be another QP than the first.
        found.add(0.0 if theirs.policy is not None else of_qps(ours.qp, theirs.qp))
    return found


def reaching(here: wbc.Snapshot, rng: np.random.Generator) -> list[wbc.Task]:
    """Tasks that push bodies into each other and joints to their ends: frames go anywhere."""
    robot, names = here.robot, here.robot.frame_names
    tasks: list[wbc.Task] = [wbc.PostureTask(robot, here.q, weight=0.1)]
    tasks.append(wbc.ComTask(robot, here.com + 0.05 * rng.normal(size=3), weight=3.0))
    tasks.append(wbc.InertiaTask(robot, here.inertia * np.exp(0.5 * rng.normal()), per_mass=True))
    for frame in rng.choice(names, size=3, replace=False).tolist():
        target = here.com + 0.4 * rng.normal(size=3)
        tasks.append(wbc.PositionTask(robot, frame, target, name=f"to {frame}", gain=0.3))
    return tasks


def compare_ticks(
    sides: Sides, level: type[NativeController], solver: str, rng: np.random.Generator
) -> Found:
    """Compare whole ticks of one episode in closed loop; the Python tick's solver is DAQP."""
    found, made = Found(), []
    support = str(rng.choice(["floating", "left", "right", "double"]))
    for side, chance, by in zip(sides, (rng, deepcopy(rng)), (solver, "active_set"), strict=True):
        here = side.robot.snapshot(side.robot.posture("standing"))
        kept = {"limits": side.limits, "constraints": [side.margin]}
        contacts = wbc.support(here, support)
        made.append(level(side.robot, reaching(here, chance), contacts=contacts, solver=by, **kept))
    controller, plain = made
    robot = sides.native.robot
    q, v = robot.posture("standing"), np.zeros(robot.nv)
    for _ in range(EPISODE):
        if rng.random() < 0.2:
            size = 10.0 ** rng.uniform(-6, -2)
            q = robot.integrate(q, size * rng.normal(size=robot.nv), 1.0)
            q = robot.limits.clamped(q)
            v = v + 10.0 * size * rng.normal(size=robot.nv)
        state = robot.snapshot(q, v)
        ours = answered(controller, state)
        if ours is None:
            found.add(None)
            v = controller.step(state).velocity
        else:
            pairs = sides.plain.margin.model
            pairs.by_coal = False
            with without_core():
                theirs = plain.step(sides.plain.robot.snapshot(q, v))
            one = compare_tick(controller, state, ours, theirs)
            if pairs.by_coal:
                nothing = {"worst": 0.0, "other": 0.0, "exact": 0.0, "optima": 0.0}
                one = replace(one, **nothing, by_coal=1, coal=one.worst)
            found.join(one)
            v = theirs.velocity
        q = robot.integrate(q, v, controller.dt)
    return found


def answered(controller: NativeController, state: wbc.Snapshot) -> NativeProblem | None:
    """Return the core's answer; None: it handed the tick over."""
    native = controller.native
    ours = None if native is None else controller._native_problem(native, state)
    return ours if ours is not None and ours.solved and native.margin is not None else None


def commanded(tick: wbc.Tick) -> list[Array]:
    """Return what a tick commands."""
    return [tick.velocity, tick.torque] if isinstance(tick, TorqueTick) else [tick.velocity]


def compare_tick(
    controller: NativeController, state: wbc.Snapshot, ours: NativeProblem, theirs: wbc.Tick
) -> Found:
    """Compare one tick of the core with Python's."""
    one = Found(compared=1)
    same = (theirs.status.value, theirs.policy, theirs.step_scale) == ("solved", None, 1.0)
    rows = ours.qp.labels.inequality, theirs.qp.labels.inequality
    if not same or len(rows[0]) != len(rows[1]):
        one.refuted = 1
        return one
    clearance = ours._answer.clearance
    if rows[0] != rows[1]:
        (margin,) = controller.constraints
        made = margin.braked_rows if isinstance(controller, wbc.TorqueController) else margin.rows
        near = made(state, controller.dt).distances.clearance
        one.worst = float(np.abs(np.sort(near) - np.sort(clearance)).max())
        return one
    one.worst = of_qps(ours.qp, theirs.qp)
    tick = controller._native_tick(ours, state)
    commands, optima = [commanded(each) for each in (tick, theirs)], []
    for each, command in zip((tick, theirs), commands, strict=True):
        off = correction(each.qp, each.solution)
        changes = [off[: state.v.size]]
        if isinstance(each, TorqueTick):
            changes.append(controller.contact_forces.unit * ours.matrix[6:] @ off)
        optima.append([a + b for a, b in zip(command, changes, strict=True)])
    one.other, one.exact, one.optima = (
        max(apart(*both) for both in zip(a, b, strict=True))
        for a, b in (commands, (commands[0], optima[0]), optima)
    )
    x, z, qp, nv = theirs.solution.x, theirs.solution.z, theirs.qp, state.v.size
    pull = np.abs(z)  # as Tick.active
    one.held = int(pull[-clearance.size :].max() > max(NEGLIGIBLE, ACTIVE * pull.max()))
    one.inside = int((clearance < -SKIN).any())
    bounded = np.minimum(x[:nv] - qp.lower[:nv], qp.upper[:nv] - x[:nv])
    one.limited = int((bounded < 1e-9).any())
    return one
