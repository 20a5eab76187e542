"""Checks that refuse models which the controllers do not support, naming joint and link."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin

from wbc.errors import ModelError
from wbc.robot.limits import UNLIMITED
from wbc.robot.notes import noted
from wbc.validate import Array

FREE_FLYER, BALL = "JointModelFreeFlyer", "JointModelSpherical"
SINGLE_AXIS = frozenset(
    f"JointModel{name}"
    for name in (
        *("RX", "RY", "RZ", "RevoluteUnaligned"),
        *("RUBX", "RUBY", "RUBZ", "RevoluteUnboundedUnaligned"),
        *("PX", "PY", "PZ", "PrismaticUnaligned"),
    )
)
ROUNDING = 1e-6  # of a body's largest moment: files give inertias to about six digits
# Of the robot's own second moment. Romeo's forearms break the triangle inequality by 3e-4 (a digit
# is missing in the file); it does not show in the robot's inertia, so it is noted, not refused.
NEGLIGIBLE = 1e-3
LARGEST_SIZE, LARGEST_MASS = 20.0, 5000.0  # m, kg: beyond, the file is in other units
# rad: largest plausible median range of a robot's joints, a little more than two turns (continuous
# joints are written as 1.5 turns); and the range that stands for no limit.
MEDIAN_RANGE, NO_LIMIT = 13.0, 400.0
LARGEST_EFFORT = 1e5  # N m or N: of any robot's joint
LARGEST_SPEED = 120.0  # rad/s or m/s: of any robot's joint; wheels reach 111
LEAST_MEDIAN_RANGE = 0.06  # rad: smallest plausible one; 3.4 rad read as degrees
FEW_JOINTS = 6  # too few to tell a robot's size by their positions


def check_supported(model: pin.Model, path: Path) -> tuple[str, ...]:
    """Check a model after joints were locked, and return notes on what was tolerated.

    Raises ModelError: the root is not one free-flyer, a joint has not exactly one axis or moves no
    mass, or a body has an inertia that no rigid body can have. The message names joint and link.
    """
    _check_joints(model, path)
    notes = _check_masses(model, path) + _check_inertias(model, path)
    notes += _oversized_links(model) + _unit_notes(model) + _immobile_joints(model)
    return notes + _placeholder_limits(model)


def _check_joints(model: pin.Model, path: Path) -> None:
    on_world = [model.names[j] for j in range(1, model.njoints) if model.parents[j] == 0]
    if len(on_world) != 1 or model.joints[1].shortname() != FREE_FLYER:
        raise ModelError(
            f"{path}: expected a single free-flyer at the root, found {', '.join(on_world)};"
            " describe one floating robot"
        )
    for joint in range(2, model.njoints):
        kind = model.joints[joint].shortname()
        if kind not in SINGLE_AXIS:
            ball = (
                "; an MjModel is compiled and cannot be changed: of its file or MjSpec a ball"
                " joint is read as three hinges, if no other joint of its body follows it"
            )
            raise ModelError(
                f"{path}: joint {model.names[joint]!r} is a {kind.removeprefix('JointModel')}"
                " joint, which is not supported; use revolute and prismatic joints, one for each"
                f" body, and none floating but the root{ball if kind == BALL else ''}"
            )


def _check_masses(model: pin.Model, path: Path) -> tuple[str, ...]:
    """Refuse masses that are not positive, but for a link that only joins two joints."""
    data = model.createData()
    pin.computeSubtreeMasses(model, data)
    empty, bare = list[str](), list[int]()
    for joint in range(1, model.njoints):
        body, where = model.inertias[joint], _where(model, joint, path)
        if not np.isfinite(body.toDynamicParameters()).all():
            raise ModelError(f"{where}: mass or inertia is not finite; correct it")
        if body.mass < 0.0:
            raise ModelError(f"{where}: negative mass {body.mass:g} kg; correct it")
        if data.mass[joint] <= 0.0 and joint == 1:
            raise ModelError(
                f"{path}: no link has a mass, as in files that are only drawn; give each moving"
                " link its mass and inertia"
            )
        if data.mass[joint] <= 0.0:
            bare.append(joint)
        elif body.mass == 0.0 and joint > 1:  # the root is between none
            empty.append(link_of(model, joint))
    if bare:
        raise ModelError(
            f"{_where(model, bare[0], path)}: what the joint moves has no mass; give the link its"
            f" mass, or make the joint fixed, or {_locked(model, bare)}"
        )
    return noted("links without mass between two joints: {}", empty, len(empty))


def _check_inertias(model: pin.Model, path: Path) -> tuple[str, ...]:
    """Check that each body's second moment is that of some distribution of mass (theory 2)."""
    data = model.createData()
    pin.ccrba(model, data, pin.neutral(model), np.zeros(model.nv))
    whole = float(np.trace(data.Ig.inertia)) / 2  # trace of the robot's second moment
    points, broken, impossible = list[str](), list[str](), dict[str, list[int]]()
    for joint in range(1, model.njoints):
        moments = np.linalg.eigvalsh(model.inertias[joint].inertia)
        spread = moments.sum() / 2 - moments[2]  # least eigenvalue of the second moment
        link = link_of(model, joint)
        if moments[0] < -max(ROUNDING * abs(moments[2]), 1e-15):
            impossible.setdefault("a principal moment of inertia is negative", []).append(joint)
        elif moments[2] < 1e-15:  # kg m^2: iCub writes 1e-18 for nothing
            points += [link] if model.inertias[joint].mass > 0.0 else []
        elif spread < -NEGLIGIBLE * whole:
            impossible.setdefault("the triangle inequality is broken", []).append(joint)
        elif spread < -ROUNDING * moments[2]:
            broken.append(link)
    for reason, joints in impossible.items():
        _refuse_inertia(model, joints, path, reason)
    told = "links without rotational inertia, taken as points: {}"
    return noted(told, points, len(points)) + noted(
        "links whose moments of inertia break the triangle inequality, too little to matter for the"
        " whole robot: {}",
        broken,
        len(broken),
    )


