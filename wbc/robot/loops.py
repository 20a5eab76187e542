"""Closed loops of a robot: two frames of its tree that are one, as points or as a whole.

Loops are closed in three places: in postures, before they are used (here); in ticks, by rows that
are met exactly (:mod:`wbc.constraints.mechanics`); and in the simulated plant.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from wbc.errors import InvalidInputError, UnknownNameError, listed, shown
from wbc.robot.formats.couplings import Coupling, Loop
from wbc.robot.limits import BASE_NV, JointLimits
from wbc.robot.names import frame_table, matching
from wbc.rotations import log_rotation
from wbc.spatial import skew
from wbc.validate import Array, by_name

KINDS = ("point", "pose")
CLOSED_GAP = 1e-9  # m, rad: a posture with larger gaps is open; Newton's method leaves 1e-15
ROUNDING = 1e-14  # gaps below this do not get smaller
STEPS, HALVINGS = 200, 12  # of Newton's method, and of a step that makes gaps larger
LONGEST_STEP = 0.5  # rad or m: largest motion of a joint in a step


def loops_of(given: Mapping[str, Loop | Mapping[str, Any] | Sequence[str]]) -> dict[str, Loop]:
    """Return loops by name, from what a user writes: a :class:`Loop`, its fields, or two frames.

    Raises InvalidInputError: not two frames, or an unknown key; UnknownNameError: another kind than
    ``point`` or ``pose``.
    """
    return {name: _loop(f"loop {name!r}", one) for name, one in by_name("loops", given).items()}


def _loop(what: str, given: Any) -> Loop:
    frames, kind = given, KINDS[0]
    if isinstance(given, Loop):
        frames, kind = given.frames, given.kind
    elif isinstance(given, Mapping):
        if set(given) - {"frames", "kind"}:
            raise InvalidInputError(f"{what}: expected frames and kind, got {shown(given)}")
        frames, kind = given.get("frames"), given.get("kind", KINDS[0])
    if isinstance(frames, str) or not isinstance(frames, Sequence) or len(frames) != 2:
        raise InvalidInputError(f"{what}: expected two frames, got {shown(frames)}")
    if frames[0] == frames[1]:
        raise InvalidInputError(f"{what}: {shown(frames[0])} is both frames; name another")
    if kind not in KINDS:
        raise UnknownNameError(f"kind of {what}", kind, KINDS)
    return Loop((frames[0], frames[1]), kind)


@dataclass(frozen=True, eq=False)
class Closure:
    """The loops and gears of a model, and the configurations that meet them."""

    model: pin.Model
    limits: JointLimits
    loops: Mapping[str, Loop]
    couplings: Mapping[str, Coupling]
    unactuated: tuple[str, ...] = ()  # joints without a motor, which move first
    springs: Collection[str] = ()  # joints with springs

    @cached_property
    def _frames(self) -> dict[str, int]:
        return frame_table(self.model)

    @cached_property
    def sprung(self) -> tuple[str, ...]:
        """The joints that springs alone hold, which move after the others."""
        return tuple(joint for joint in self.unactuated if joint in self.springs)

    @property
    def binds(self) -> bool:
        """Whether there are loops or gears."""
        return bool(self.loops or self.couplings)

    def gaps(self, q: Array) -> dict[str, float]:
        """Return how far each loop is open at ``q`` (nq,): the largest entry of its error."""
        if not self.loops:
            return {}
        errors, _ = self.errors(q)
        sizes = [3 if loop.kind == "point" else 6 for loop in self.loops.values()]
        parts = np.split(errors, np.cumsum(sizes))
        return {
            name: float(np.abs(part).max()) for name, part in zip(self.loops, parts, strict=False)
        }

    def closed(self, q: Array, kept: Sequence[str] = ()) -> Array:
        """Return the configuration near ``q`` (nq,) at which all loops are closed, within limits.

        By Newton's method: joints without a motor move first, those with springs after the others,
        then all but ``kept``, as little as possible. Mimic joints go along.

        Raises InvalidInputError: they cannot be closed; the message says which loops are how far
        open.
        """
        names = self.limits.names
        passive = {*self.unactuated, *self.couplings}
        rest = [k for k, name in enumerate(names) if name not in kept]
        first = [k for k in rest if names[k] in passive]
        loose = [k for k in first if names[k] not in self.sprung]
        found = q
        for columns in (loose, first, rest):
            if not columns and columns is not rest:
                continue
            found = self._minimise_gaps(q, np.array(columns, dtype=int))
            if np.abs(self.errors(found)[0]).max() <= CLOSED_GAP:
                return found
        gaps = [f"{name} by {by:.3g}" for name, by in self.gaps(found).items() if by > CLOSED_GAP]
        where = f"open: {listed(gaps)} m or rad at the nearest" if gaps else self._open_gears(found)
        raise InvalidInputError(
            f"loops: no posture near it closes them ({where}); begin nearer, or look at the loops'"
            " frames and the joints' limits"
            if self.loops
            else f"{where}: that is beyond its limits, or another value is given; give others"
        )

    def _open_gears(self, q: Array) -> str:
        """Return which mimic joints are off their drivers' polynomials, in words."""
        positions, names = self.limits.joint_positions(q), self.limits.names
        return "; ".join(
            f"{joint!r} cannot follow {one.driver!r} to {wanted:.4g}"
            for joint, one in self.couplings.items()
            if abs(
                (wanted := one.value(float(positions[names.index(one.driver)])))
                - positions[names.index(joint)]
            )
            > CLOSED_GAP
        )

    # ------------------------------------------------------------------ Newton's method

    def _minimise_gaps(self, q: Array, columns: Array) -> Array:
        """Return the configuration near ``q`` of least errors, moving only some joints."""
        q, (error, J) = q.copy(), self.errors(q)
        for _ in range(STEPS):
            if float(np.abs(error).max()) <= ROUNDING:
                break
            step = self._gauss_newton_step(q, error, J, columns)
            size = float(np.abs(step).max())
            if size <= ROUNDING:
                break
            step *= min(1.0, LONGEST_STEP / size)
            for _ in range(HALVINGS):
                there = self.limits.clamped(pin.integrate(self.model, q, step))
                then = self.errors(there)
                if np.linalg.norm(then[0]) < np.linalg.norm(error):
                    break
                step = 0.5 * step
            else:
                break
            q, (error, J) = there, then
        return q

    def _gauss_newton_step(self, q: Array, error: Array, J: Array, columns: Array) -> Array:
        """Return the least step (nv,) that closes the gaps to first order, or nearly.

        Damped by their size, which keeps the order of convergence. Joints at a limit that the step
        would cross stay there.
        """
        positions = self.limits.joint_positions(q)
        below, above = self.limits.lower + ROUNDING, self.limits.upper - ROUNDING
        step, free = np.zeros(self.model.nv), columns
        while free.size:
            own = J[:, BASE_NV + free]
            damping = min(1e-2, float(np.linalg.norm(error))) * max(1e-6, np.abs(own).max())
            rows = np.concatenate((own, damping * np.eye(free.size)))
            target = np.concatenate((-error, np.zeros(free.size)))
            found = np.linalg.lstsq(rows, target, rcond=1e-12)[0]
            stuck = ((positions[free] <= below[free]) & (found < 0.0)) | (
                (positions[free] >= above[free]) & (found > 0.0)
            )
            if not stuck.any():
                step[BASE_NV + free] = found
                return step
            free = free[~stuck]
        return step

    def errors(self, q: Array) -> tuple[Array, Array]:
        """Return the errors of loops and gears at ``q``, and their Jacobian (k, nv)."""
        model, data = self.model, self.model.createData()
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        frames, world = self._frames, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        errors: list[Array] = [np.zeros(0)]
        rows: list[Array] = [np.zeros((0, model.nv))]
        for loop in self.loops.values():
            (pose, J), (other, back) = (
                (data.oMf[index], pin.getFrameJacobian(model, data, index, world))
                for index in (frames[name] for name in loop.frames)
            )
            error, jacobian = gap_of(
                *((pose.translation, pose.rotation, J), (other.translation, other.rotation, back))
            )
            size = 3 if loop.kind == "point" else 6
            errors.append(error[:size])
            rows.append(jacobian[:size])
        positions = self.limits.joint_positions(q)
        for name, coupling in self.couplings.items():
            k, driver = self.limits.names.index(name), self.limits.names.index(coupling.driver)
            row = np.zeros((1, model.nv))
            row[0, BASE_NV + k], row[0, BASE_NV + driver] = 1.0, -coupling.slope(positions[driver])
            errors.append(np.array((positions[k] - coupling.value(positions[driver]),)))
            rows.append(row)
        return np.concatenate(errors), np.concatenate(rows)


