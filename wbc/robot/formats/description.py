"""A robot description as read from a file, and joints locked in it."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np
import pinocchio as pin

from wbc.errors import ModelError, nearest
from wbc.robot.formats.couplings import DEGREE, Coupling, Loop
from wbc.robot.formats.triangles import Surfaces
from wbc.robot.limits import JointLimits
from wbc.robot.names import matching
from wbc.robot.passive import NO_FORCES, PassiveForces
from wbc.validate import Array, finite_number

State = Mapping[str, tuple[float, ...]]  # joint name -> its coordinates in q

DRIVER_RANGE, DRIVER_SAMPLES = 1e3, 1001  # rad or m; number of driver positions that are tried
ROUNDING = 1e-3  # rad or m: by which files may round what two coupled joints reach
RESERVED = frozenset({"universe", "root_joint"})
MOST_JOINTS = 160  # moving ones; Pinocchio's memory and time grow with their cube


def check_joint_count(count: int, path: Path) -> None:
    """Refuse a robot with too many joints."""
    if count > MOST_JOINTS:
        raise ModelError(f"{path}: {count} moving joints; at most {MOST_JOINTS} are supported")


def refuse_reserved(joints: Iterable[str], path: Path) -> None:
    """Refuse moving joints with the names that Pinocchio gives the world or the floating base."""
    if taken := sorted({*joints} & RESERVED):
        raise ModelError(
            f"{path}: a moving joint is called {taken[0]!r}, which is the name of the world or of"
            " the floating base; give it another name"
        )


@contextmanager
def pinocchio_reads(path: Path, failure: str) -> Iterator[None]:
    """Turn what Pinocchio's parsers raise into a ModelError that begins with ``failure``."""
    try:
        yield
    except (ValueError, RuntimeError, LookupError, MemoryError) as error:
        told = str(error).rpartition("message:")[2]  # without the place in Pinocchio's source
        raise ModelError(f"{path}: {failure}: {' '.join(told.split())}") from error


def confirm(
    model: pin.Model, masses: Mapping[str, float], joints: Iterable[str], path: Path
) -> None:
    """Compare Pinocchio's model with an independent reading of the file.

    ``masses``: what each moving joint in the file carries up to the next ones [kg], by its name,
    ``""`` for the root; ``joints``: names of the moving joints in the file.
    """
    if lost := sorted({*joints} - {*model.names}):
        raise ModelError(f"{path}: joints {', '.join(map(repr, lost[:5]))} were not read")
    total = math.fsum(masses.values())
    read = float(pin.computeTotalMass(model))
    if not abs(read - total) <= 1e-9 * total:
        raise ModelError(f"{path}: the masses sum to {total:g} kg, but {read:g} kg were read")
    for name, mass in masses.items():
        carried = float(model.inertias[model.getJointId(name) if name else 1].mass)
        if not abs(carried - mass) <= 1e-9 * mass:
            what = f"joint {name!r} carries" if name else "the root weighs"
            raise ModelError(f"{path}: {what} {mass:g} kg, but {carried:g} kg were read")


@dataclass(frozen=True)
class ContactRules:
    """A description's rules for pairs that may collide."""

    excluded: frozenset[frozenset[str]] = frozenset()  # pairs of links that never collide
    # Pairs of shapes, by name, that are always watched.
    watched: frozenset[frozenset[str]] = frozenset()
    # Shapes that collide only as such a pair names.
    paired_only: frozenset[str] = frozenset()


NO_RULES = ContactRules()


class GeometrySource(Protocol):
    """Where the shapes of a robot come from; meshes are slow to load, hence on demand."""

    @property
    def missing_shapes(self) -> tuple[str, ...]:
        """Collision shapes of the file that are missing, in words."""
        ...

    @property
    def rules(self) -> ContactRules:
        """The file's rules for pairs of links and shapes."""
        ...

    def content(self) -> Iterable[bytes]:
        """Yield all data of the shapes: the text, the bytes of each mesh file.

        Raises OSError: a mesh cannot be read.
        """
        ...

    def surfaces(
        self, model: pin.Model, kind: pin.GeometryType, links: Collection[str] | None = None
    ) -> Surfaces:
        """Return the shapes of ``kind``, placed on ``model``, of all links or only of ``links``.

        Meshes are triangles, which :func:`~wbc.robot.formats.triangles.with_meshes` puts in.
        ``model`` may have joints locked since it was read: links keep their frames.

        Raises ModelError: a mesh exists but cannot be read.
        """
        ...


