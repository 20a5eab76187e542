"""Equality constraints of a compiled MuJoCo model: joints that follow others, and closed loops."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.polynomial import Polynomial

from wbc.errors import ModelError
from wbc.robot.formats.couplings import Coupling, Loop
from wbc.robot.formats.mujoco_part import RobotPart, acting_motors
from wbc.robot.formats.mujoco_tree import pose_of
from wbc.robot.formats.xml import LARGEST_GEAR
from wbc.robot.notes import noted
from wbc.validate import Array

CONNECT = "mjEQ_CONNECT"
TIES = (CONNECT, "mjEQ_WELD")  # of two frames


def couplings(part: RobotPart) -> tuple[dict[str, Coupling], tuple[str, ...]]:
    """Return the mimic joints' couplings (constant if they follow no joint), and notes.

    Of two constraints of one joint, one is inverted: its driver follows the joint. So is that of a
    joint with a motor which would follow one without.

    Raises ModelError: a coefficient beyond any gear's; an active constraint of tendons or soft
    bodies; or several of one joint of which none can be turned around.
    """
    found = dict[str, Coupling]()
    motors = acting_motors(part.mujoco, part.model)
    driven = {part.names.joints[joint] for joint in motors.values()}
    for name, coupling in _couplings(part):
        if found.setdefault(name, coupling) == coupling:
            continue
        both = sorted((coupling, found[name]), key=lambda one: one.driver in driven)
        for one, other in (both, both[::-1]):
            around = one.inverse(name)
            if around is not None and one.driver not in {*found, name}:
                found |= {name: other, one.driver: around}
                break
        else:
            raise ModelError(
                f"{part.path}: joint {name!r} is tied by several equality constraints, none of"
                " which can be turned around; write them as joints that follow one"
            )
    for name, coupling in list(found.items()):
        around = coupling.inverse(name)
        if around is None or name not in driven or coupling.driver in {*driven, *found}:
            continue
        del found[name]
        found[coupling.driver] = around
    told = "equality constraints with what is left out do not act: {}"
    return found, noted(told, _outside_constraints(part))


def _outside_constraints(part: RobotPart) -> list[str]:
    """Return the active constraints with other bodies or joints of a floating base, in words."""
    found, model = [], part.model
    for number in _active(part):
        bodies = _bodies_of(part, number) - {0}
        joints = {int(model.eq_obj1id[number]), int(model.eq_obj2id[number])}
        floats = joints & {*part.floating_joints} and _kind(part, number).name == "mjEQ_JOINT"
        if floats or (bodies & {*part.bodies} and bodies - {*part.bodies}):
            ends = [part.names.bodies[body] for body in sorted(bodies)]
            found.append(part.names.equalities[number] or " to ".join(ends))
    return found


def _bodies_of(part: RobotPart, number: int) -> set[int]:
    """Return the bodies that a constraint is about; none of tendons and soft bodies."""
    model = part.model
    kinds, kind = part.mujoco.mjtObj, int(model.eq_objtype[number])
    ends = {int(model.eq_obj1id[number]), int(model.eq_obj2id[number])}
    if kind == kinds.mjOBJ_SITE:
        return {int(model.site_bodyid[site]) for site in ends}
    if _kind(part, number).name == "mjEQ_JOINT":  # of which the kind of objects is not set
        return {int(model.jnt_bodyid[joint]) for joint in ends if joint >= 0}
    return ends if kind == kinds.mjOBJ_BODY else set()


def _couplings(part: RobotPart) -> Iterator[tuple[str, Coupling]]:
    """Yield what joint constraints say, one by one.

    MuJoCo's polynomial is of joint values measured from ``ref``, ours is not.
    """
    mine, model, names = {*part.joints}, part.model, part.names
    for number in _active(part):
        kind = _kind(part, number)
        if kind.name == "mjEQ_TENDON" and (tied := _tied_by_tendons(part, number)) is not None:
            joint, driver, tied_by = tied
            if {joint, driver} <= mine:
                yield names.joints[joint], _coupling(part, joint, driver, tied_by)
            continue
        if kind.name != "mjEQ_JOINT":
            if kind.name not in TIES and _is_robots_own(part, number):
                raise ModelError(
                    f"{part.path}: equality constraint <{kind.name[5:].lower()}"
                    f" name={names.equalities[number]!r}>: constraints of tendons, but for those of"
                    " two joints, and of soft bodies are not supported; remove it, or give it"
                    ' active="false"'
                )
            continue
        joint, driver = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        if joint not in mine or not (driver < 0 or driver in mine):
            continue
        yield names.joints[joint], _coupling(part, joint, driver, model.eq_data[number][:5])


def _coupling(part: RobotPart, joint: int, driver: int, powers: Array) -> Coupling:
    """Return a joint's coupling by MuJoCo's polynomial (5,); ``driver`` is negative for none."""
    name, qpos0 = part.names.joints[joint], part.model.qpos0
    if not np.all(np.abs(powers) <= LARGEST_GEAR):
        raise ModelError(
            f"{part.path}: equality constraint of joint {name!r}: <joint polycoef> is larger"
            f" than {LARGEST_GEAR:g}"
        )
    drawn = float(qpos0[part.start_of(joint)])
    if driver < 0:
        return Coupling("", 0.0, float(powers[0]) + drawn)
    there = float(qpos0[part.start_of(driver)])
    return _recentred(part.names.joints[driver], powers.tolist(), drawn, there)


def _tied_by_tendons(part: RobotPart, number: int) -> tuple[int, int, Array] | None:
    """Return a joint, its driver and the polynomial (5,) by which tendons tie them, or None.

    One fixed tendon of two joints, of which the second follows the first unless it alone has a
    motor; or two fixed tendons of one joint each.
    """
    model, motors = part.model, acting_motors(part.mujoco, part.model).values()
    tendons = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
    pulled = [_pulled(part, tendon) for tendon in tendons if tendon >= 0]
    powers = np.array(model.eq_data[number][:5])
    if [len(one) for one in pulled] == [2]:
        (driver, a), (joint, b) = pulled[0]
        if joint in motors and driver not in motors:
            (driver, a), (joint, b) = pulled[0][::-1]
        powers = np.array((powers[0] / b, -a / b, 0.0, 0.0, 0.0))
    elif [len(one) for one in pulled] == [1, 1]:
        (joint, a), (driver, b) = pulled[0][0], pulled[1][0]
        powers = powers * b ** np.arange(5) / a
    else:
        return None
    return joint, driver, powers


def _pulled(part: RobotPart, tendon: int) -> list[tuple[int, float]]:
    """Return the joints of a fixed tendon and their coefficients; none of another tendon."""
    model, kind = part.model, int(part.mujoco.mjtWrap.mjWRAP_JOINT)
    first = int(model.tendon_adr[tendon])
    wraps = range(first, first + int(model.tendon_num[tendon]))
    found = [(int(model.wrap_objid[k]), float(model.wrap_prm[k])) for k in wraps]
    fixed = all(int(model.wrap_type[k]) == kind for k in wraps)
    return found if fixed and all(by for _, by in found) else []


def _recentred(driver: str, powers: list[float], drawn: float, there: float) -> Coupling:
    """Return a polynomial in the driver's displacement from ``ref`` as one in its position."""
    offset, ratio, *curved = powers
    if not any(curved):
        return Coupling(driver, ratio, offset + drawn - ratio * there)
    shifted = np.zeros(5)
    found = Polynomial(powers)(Polynomial((-there, 1.0))).coef
    shifted[: found.size] = found
    shifted[0] += drawn
    offset, ratio, *curved = shifted.tolist()
    return Coupling(driver, ratio, offset, (curved[0], curved[1], curved[2]))


