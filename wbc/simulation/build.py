"""A robot and its ground as a MuJoCo model, built from the robot's Pinocchio model.

Masses, CoMs and inertias are Pinocchio's to the last digits; armature, damping and dry friction of
the joints are those of the robot's model, and nothing is added: both mass matrices agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from wbc.errors import ModelError
from wbc.gait.arms import Arm
from wbc.gait.walls import WALL_THICKNESS
from wbc.robot import Robot, Snapshot
from wbc.robot.limits import BASE_NV
from wbc.simulation.mismatch import ModelMismatch, PrincipalInertia, true_inertias
from wbc.simulation.shapes import PLANE, STEP, ShapeOptions, add_shapes
from wbc.simulation.terrain import IMPEDANCE, Terrain
from wbc.validate import Array

PLANE_HALF_SIZE = 50.0  # m, as drawn; for contacts it is infinite
# Time constant with which a gear's error decays, critically damped, in physics steps.
GEAR_STEPS = 4.0
LEAST_TIME_CONSTANT = 2.0  # of contacts, in physics steps: MuJoCo's refsafe takes it for less
ROUNDING = 1e-9
GEAR_IMPEDANCE = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # MuJoCo's solimp of gears and loops
# MuJoCo's impratio: friction by normal stiffness. On a slope of 0.2 feet creep by 0.03 mm/s with
# MuJoCo's default of 1, by 0.001 with this.
FRICTION_STIFFNESS = 100.0
# Smallest eigenvalue of a mass matrix that can be integrated: iCub's neck turns about points and
# has 2e-17, all other robots 1.5e-5 and more. Real joints have rotors.
MIN_INERTIA = 1e-8  # kg m^2, or kg
WORLD_SITE = "world site"
# Geoms' names, the latter two with their numbers.
GROUND, BOX, WALL = "ground", "step ", "wall "
_UNLIMITED = 1e6  # in place of a limit that is missing on one side [rad or m]


class Sole(NamedTuple):
    """The frame of a foot's sole, in MuJoCo."""

    foot: str
    frame: str
    body: int  # MuJoCo's
    origin: Array  # (3,) in the body's frame [m]


@dataclass(frozen=True, eq=False)
class CompiledModel:
    """A compiled model, and the robot's parts by MuJoCo's indices."""

    model: Any  # mujoco.MjModel
    bodies: tuple[int, ...]  # MuJoCo's body of each Pinocchio joint (njoints); 0 for the world
    feet: tuple[str, ...]  # the foot of each geom of a sole; else empty
    links: tuple[str, ...]  # the link of each geom; empty for the ground, its steps and walls
    walls: frozenset[int]  # geoms that are walls
    forearms: frozenset[int]  # geoms that may lean on walls
    soles: tuple[Sole, ...]
    notes: tuple[str, ...]  # what was omitted, in words


def build(
    mujoco: Any,
    robot: Robot,
    terrain: Terrain,
    mismatch: ModelMismatch,
    shapes: ShapeOptions,
    physics_dt: float,
) -> CompiledModel:
    """Return the MuJoCo model of a robot on a terrain.

    Raises ModelError: MuJoCo refuses the robot, or some joints have no inertia; the message says
    why.
    """
    _check_inertias(robot)
    spec = mujoco.MjSpec()
    _set_options(mujoco, spec, robot, physics_dt)
    _add_terrain(mujoco, spec, terrain, mismatch.friction)
    inertias = true_inertias(robot, mismatch)
    bodies = _add_tree(mujoco, spec, robot, inertias)
    labels, notes = add_shapes(mujoco, spec, bodies, robot, shapes)
    least = LEAST_TIME_CONSTANT * physics_dt
    if terrain.time_constant < least * (1.0 - ROUNDING):
        notes += (
            f"the ground's contacts have a time constant of {least:g} s, twice physics_dt, as"
            f" MuJoCo allows no less; not {terrain.time_constant:g}",
        )
    _add_gears(mujoco, spec, robot, physics_dt)
    _add_loops(mujoco, spec, bodies, robot, physics_dt)
    _add_lifts(mujoco, spec, bodies, robot)
    try:
        model = spec.compile()
    except ValueError as error:
        raise ModelError(f"{robot.path}: MuJoCo refuses the robot: {error}") from error
    ids = [0] + [int(model.body(_body_name(j)).id) for j in range(1, robot.model.njoints)]
    _set_inertias(model, inertias, ids)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    names = [model.geom(k).name for k in range(model.ngeom)]
    geoms = [labels.get(name, ("", "")) for name in names]
    feet, links = zip(*geoms, strict=True)
    walls = frozenset(k for k, name in enumerate(names) if name.startswith(WALL))
    arms = {ids[j] for hand in shapes.hands for j in Arm.of(robot, hand.frame).forearm}
    forearms = frozenset(k for k in range(model.ngeom) if int(model.geom_bodyid[k]) in arms)
    return CompiledModel(model, tuple(ids), feet, links, walls, forearms, _soles(robot, ids), notes)


