"""Joint ranges, motors, friction and springs of a compiled MuJoCo model."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

import numpy as np
import pinocchio as pin

from wbc.robot.formats.mujoco_part import RobotPart, acting_motors, actuators_of, motors_on_joints
from wbc.robot.notes import noted
from wbc.robot.passive import GravityCompensation, PassiveForces, Spring

Range = tuple[float, float]
UNBOUNDED: Range = (-math.inf, math.inf)


def set_joints(part: RobotPart, tree: pin.Model) -> None:
    """Write ranges, rotor inertia, friction and the motors' torques into ``tree``."""
    mujoco, model = part.mujoco, part.model
    rotors = _rotors(mujoco, model)
    motors = _motors(mujoco, model)
    disabled = int(model.opt.disableflags)
    damping = _damping(mujoco, model)
    rubbed = not disabled & (
        int(mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS) | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    )
    for joint in part.joints:
        if part.kind_of(joint) == "ball":
            continue
        index = tree.getJointId(part.names.joints[joint])
        q, v = int(tree.idx_qs[index]), int(tree.idx_vs[index])
        low, high = _range(model.jnt_range[joint]) if model.jnt_limited[joint] else UNBOUNDED
        tree.lowerPositionLimit[q], tree.upperPositionLimit[q] = low, high
        dof = int(model.jnt_dofadr[joint])
        tree.armature[v] = float(model.dof_armature[dof]) + rotors.get(joint, 0.0)
        tree.damping[v] = damping[joint][0]
        friction = max(float(model.dof_frictionloss[dof]), 0.0) if rubbed else 0.0  # as MuJoCo
        tree.lowerDryFrictionLimit[v], tree.upperDryFrictionLimit[v] = -friction, friction
        effort = min(
            _symmetric_limit(*motors.get(joint, UNBOUNDED)),
            _symmetric_limit(*_joint_force_range(model, joint)),
        )
        tree.lowerEffortLimit[v], tree.upperEffortLimit[v] = -effort, effort
        tree.lowerVelocityLimit[v], tree.upperVelocityLimit[v] = -math.inf, math.inf


def _flag(mujoco: Any, name: str) -> int:
    """Return a bit of ``disableflags``, or that by which older MuJoCo calls it."""
    bits = mujoco.mjtDisableBit.__members__
    return int(bits.get(name, bits.get("mjDSBL_PASSIVE", 0)))


def _symmetric_limit(low: float, high: float) -> float:
    """Return a range's limit in both directions: its smaller end, or the other if that is 0."""
    ends = sorted((abs(low), abs(high)))
    return ends[0] or ends[1] or math.inf


def _joint_force_range(model: Any, joint: int) -> Range:
    """Return the range of force that a joint accepts from its motors."""
    return _range(model.jnt_actfrcrange[joint]) if model.jnt_actfrclimited[joint] else UNBOUNDED


def _rotors(mujoco: Any, model: Any) -> dict[int, float]:
    """Return the inertia [kg m^2 or kg] that motors add to joints (newer MuJoCo)."""
    found: dict[int, float] = {}
    if hasattr(model, "actuator_armature"):
        for motor, joint in motors_on_joints(mujoco, model).items():
            gear = float(model.actuator_gear[motor, 0])
            felt = gear * gear * float(model.actuator_armature[motor])
            found[joint] = found.get(joint, 0.0) + felt
    return found


def _damping(mujoco: Any, model: Any) -> dict[int, tuple[float, float, float]]:
    """Return b, b1 and b2 of what damps each joint, -(b v + b1 v |v| + b2 v^3).

    Actuators do, too (newer MuJoCo), times the square of ``gear``, whatever the power.
    """
    found = {}
    off = int(model.opt.disableflags) & _flag(mujoco, "mjDSBL_DAMPER")
    for joint in range(model.njnt):
        dof = int(model.jnt_dofadr[joint])
        own = float(model.dof_damping[dof]), *_higher_coefficients(model, "dof_dampingpoly", dof)
        found[joint] = (0.0, 0.0, 0.0) if off else own
    if off or not hasattr(model, "actuator_damping"):
        return found
    for motor, joint in motors_on_joints(mujoco, model).items():
        felt = float(model.actuator_gear[motor, 0]) ** 2
        own = (
            float(model.actuator_damping[motor]),
            *_higher_coefficients(model, "actuator_dampingpoly", motor),
        )
        b, b1, b2 = found[joint]
        found[joint] = b + felt * own[0], b1 + felt * own[1], b2 + felt * own[2]
    return found


def _motors(mujoco: Any, model: Any) -> dict[int, Range]:
    """Return the summed range of torque [N m] or force [N] of each joint's motors."""
    found: dict[int, Range] = {}
    for motor, joint in acting_motors(mujoco, model).items():
        low, high = found.get(joint, (0.0, 0.0))
        own = _motor_force(mujoco, model, motor)
        found[joint] = low + own[0], high + own[1]
    return found