def add_loops(
    part: RobotPart, tree: pin.Model, base: pin.SE3
) -> tuple[dict[str, Loop], tuple[str, ...], tuple[str, ...]]:
    """Add the frames of active ``connect`` and ``weld`` constraints to ``tree``.

    Return the loops by name, which of them have an end on the world, which becomes one on a root
    that is fixed, and notes.

    Raises ModelError: a constraint ties a floating base to the world.
    """
    loops, model, names = dict[str, Loop](), part.model, part.names
    tied, on_world = _active(part), list[str]()
    for number in tied:
        kind = _kind(part, number)
        if kind.name not in TIES or not _is_robots_own(part, number):
            continue
        ends, places = _ends(part, number)
        name = names.equalities[number] or " to ".join(names.bodies[body] for body in ends)
        while name in loops:
            name += "'"
        if 0 in ends and part.floats:
            raise ModelError(
                f"{part.path}: equality constraint <{kind.name[5:].lower()} name={name!r}> ties the"
                " floating base to the world; remove it, and hold the frame by a contact with"
                " friction=None"
            )
        on_world += [name] if 0 in ends else []
        frames = []
        for body, place in zip(ends, places, strict=True):
            joint, above, pose = 1, 0, base.inverse() * place
            if body:
                above = int(tree.getFrameId(names.bodies[body], pin.FrameType.BODY))
                joint = int(tree.frames[above].parentJoint)
                pose = tree.frames[above].placement * place
            frames.append(f"{name} at {names.bodies[body]}")
            frame = pin.Frame(frames[-1], joint, above, pose, pin.FrameType.OP_FRAME)
            tree.addFrame(frame, False)
        is_point = kind.name == CONNECT or model.eq_data[number][10] == 0.0
        # The one that is held, as seen from the first body.
        loops[name] = Loop((frames[1], frames[0]), "point" if is_point else "pose")
    passed = [names.equalities[k] or f"number {k}" for k in range(model.neq) if k not in tied]
    notes = noted("equality constraints that are not active: {}", passed)
    told = [f"{name} ({one.kind})" for name, one in loops.items()]
    return loops, tuple(on_world), notes + noted("closed loops: {}", told)