def _oversized_links(model: pin.Model) -> tuple[str, ...]:
    """Note links whose inertia implies a size larger than the robot's, as 1 kg m^2 by default.

    Their radius of gyration is compared with the largest distance between joints or centres of mass
    in the neutral posture; of few joints, with that of the largest robot.
    """
    places, size = _places(model), LARGEST_SIZE
    if model.njoints > FEW_JOINTS + 2:  # besides the universe and the root
        size = 2.0 * float(np.linalg.norm(places - places.mean(axis=0), axis=1).max())
    links = [
        link_of(model, joint)
        for joint, body in enumerate(list(model.inertias)[1:], 1)
        if body.mass > 0.0 and np.linalg.eigvalsh(body.inertia)[2] > body.mass * size**2
    ]
    return noted(
        "links whose moments of inertia are those of bodies larger than the whole robot, as if"
        " placeholders, or other units than kg m^2, stood in the file: {}; what moves will not move"
        " so",
        links,
    )


def _places(model: pin.Model) -> Array:
    """Return where joints and the centres of mass of what they carry are in the neutral posture."""
    data = model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    bodies = list(zip(data.oMi, model.inertias, strict=True))[1:]
    return np.array([p for at, body in bodies for p in (at.translation, at.act(body.lever))])


def _unit_notes(model: pin.Model) -> tuple[str, ...]:
    """Note implausible sizes, as of files in millimetres, grams or degrees."""
    size = float(np.ptp(_places(model), axis=0).max())
    mass = float(pin.computeTotalMass(model))
    notes = []
    if size > LARGEST_SIZE:
        notes.append(
            f"its joints and centres of mass are up to {size:.3g} m apart: are lengths in"
            " millimetres?"
        )
    if mass > LARGEST_MASS:
        notes.append(f"it weighs {mass:.3g} kg: are masses in grams?")
    turning = [
        model.idx_qs[j]
        for j in range(2, model.njoints)
        if model.nqs[j] == 1 and not model.joints[j].shortname().startswith("JointModelP")
    ]
    farthest = np.maximum(-model.lowerPositionLimit[turning], model.upperPositionLimit[turning])
    farthest = farthest[farthest < NO_LIMIT]
    if farthest.size and np.median(farthest) > MEDIAN_RANGE:
        notes.append(
            f"half of its joints turn by {np.median(farthest):.3g} rad and more: are limits in"
            " degrees?"
        )
    turned = farthest[farthest > 0.0]
    if turned.size and np.median(turned) < LEAST_MEDIAN_RANGE:
        notes.append(
            f"half of its joints turn by {np.median(turned):.2g} rad and less: are limits in"
            ' radians, and angles of the file in degrees (<compiler angle="radian"/>)?'
        )
    return tuple(notes)