def _motor_force(mujoco: Any, model: Any, motor: int) -> Range:
    gear, force = float(model.actuator_gear[motor, 0]), UNBOUNDED
    if model.actuator_forcelimited[motor]:
        force = _range(model.actuator_forcerange[motor])
    dynamics = mujoco.mjtDyn  # activations of filters follow the control, and stay in its range
    followers = dynamics.mjDYN_NONE, dynamics.mjDYN_FILTER, dynamics.mjDYN_FILTEREXACT
    plain = (
        model.actuator_gaintype[motor] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[motor] == mujoco.mjtBias.mjBIAS_NONE
        and model.actuator_plugin[motor] < 0  # a PID's control is a position
    )
    first = int(getattr(model, "actuator_ctrladr", range(motor + 1))[motor])  # of its controls
    inputs = []  # force is in proportion to the control, or to the activation
    follows = int(model.actuator_dyntype[motor]) in map(int, followers)
    if follows and model.actuator_ctrllimited[first]:
        inputs.append(_range(model.actuator_ctrlrange[first]))
    if model.actuator_actlimited[motor]:
        inputs.append(_range(model.actuator_actrange[motor]))
    for given in inputs if plain else ():
        own = _scaled(given, float(model.actuator_gainprm[motor, 0]))
        low, high = max(force[0], own[0]), min(force[1], own[1])
        force = (low, high) if low <= high else force
    return _scaled(force, gear)


def _range(values: Any) -> Range:
    low, high = np.asarray(values, dtype=float).tolist()
    return low, high


def _scaled(range_: Range, by: float) -> Range:
    """Return a range times a number; of nothing, 0."""
    if by == 0.0:
        return 0.0, 0.0
    low, high = sorted((by * range_[0], by * range_[1]))
    return low, high


def unactuated_joints(part: RobotPart) -> tuple[str, ...] | None:
    """Return the joints that no motor drives; None if the file has no motors."""
    driven = {*acting_motors(part.mujoco, part.model).values()} & {*part.joints}
    return tuple(part.names.joints[k] for k in part.joints if k not in driven) if driven else None


def drive_notes(part: RobotPart, looped: bool, following: Collection[str] = ()) -> tuple[str, ...]:
    """Return notes of drives and forces of MuJoCo that are not used here.

    ``looped``: whether it has closed loops, in which joints without a motor stay unactuated, as
    those that are ``following`` others.
    """
    mine = {*part.joints}
    mujoco, model, names = part.mujoco, part.model, part.names
    every, acting = motors_on_joints(mujoco, model), acting_motors(mujoco, model)
    every = {k: joint for k, joint in every.items() if part.kind_of(joint) != "free"}
    notes = noted(
        "actuators that act on no single joint (tendons, sites, bodies, free joints) are not read:"
        " {}",
        [names.actuators[k] for k in actuators_of(model) if k not in every],
    )
    notes += noted(
        "actuators of groups that the file switches off, or whose gear is 0, drive nothing: {}",
        [names.actuators[k] for k in every if k not in acting],
    )
    notes += _disabled_notes(part) + _actuator_notes(part, [k for k in acting if acting[k] in mine])
    driven = {joint for joint in acting.values() if joint in mine}
    still = unactuated_joints(part)
    if still is None and looped:
        notes += ("the file has no motors: here each joint has one, but for unactuated=[...]",)
    here = "none does here, unless" if looped else "here each joint has one, but for"
    left = [name for name in still or () if name not in following]
    notes += noted(f"no motor of the file drives {{}}; {here} unactuated=[...]", left)
    pulls = _motors(mujoco, model)
    one_way = [names.joints[j] for j in sorted(driven) if _is_one_way(model, pulls[j], j)]
    notes += noted(
        "motors that the file lets pull one way only are taken to pull both ways: {}", one_way
    )
    unlike = [names.joints[j] for j in sorted(driven) if _is_asymmetric(model, pulls[j], j)]
    notes += noted(
        "motors that the file lets pull harder one way than the other are held to the smaller: {}",
        unlike,
    )
    weak = [names.joints[j] for j in sorted(driven) if _is_scaled(model, pulls[j], j)]
    notes += noted(
        "ranges of controls let motors give less than a tenth of what the file lets joints take"
        " (actuatorfrcrange): {}; where controls are parts of a torque, give effort={joint: N m}",
        weak,
    )
    base = [*part.floating_joints, *([part.root_joint] if part.floats else [])]
    rates = np.isin(model.dof_jntid, base)
    notes += tuple(
        f"the file gives the floating base {what}, which is not used"
        for what, given in (
            ("rotor inertia", model.dof_armature[rates]),
            ("damping", model.dof_damping[rates]),
            ("dry friction", model.dof_frictionloss[rates]),
            ("a spring", model.jnt_stiffness[base]),
            ("a range", model.jnt_limited[base]),
        )
        if np.any(given)
    )
    told = "tendons are not read (their springs, dampers and limits): {}"
    notes += noted(told, names.tendons)
    if model.opt.density or model.opt.viscosity:
        notes += ("the medium of the file (density, viscosity, wind) is not used",)
    return notes