@dataclass(frozen=True)
class Description:
    """The content of one URDF or MJCF file."""

    name: str  # the robot's name in the file
    path: Path  # the file
    model: pin.Model  # kinematics and inertias, all joints free; joint 1 is the free-flyer
    geometry: GeometrySource  # loads the collision or visual shapes when asked
    # Joints that the file ties to another one (mimic or equality).
    coupled: Mapping[str, Coupling] = field(default_factory=dict)
    # Named configurations the file holds (MJCF key frames).
    states: Mapping[str, State] = field(default_factory=dict)
    # Where the file puts the root body, as a free-flyer's q (x, y, z, quaternion x, y, z, w).
    base: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    # Why the root is bolted to the world unless it has feet; empty if the file does not tell, None
    # if the file says that the root floats.
    bolted: str | None = ""
    mounted: bool = False  # whether the root moves by joints of its own, on a base without mass
    notes: tuple[str, ...] = ()  # what was tolerated, in words
    passive: PassiveForces = NO_FORCES  # springs and the like of all joints
    loops: Mapping[str, Loop] = field(default_factory=dict)
    on_world: tuple[str, ...] = ()  # those with an end on the world, which is the root's here
    # Joints that no motor drives; None if the file does not tell.
    unactuated: tuple[str, ...] | None = None
    # The file's initial joint positions, from which loops may be closed.
    drawn: State = field(default_factory=dict)


def lock_joints(
    description: Description, locked: Mapping[str, float]
) -> tuple[pin.Model, dict[str, Coupling]]:
    """Return a new model in which the given joints are rigid, and the couplings of its joints.

    A joint that follows a locked one is locked too. Couplings name drivers that follow none.

    ``locked``: joint name or pattern to the value [rad or m] at which it is held; later entries
    win.

    Raises UnknownNameError: no such joint; InvalidInputError: a value that is not finite or outside
    the joint's limits; ModelError: a coupling beyond degree 4, in a circle, or of joints that turn
    without end.
    """
    model = description.model
    names = [name for name, nv in zip(model.names, model.nvs, strict=True) if nv == 1]
    locked = {
        names[k]: value
        for pattern, value in locked.items()
        for k in matching(pattern, names, "joint to lock")
    }
    couplings, limits = dict[str, Coupling](), JointLimits.of(model)
    for joint in description.coupled:
        if joint in locked:
            continue
        coupling = _final_driver(description, joint, locked)
        if coupling.is_constant:
            locked[joint] = _constant(description.path, limits, joint, coupling.offset)
        elif coupling.driver in locked:
            value = finite_number(f"joint {coupling.driver!r}", locked[coupling.driver])
            locked[joint] = coupling.value(value)
        else:
            _check_reach(description.path, limits, joint, coupling)
            couplings[joint] = coupling
    if not locked:
        return model.copy(), couplings
    reference = pin.neutral(model)
    for name, value in locked.items():
        limits.set_joint(reference, name, value)
    return reduced_model(model, [*locked], reference), couplings


def _check_reach(path: Path, limits: JointLimits, joint: str, coupling: Coupling) -> None:
    """Refuse a mimic joint that its driver never moves within its own limits.

    Raises ModelError: no position of the driver is one at which both are within their limits.
    """
    driver, own = limits.names.index(coupling.driver), limits.names.index(joint)
    low, high = max(limits.lower[driver], -DRIVER_RANGE), min(limits.upper[driver], DRIVER_RANGE)
    values = coupling.polynomial(
        np.linspace(low, high, 2 if coupling.is_linear else DRIVER_SAMPLES)
    )
    least, most = float(values.min()), float(values.max())
    if least > limits.upper[own] + ROUNDING or most < limits.lower[own] - ROUNDING:
        raise ModelError(
            f"{path}: joint {joint!r} follows {coupling.driver!r} to {least:g} or more"
            f" and {most:g} or less, outside its own limits [{limits.lower[own]:g},"
            f" {limits.upper[own]:g}]; correct limits, ratio or offset"
        )