def _immobile_joints(model: pin.Model) -> tuple[str, ...]:
    """Note joints that cannot move, as exporters write where no limits were entered."""
    held = [
        f"{model.names[j]} at {model.lowerPositionLimit[model.idx_qs[j]]:g}"
        for j in range(2, model.njoints)
        if model.nqs[j] == 1
        and model.lowerPositionLimit[model.idx_qs[j]] == model.upperPositionLimit[model.idx_qs[j]]
    ]
    return noted("limits leave these joints no range: {}", held)


def _placeholder_limits(model: pin.Model) -> tuple[str, ...]:
    """Note limits that bound nothing, such as the 1e9 that Gazebo's models have."""
    notes = list[str]()
    for kind, limits, largest, unit in (
        ("effort", model.effortLimit, LARGEST_EFFORT, ""),
        ("speed", model.velocityLimit, LARGEST_SPEED, " or are in degrees"),
    ):
        vast = [
            f"{model.names[j]} {limits[model.idx_vs[j]]:g}"
            for j in range(2, model.njoints)
            if largest < limits[model.idx_vs[j]] < UNLIMITED
        ]
        notes += noted(f"{kind} limits in the file that bound nothing{unit}: {{}}", vast)
    return tuple(notes)


def _refuse_inertia(model: pin.Model, joints: Sequence[int], path: Path, reason: str) -> None:
    """Raise ModelError about the inertias of ``joints``' links, the first with its numbers."""
    moments = ", ".join(f"{m:.4g}" for m in np.linalg.eigvalsh(model.inertias[joints[0]].inertia))
    others = ", ".join(link_of(model, joint) for joint in joints[1:])
    also = f"; likewise {others}" if others else ""
    raise ModelError(
        f"{_where(model, joints[0], path)}: {reason} (principal moments {moments} kg m^2); no rigid"
        " body has such an inertia: correct it (is it about the centre of mass, in the axes of the"
        f" inertial origin?){also}"
    )


def check_joint_inertia(model: pin.Model, path: Path) -> None:
    """Refuse a joint without inertia about its axis, as of a point mass on it, and no rotor's."""
    felt = np.diag(pin.crba(model, model.createData(), pin.neutral(model)))  # with the armature
    least = 1e-12  # kg m^2, far below any real part
    bare = [joint for joint in range(2, model.njoints) if felt[model.idx_vs[joint]] < least]
    if bare:
        raise ModelError(
            f"{_where(model, bare[0], path)}: nothing it moves has inertia about its axis; give the"
            f" link an inertia or the joint an armature, or {_locked(model, bare)}"
        )


def _locked(model: pin.Model, joints: Sequence[int]) -> str:
    """Return the advice to lock joints, each at 0 or at its limit nearest to it."""
    lower, upper = model.lowerPositionLimit, model.upperPositionLimit
    places = [(model.names[joint], model.idx_qs[joint]) for joint in joints]
    held = ", ".join(f"{name!r}: {np.clip(0.0, lower[q], upper[q]):g}" for name, q in places)
    return f"lock every such joint: locked={{{held}}}"


def link_of(model: pin.Model, joint: int) -> str:
    """Return the name of the (first) link that a joint carries."""
    for frame in model.frames:
        if frame.parentJoint == joint and frame.type == pin.FrameType.BODY:
            return str(frame.name)
    return "unnamed"


def _where(model: pin.Model, joint: int, path: Path) -> str:
    named = f"joint {model.names[joint]!r}, " if joint > 1 else ""  # the root's is not the file's
    return f"{path}: {named}link {link_of(model, joint)!r}"