def _soles(robot: Robot, ids: Sequence[int]) -> tuple[Sole, ...]:
    soles = []
    for foot in robot.feet.values():
        frame = robot.frame(foot.frame)
        body = ids[int(frame.parentJoint)]
        soles.append(Sole(foot.name, foot.frame, body, np.array(frame.placement.translation)))
    return tuple(soles)


def _check_inertias(robot: Robot) -> None:
    """Refuse a robot whose mass matrix is singular: torques would accelerate without bound."""
    first = BASE_NV if robot.fixed_base else 0  # a fixed base may have no mass
    M = robot.snapshot(robot.postures["standing"]).mass_matrix[first:, first:]
    if not M.size:
        return
    eigenvalues, vectors = np.linalg.eigh(M)
    too_small = eigenvalues < MIN_INERTIA
    if too_small.any():
        parts = np.abs(vectors[BASE_NV - first :, too_small]).max(axis=1)
        joints = [name for name, part in zip(robot.joint_names, parts, strict=True) if part > 0.3]
        raise ModelError(
            f"{robot.path}: joint {', '.join(joints)} can turn without moving any mass (a moment of"
            f" {eigenvalues.min():.1g} kg m^2), which no physics can integrate; give the robot its"
            " rotors' inertia: Robot.load(..., armature=...)"
        )


def _set_options(mujoco: Any, spec: Any, robot: Robot, physics_dt: float) -> None:
    spec.modelname = robot.name
    spec.compiler.degree = False  # ranges are in rad
    spec.compiler.autolimits = False
    spec.option.timestep = physics_dt
    spec.option.gravity = robot.model.gravity.linear
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = FRICTION_STIFFNESS
    # A state that blew up is kept, to be reported, and not reset. Splitting the constraints into
    # islands takes a fifth of a step and finds one island, the robot.
    for flag in ("mjDSBL_AUTORESET", "mjDSBL_ISLAND"):
        if hasattr(mujoco.mjtDisableBit, flag):
            spec.option.disableflags |= int(getattr(mujoco.mjtDisableBit, flag))


def _add_terrain(mujoco: Any, spec: Any, terrain: Terrain, factor: float) -> None:
    quaternion = np.empty(4)
    mujoco.mju_quatZ2Vec(quaternion, terrain.normal)
    ground = spec.worldbody.add_geom(
        name=GROUND,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[PLANE_HALF_SIZE, PLANE_HALF_SIZE, 1.0],
        quat=quaternion,
    )
    _set_contact(ground, PLANE, terrain, factor * terrain.friction)

    def add_box(name: str, half: Array, centre: Array, R: Array, friction: float) -> None:
        kind, quaternion = mujoco.mjtGeom.mjGEOM_BOX, _quaternion(mujoco, R)
        box = spec.worldbody.add_geom(name=name, type=kind, size=half, pos=centre, quat=quaternion)
        _set_contact(box, STEP, terrain, factor * friction)

    for k, step in enumerate(terrain.steps):
        half, R = 0.5 * step.size, step.rotation
        friction = terrain.friction if step.friction is None else step.friction
        add_box(f"{BOX}{k}", half, step.centre - half[2] * R[:, 2], R, friction)
    for k, wall in enumerate(terrain.walls):
        half = np.array((0.5 * WALL_THICKNESS, *(0.5 * wall.size)))
        centre = wall.point - half[0] * wall.normal
        add_box(f"{WALL}{k}", half, centre, wall.rotation, wall.friction)