def _ends(part: RobotPart, number: int) -> tuple[list[int], list[pin.SE3]]:
    """Return the bodies of a connect or weld, and where its two frames are on them."""
    model = part.model
    ends = [int(model.eq_obj1id[number]), int(model.eq_obj2id[number])]
    data, identity = np.array(model.eq_data[number]), np.array((1.0, 0.0, 0.0, 0.0))
    if int(model.eq_objtype[number]) == int(part.mujoco.mjtObj.mjOBJ_SITE):
        places = [pose_of(model.site_pos[site], model.site_quat[site]) for site in ends]
        return [int(model.site_bodyid[site]) for site in ends], places
    if _kind(part, number).name == CONNECT:
        return ends, [pose_of(data[:3], identity), pose_of(data[3:6], identity)]
    # Of a weld: the point on the second body, then that on the first, and how the second is turned.
    return ends, [pose_of(data[3:6], data[6:10]), pose_of(data[:3], identity)]


def _active(part: RobotPart) -> list[int]:
    """Return the numbers of the constraints that act."""
    bits, model = part.mujoco.mjtDisableBit, part.model
    off = int(bits.mjDSBL_EQUALITY) | int(bits.mjDSBL_CONSTRAINT)
    if int(model.opt.disableflags) & off:
        return []
    return [number for number in range(model.neq) if model.eq_active0[number]]


def _kind(part: RobotPart, number: int) -> Any:
    return part.mujoco.mjtEq(int(part.model.eq_type[number]))


def _is_robots_own(part: RobotPart, number: int) -> bool:
    """Return whether a constraint is on the robot's bodies or tendons, or the world, only."""
    kinds = part.mujoco.mjtObj
    if int(part.model.eq_objtype[number]) not in (kinds.mjOBJ_SITE, kinds.mjOBJ_BODY):
        return True
    ends = _bodies_of(part, number)
    known = {0, *part.bodies}
    return ends <= known and ends != {0}


def initial_joints(part: RobotPart) -> Mapping[str, tuple[float, ...]]:
    """Return the file's initial joint positions, at which its loops are mostly closed."""
    return {
        part.names.joints[joint]: (float(part.model.qpos0[part.start_of(joint)]),)
        for joint in part.joints
        if part.kind_of(joint) != "ball"
    }