def _actuator_notes(part: RobotPart, motors: Collection[int]) -> tuple[str, ...]:
    """Return notes of actuators of which the torque is not at once what is asked."""
    mujoco, model, names = part.mujoco, part.model, part.names
    # Dampers are those whose control multiplies the speed.
    other = [
        names.actuators[k]
        for k in motors
        if model.actuator_gaintype[k] == mujoco.mjtGain.mjGAIN_MUSCLE
        or (
            model.actuator_gaintype[k] == mujoco.mjtGain.mjGAIN_AFFINE
            and model.actuator_gainprm[k, 2] != 0.0
        )
    ]
    delays = getattr(model, "actuator_delay", np.zeros(len(actuators_of(model))))  # newer MuJoCo
    late = [
        names.actuators[k]
        for k in motors
        if delays[k] > 0.0 or model.actuator_dyntype[k] != mujoco.mjtDyn.mjDYN_NONE
    ]
    return (
        *noted("muscles and dampers are taken for motors that pull both ways: {}", other),
        *noted(
            "motors give their torque at once: delays and activations (delay, dyntype) are not"
            " used: {}",
            late,
        ),
    )


def _disabled_notes(part: RobotPart) -> tuple[str, ...]:
    """Return notes of features that the file disables and that are used here nevertheless."""
    bits, model = part.mujoco.mjtDisableBit, part.model
    disabled = int(model.opt.disableflags)
    no_limits = int(bits.mjDSBL_LIMIT) | int(bits.mjDSBL_CONSTRAINT)
    limited = any(model.jnt_limited[joint] for joint in part.joints)
    bounded = any(model.actuator_ctrllimited)
    told = (
        (bits.mjDSBL_ACTUATION, model.nu, "all motors off; here they act"),
        (bits.mjDSBL_CLAMPCTRL, bounded, "limits of controls off; here they bound efforts"),
        (no_limits, limited, "limits of joints off; here its ranges are kept"),
    )
    return tuple(
        f"the file switches {words}" for bit, has, words in told if disabled & int(bit) and has
    )


def _is_one_way(model: Any, pull: Range, joint: int) -> bool:
    """Return whether a joint's motors, within its force range, pull one way only."""
    ranges = (pull, _joint_force_range(model, joint))
    return any(low * high >= 0.0 and low != high for low, high in ranges)


def _is_asymmetric(model: Any, pull: Range, joint: int) -> bool:
    """Return whether they pull both ways, but harder in one than the symmetric limit."""
    taken = _joint_force_range(model, joint)
    least = min(_symmetric_limit(*pull), _symmetric_limit(*taken))
    low, high = max(pull[0], taken[0]), min(pull[1], taken[1])
    return low < 0.0 < high and max(-low, high) > least * (1.0 + 1e-9)


def _is_scaled(model: Any, pull: Range, joint: int) -> bool:
    """Return whether a joint takes so much more than its motors give that units may differ."""
    most = _symmetric_limit(*_joint_force_range(model, joint))
    return math.isfinite(most) and _symmetric_limit(*pull) < 0.1 * most


def passive_forces(part: RobotPart) -> PassiveForces:
    """Return the springs, gravity compensation and curved damping of the robot's part."""
    mujoco, model, names = part.mujoco, part.model, part.names
    disabled = int(model.opt.disableflags)
    sprung = not disabled & _flag(mujoco, "mjDSBL_SPRING")
    damping = _damping(mujoco, model)
    springs, curves = dict[str, Spring](), dict[str, tuple[float, float]]()
    for joint in part.joints:
        if part.kind_of(joint) == "ball":
            continue
        name = names.joints[joint]
        k = float(model.jnt_stiffness[joint])
        k1, k2 = _higher_coefficients(model, "jnt_stiffnesspoly", joint)
        if sprung and (k or k1 or k2):
            rest = float(model.qpos_spring[part.start_of(joint)])
            springs[name] = Spring(k, (k1, k2), rest)
        if any(curve := damping[joint][1:]):
            curves[name] = curve
    heavy = not disabled & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    heavy = heavy and bool(np.any(np.asarray(model.body_gravcomp) > 0.0))  # else MuJoCo skips it
    lifts = tuple(
        GravityCompensation(
            names.bodies[body],
            tuple(model.body_ipos[body].tolist()),
            float(model.body_gravcomp[body] * model.body_mass[body]),
        )
        for body in part.bodies
        if heavy and model.body_gravcomp[body]
    )
    return PassiveForces(springs, lifts, curves)


def _higher_coefficients(model: Any, field: str, index: int) -> tuple[float, float]:
    """Return the coefficients above the linear one, which only newer MuJoCo has."""
    values = getattr(model, field, None)
    if values is None:
        return 0.0, 0.0
    first, second = np.asarray(values[index], dtype=float)[:2].tolist()
    return first, second