def _set_contact(geom: Any, kind: int, terrain: Terrain, friction: float) -> None:
    """Let a geom collide with the robot, with its own contact parameters."""
    geom.contype, geom.conaffinity, geom.priority, geom.condim = kind, 0, 1, 3
    geom.friction = [friction, 0.0, 0.0]  # sliding; neither torsional nor rolling
    geom.solref = [terrain.time_constant, 1.0]
    geom.solimp = [*IMPEDANCE, 0.5, 2.0]


def _body_name(joint: int) -> str:
    return f"body {joint}"  # links' names may be doubled, or "world"


def _add_tree(
    mujoco: Any, spec: Any, robot: Robot, inertias: Sequence[PrincipalInertia]
) -> list[Any]:
    """Add bodies and joints; return the bodies by Pinocchio's joints."""
    model, limits = robot.model, robot.limits
    neutral = robot.snapshot(robot.postures["neutral"])
    bodies = [spec.worldbody]
    for j in range(1, model.njoints):
        place = model.jointPlacements[j]
        body = bodies[int(model.parents[j])].add_body(
            name=_body_name(j),
            pos=np.array(place.translation),
            quat=_quaternion(mujoco, np.array(place.rotation)),
        )
        bodies.append(body)
        body.explicitinertial = True
        body.ipos, body.iquat = inertias[j].com, _quaternion(mujoco, inertias[j].axes)
        body.mass, body.inertia = 1.0, np.ones(3)  # placeholders; see _set_inertias
        if j == 1:
            if not robot.fixed_base:
                body.add_freejoint(name=str(model.names[1]))
            continue
        k = int(model.idx_vs[j]) - BASE_NV
        turns, axis = _joint_axis(neutral, j)
        joint = body.add_joint(
            name=str(model.names[j]),
            type=mujoco.mjtJoint.mjJNT_HINGE if turns else mujoco.mjtJoint.mjJNT_SLIDE,
            axis=axis,
            armature=float(robot.armature[k]),
        )
        _set_passive(joint, robot, str(model.names[j]), float(robot.damping[k]))
        joint.frictionloss = float(robot.friction[k])
        low, high = float(limits.lower[k]), float(limits.upper[k])
        if np.isfinite([low, high]).any():
            if not low < high:
                raise ModelError(
                    f"{robot.path}: joint {model.names[j]!r} cannot move between {low:g} and"
                    f" {high:g}; lock it: locked={{{str(model.names[j])!r}: {low:g}}}"
                )
            joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
            joint.range = [max(low, -_UNLIMITED), min(high, _UNLIMITED)]
    return bodies


def _set_passive(joint: Any, robot: Robot, name: str, damping: float) -> None:
    """Give a joint its damper and its spring."""
    curved = robot.passive.curved_damping.get(name, (0.0, 0.0))
    joint.damping = _polynomial(joint.damping, (damping, *curved))
    spring = robot.passive.springs.get(name)
    if spring is not None:
        joint.stiffness = _polynomial(joint.stiffness, (spring.stiffness, *spring.curved))
        joint.springref = spring.rest


def _polynomial(field: Any, coefficients: Sequence[float]) -> Any:
    """Return coefficients for a field, which is a scalar in older MuJoCo: then the first."""
    if np.ndim(field) == 0:
        return coefficients[0]
    values = np.zeros(np.shape(field))
    values[: len(coefficients)] = coefficients
    return values