# Origin (3,), rotation (3, 3), Jacobian (6, nv), world axes.
FrameState = tuple[Array, Array, Array]


def gap_of(frame: FrameState, other: FrameState) -> tuple[Array, Array]:
    """Return a frame's pose in another frame (6,) [m, rad], and its Jacobian (6, nv).

    R_o' (p - p_o) above log(R_o' R); in axes of the other frame the base moves neither. The
    derivative of a rotation vector e is Jlog(e) w, not w = R_o' (w_f - w_o); but Jlog(e) e = e, so
    rows w = -k e are equivalent to those of Jlog w, as for contacts.
    """
    (p, R, J), (p_other, R_other, back) = frame, other
    linear = J[:3] - back[:3] + skew(p - p_other) @ back[3:]
    jacobian = np.concatenate((R_other.T @ linear, R_other.T @ (J[3:] - back[3:])))
    gap = np.concatenate((R_other.T @ (p - p_other), log_rotation(R_other.T @ R)))
    return gap, jacobian


def without_motors(names: Sequence[str], given: Sequence[str]) -> tuple[str, ...]:
    """Return the joints that ``given`` names or patterns mean, in order.

    Raises UnknownNameError: a pattern that matches no joint.
    """
    if isinstance(given, str) or not isinstance(given, Sequence):
        raise InvalidInputError(f"unactuated: expected a list of joints, got {shown(given)}")
    found = {k for pattern in given for k in matching(pattern, names)}
    return tuple(name for k, name in enumerate(names) if k in found)