def _constant(path: Path, limits: JointLimits, joint: str, value: float) -> float:
    """Return the value at which a file holds a joint, within its limits."""
    k = limits.names.index(joint) if joint in limits.names else -1
    if k < 0 or abs(limits.nearest(k, value) - value) > 1e-6:
        raise ModelError(
            f"{path}: joint {joint!r} is held at {value:g} by an equality constraint,"
            " outside its limits; correct either"
        )
    return value


def reduced_model(model: pin.Model, locked: Iterable[str], reference: Array) -> pin.Model:
    """Return a model without some joints; links may have joints' names.

    Pinocchio looks frames up by name alone there, so they are renamed meanwhile.
    """
    plain = model.copy()
    names = dict[str, str]()
    for k, frame in enumerate(plain.frames):
        if frame.type != pin.FrameType.JOINT and k > 0:
            names[f"{k}\n"] = str(frame.name)
            frame.name = f"{k}\n"
    ids = [model.getJointId(name) for name in locked]
    found = pin.buildReducedModel(plain, ids, reference)
    for k, frame in enumerate(found.frames):
        if frame.parentFrame == k > 0:  # Pinocchio hangs the frames of locked joints on themselves
            above = plain.frames[plain.getFrameId(frame.name)].parentFrame
            frame.parentFrame = found.getFrameId(plain.frames[above].name)
    for frame in found.frames:
        frame.name = names.get(str(frame.name), str(frame.name))
    return found


def _final_driver(description: Description, joint: str, locked: Mapping[str, float]) -> Coupling:
    """Return a joint's coupling to its final driver: one that follows none, or a locked one."""
    found, seen = Coupling(joint), [joint]
    while found.driver in description.coupled and found.driver not in locked:
        step = description.coupled[found.driver]
        if step.is_constant:
            return Coupling("", 0.0, found.value(step.offset))
        after = found.after(step)
        why = _why_uncoupled(description.model, joint, step.driver)
        if after is None:
            why = f"together that is a polynomial beyond degree {DEGREE}"
        elif step.driver in seen:
            why = "these follow each other in a circle"
        if after is None or why:
            remedy = ", ".join(f"{name!r}: 0.0" for name in _joints_to_lock(description, {*locked}))
            raise ModelError(
                f"{description.path}: joint {joint!r} is coupled to {step.driver!r} (mimic or"
                f" equality), but {why}; or lock every such joint: locked={{{remedy}}}"
            )
        found = after
        seen.append(step.driver)
    return found


def _why_uncoupled(model: pin.Model, *joints: str) -> str:
    """Return why joints cannot be coupled, in words; empty if all have one coordinate."""
    for name in joints:
        if not model.existJointName(name):
            meant = nearest(name, [one for one in list(model.names)[2:] if one not in joints])
            return f"there is no joint {name!r}" + (f" ({meant!r}?)" if meant else "")
        if model.nqs[model.getJointId(name)] > 1:
            return f"{name!r} turns without end: give it limits (revolute, not continuous)"
    return ""


def _joints_to_lock(description: Description, locked: Collection[str]) -> list[str]:
    """Return the joints to lock so that every other mimic joint can follow its driver."""
    found = list[str]()
    for joint in sorted({*description.coupled} - {*locked}):
        name, seen = joint, [joint]
        while name in description.coupled and name not in locked:
            name = description.coupled[name].driver
            if not name:  # a constant
                break
            if name in seen or _why_uncoupled(description.model, joint, name):
                found.append(joint)
                break
            seen.append(name)
    return found