def _add_lifts(mujoco: Any, spec: Any, bodies: Sequence[Any], robot: Robot) -> None:
    """Add gravity compensation of bodies: constant forces at sites.

    MuJoCo's own acts at the CoM of all bodies on one joint, of which some only may be compensated.
    """
    pull = -np.array(robot.model.gravity.linear)
    spec.worldbody.add_site(name=WORLD_SITE)
    for k, lift in enumerate(robot.passive.lifts):
        frame = robot.frame(lift.frame)
        place = frame.placement.act(np.array(lift.point))
        name = f"lift {k}"
        bodies[int(frame.parentJoint)].add_site(name=name, pos=place)
        motor = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_SITE)
        motor.target, motor.refsite = name, WORLD_SITE
        motor.gear = [*pull, 0.0, 0.0, 0.0]
        motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        motor.biasprm[0], motor.gainprm[0] = lift.mass, 0.0


def _joint_axis(s: Snapshot, joint: int) -> tuple[bool, Array]:
    """Return whether a joint turns, and its axis (3,) in its own frame."""
    twist = s.joint_twists[:, int(s.robot.model.idx_vs[joint])]
    turns = bool(np.linalg.norm(twist[3:]) > 0.5)
    axis = s.joint_placements[0][joint].T @ (twist[3:] if turns else twist[:3])
    return turns, axis / np.linalg.norm(axis)


def _quaternion(mujoco: Any, R: Array) -> Array:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(R).ravel())
    return quaternion


def _set_inertias(model: Any, inertias: Sequence[PrincipalInertia], ids: Sequence[int]) -> None:
    """Set masses and moments after compilation, as the compiler refuses some that files have.

    Links without mass between two joints, points, and moments that violate the triangle inequality
    by a digit do not disturb the physics; Robot.load noted them.
    """
    for inertia, body in zip(inertias[1:], ids[1:], strict=True):
        model.body_mass[body], model.body_inertia[body] = inertia.mass, inertia.moments


def _add_gears(mujoco: Any, spec: Any, robot: Robot, physics_dt: float) -> None:
    """Couple mimic joints to their drivers by stiff constraints."""
    for joint, coupling in robot.couplings.items():
        gear = spec.add_equality(name=f"gear of {joint}", type=mujoco.mjtEq.mjEQ_JOINT, name1=joint)
        gear.name2, gear.objtype = coupling.driver, mujoco.mjtObj.mjOBJ_JOINT
        data = np.zeros(np.shape(gear.data))
        data[:5] = coupling.offset, coupling.ratio, *coupling.curved
        gear.data = data
        gear.solref, gear.solimp = [GEAR_STEPS * physics_dt, 1.0], GEAR_IMPEDANCE


def _add_loops(
    mujoco: Any, spec: Any, bodies: Sequence[Any], robot: Robot, physics_dt: float
) -> None:
    """Couple the frames of loops, at sites, as stiffly as gears."""
    kinds = {"point": mujoco.mjtEq.mjEQ_CONNECT, "pose": mujoco.mjtEq.mjEQ_WELD}
    for name, loop in robot.loops.items():
        sites = [f"loop {name} {k}" for k in range(2)]
        for site, frame in zip(sites, map(robot.frame, loop.frames), strict=True):
            place = frame.placement
            quaternion = _quaternion(mujoco, np.array(place.rotation))
            body = bodies[int(frame.parentJoint)]
            body.add_site(name=site, pos=np.array(place.translation), quat=quaternion)
        equality = spec.add_equality(name=f"loop {name}", type=kinds[loop.kind])
        equality.name1, equality.name2, equality.objtype = *sites, mujoco.mjtObj.mjOBJ_SITE
        if loop.kind == "pose":
            data = np.zeros(np.shape(equality.data))
            data[10] = 1.0  # weight of rotation by that of translation
            equality.data = data
        equality.solref, equality.solimp = [GEAR_STEPS * physics_dt, 1.0], GEAR_IMPEDANCE