def loops_within(
    model: pin.Model, loops: Mapping[str, Loop]
) -> tuple[dict[str, Loop], tuple[str, ...]]:
    """Return the loops that move after joints were locked, and notes of those that do not.

    Raises UnknownNameError: a loop of a frame that is not there; InvalidInputError: a loop whose
    frames one body carries, and that is open there.
    """
    frames, moving, notes = frame_table(model), dict[str, Loop](), list[str]()
    for name, loop in loops.items():
        for frame in loop.frames:
            if not isinstance(frame, str) or frame not in frames:
                raise UnknownNameError(f"frame of loop {name!r}", frame, frames)
        one, other = (model.frames[frames[frame]] for frame in loop.frames)
        if one.parentJoint != other.parentJoint:
            moving[name] = loop
            continue
        gap = other.placement.actInv(one.placement)
        open_by = float(np.abs(gap.translation).max())
        if loop.kind == "pose":
            open_by = max(open_by, float(np.abs(log_rotation(gap.rotation)).max()))
        if open_by > 1e-6:
            raise InvalidInputError(
                f"loop {name!r}: one rigid body carries {loop.frames[0]!r} and"
                f" {loop.frames[1]!r}, which are {open_by:.3g} m or rad apart; lock joints where"
                " they meet, or leave the loop out"
            )
        notes.append(f"loop {name!r} is rigid, with its joints locked")
    return moving, tuple(notes)
