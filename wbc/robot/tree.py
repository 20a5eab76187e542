"""A floating-base kinematic tree: its sizes, names, limits and feet, and arithmetic on (q, v)."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, UnknownNameError, listed
from wbc.native import lib
from wbc.robot.feet import NO_FEET, Foot
from wbc.robot.formats.couplings import Coupling, Loop
from wbc.robot.kernel import NativePass, NativeTree
from wbc.robot.kernel_check import checked_tree
from wbc.robot.limits import BASE_NQ, BASE_NV, JointLimits
from wbc.robot.loops import Closure
from wbc.robot.names import frame_table, looked_up, matching
from wbc.robot.passive import PassiveForces
from wbc.validate import Array, finite_array, finite_number, plain_copy, read_only

# Of entries of q and v: beyond it they are no measurement.
LARGEST: float = lib.wbc_largest_state


class _PerThread(threading.local):
    """What each thread has its own of."""

    native: NativePass


@dataclass(frozen=True, eq=False, repr=False)
class KinematicTree:
    """What a :class:`~wbc.robot.state.KinematicState` knows of its robot; does not change.

    ``q`` (nq,) is base position, base quaternion (x, y, z, w), joints; ``v`` (nv,) is the base's
    linear and angular velocity in base axes, then the joints' rates (Pinocchio's free-flyer).

    Attributes
    ----------
    name:
        The robot's name.
    path:
        The file it was read from.
    model:
        Pinocchio model, locked joints removed, with sole frames; shared: do not change it.
    limits:
        Joint limits in velocity order.
    feet:
        Feet by name, such as ``left``; empty if none were found.
    fixed_base:
        Whether the base is bolted to the world. It has its place in q and v all the same;
        controllers hold it.
    couplings:
        Mimic joints, and what they follow; controllers hold them to it (see
        :mod:`wbc.constraints.mechanics`).
    loops:
        Closed loops by name: frames that are one; controllers hold them likewise.
    unactuated:
        Joints without a motor: torques are 0 there.
    passive:
        Springs, gravity compensation and curved damping of the joints; see
        :meth:`~wbc.robot.Robot.passive_forces`.
    """

    name: str
    path: Path
    model: pin.Model
    limits: JointLimits
    feet: Mapping[str, Foot]
    fixed_base: bool
    couplings: Mapping[str, Coupling]
    loops: Mapping[str, Loop]
    unactuated: tuple[str, ...]
    passive: PassiveForces

    def __post_init__(self) -> None:
        for name in ("couplings", "loops", "feet"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r}, nv={self.nv}, mass={self.mass:.2f} kg)"

    def __reduce__(self) -> tuple[object, ...]:
        values = (getattr(self, field.name) for field in fields(self))
        plain = (dict(v) if isinstance(v, MappingProxyType) else v for v in values)
        return type(self), tuple(plain)

    # ------------------------------------------------------------------ sizes and names

    @cached_property
    def nq(self) -> int:
        """Size of a configuration q."""
        return int(self.model.nq)

    @cached_property
    def nv(self) -> int:
        """Size of a velocity v."""
        return int(self.model.nv)

    @cached_property
    def mass(self) -> float:
        """Total mass [kg]."""
        return float(pin.computeTotalMass(self.model))

    @cached_property
    def gravity(self) -> float:
        """That of the model, whatever its direction [m/s^2]."""
        return math.hypot(*self.model.gravity.linear)

    @cached_property
    def weight(self) -> float:
        """Total weight [N], in the model's gravity."""
        return self.mass * self.gravity

    @cached_property
    def armature(self) -> Array:
        """Rotor inertia (nv-6,), as felt at the joint [kg m^2 or kg]; in the mass matrix."""
        return read_only(np.array(self.model.armature[BASE_NV:]))

    @cached_property
    def damping(self) -> Array:
        """Viscous friction (nv-6,) of the joints [N m s/rad or N s/m]; not in the bias."""
        return read_only(np.array(self.model.damping[BASE_NV:]))

    @cached_property
    def friction(self) -> Array:
        """Dry friction (nv-6,) of the joints [N m or N], against their motion; not in the bias."""
        return read_only(np.array(self.model.upperDryFrictionLimit[BASE_NV:]))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Actuated joints: entry k belongs to ``v[6 + k]``."""
        return self.limits.names

    @property
    def motorless(self) -> tuple[str, ...]:
        """Joints without a motor of their own: mimic joints, and those that are unactuated."""
        return (*self.couplings, *(name for name in self.unactuated if name not in self.couplings))

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Every frame: links, joints, soles, and ``base``."""
        return tuple(self.frame_indices)

    @cached_property
    def frame_indices(self) -> dict[str, int]:
        """Pinocchio's index of each frame, by name."""
        return frame_table(self.model)

    @cached_property
    def _joints(self) -> dict[str, int]:
        return {name: BASE_NV + k for k, name in enumerate(self.joint_names)}

    def joint_index(self, name: str) -> int:
        """Return the entry of v that is the rate of a joint.

        Raises
        ------
        UnknownNameError
            No such actuated joint.
        """
        return looked_up("joint", name, self._joints)

    def joint_indices(self, pattern: str) -> tuple[int, ...]:
        """Return the entries of v of the joints that match a pattern such as ``left_*``.

        Raises
        ------
        UnknownNameError
            No joint matches.
        """
        return tuple(BASE_NV + k for k in matching(pattern, self.joint_names))

    def frame_id(self, name: str) -> int:
        """Return Pinocchio's index of a frame.

        Raises
        ------
        UnknownNameError
            No such frame.
        """
        return looked_up("frame", name, self.frame_indices)

    def frame(self, name: str) -> pin.Frame:
        """Return Pinocchio's frame: the joint that carries it, and its placement there.

        Raises
        ------
        UnknownNameError
            No such frame.
        """
        return self.model.frames[self.frame_id(name)]

    def foot(self, name: str) -> Foot:
        """Return a foot.

        Raises
        ------
        UnknownNameError
            No such foot; without any, the message says how to give them.
        """
        if not isinstance(name, str) or name not in self.feet:
            remedy = "" if self.feet else NO_FEET
            raise UnknownNameError(f"foot of {self.name}", name, self.feet, remedy)
        return self.feet[name]

    @cached_property
    def scratch(self) -> _PerThread:
        """What each thread has of its own; see :attr:`native`."""
        return _PerThread()

    @cached_property
    def carried(self) -> Array:
        """Which entries of v carry which, (nv, nv): with its transpose, both orders of every pair.

        2 where column j moves the body of column k and not the other way round, 1 where both move
        one body, 0 elsewhere.
        """
        model = self.model
        body = np.repeat(np.arange(model.njoints), list(model.nvs))
        chains = [set(map(int, chain)) for chain in model.supports]
        reaches = np.array([[int(j) in chains[k] for j in body] for k in body])
        return np.asarray(reaches * (2.0 - reaches.T))

    @property
    def native(self) -> NativePass:
        """The core's pass over this tree, one for each thread."""
        try:
            return self.scratch.native
        except AttributeError:
            self.scratch.native = NativePass(self._native_tree)
            return self.scratch.native

    @cached_property
    def _native_tree(self) -> NativeTree:
        return checked_tree(self.name, self.model)

    # ------------------------------------------------------------------ configurations

    def integrate(self, q: ArrayLike, v: ArrayLike, dt: float) -> Array:
        """Return the configuration (nq,) reached from ``q`` by the constant velocity ``v``.

        Raises
        ------
        InvalidInputError
            See :meth:`check_configuration` and :meth:`check_velocity`; where it gets to, too.
        """
        dt, native = finite_number("dt", dt), self.native
        if (plain := native.integrated(q, v, dt)) is not None:
            return plain
        # Lists and unpickled arrays: the same numbers, the same bits.
        numbers, step = finite_array("q", q, (self.nq,), LARGEST), self.check_velocity(v)
        if (plain := native.integrated(numbers, step, dt)) is not None:
            return plain
        # What the core refuses is beyond the bounds, before or after: this says where.
        start = self.check_configuration(q)
        return self.check_configuration(pin.integrate(self.model, start, step * dt))

    def integrate_all(self, q: Array, steps: Array) -> Array:
        """Return the configurations (n, nq), each displaced by its own of ``steps`` (n, nv).

        Raises InvalidInputError: see :meth:`integrate`.
        """
        q = finite_array("q", q, (len(q), self.nq))
        steps = finite_array("steps", steps, (len(q), self.nv))
        reached, right = self.native.integrated_all(q, steps)
        if right < len(q):
            self.integrate(q[right], steps[right], 1.0)  # raises
        return reached

    def difference(self, q0: ArrayLike, q1: ArrayLike) -> Array:
        """Return the displacement (nv,) with ``integrate(q0, displacement, 1) == q1``."""
        start, end = self.check_configuration(q0), self.check_configuration(q1)
        return pin.difference(self.model, start, end)

    @cached_property
    def closure(self) -> Closure:
        """What closes the loops."""
        model, limits, springs = self.model, self.limits, self.passive.springs
        return Closure(model, limits, self.loops, self.couplings, self.unactuated, springs)

    def closed(self, q: ArrayLike, kept: Sequence[str] = ()) -> Array:
        """Return the configuration (nq,) near ``q`` at which all loops are closed, within limits.

        Joints without a motor move first, then all but those called ``kept``, as little as
        possible; the base does not. A robot without loops stays as it is.

        Raises
        ------
        InvalidInputError
            No such configuration is found, or see :meth:`check_configuration`.
        UnknownNameError
            No such joint to keep.
        """
        start = self.check_configuration(q)
        for joint in kept:
            self.joint_index(joint)
        return self.closure.closed(start, kept) if self.loops else start

    def gaps(self, q: ArrayLike) -> dict[str, float]:
        """Return how far each loop is open at ``q``, by name: its largest error [m or rad]."""
        return self.closure.gaps(self.check_configuration(q))

    def check_configuration(self, q: ArrayLike) -> Array:
        """Return ``q`` as a fresh (nq,) array with quaternion (and cos, sin) normalised.

        Raises
        ------
        InvalidInputError
            Wrong size, not finite, beyond 1e6, or a norm further than 1e-3 from 1: not rounding,
            but another order or a wrong slice.
        """
        array = plain_copy(q, (self.nq,), LARGEST)  # in every tick: no more unless it is needed
        if array is None:
            try:
                array = finite_array("q", q, (self.nq,), LARGEST)
            except InvalidInputError as error:
                hint = ""
                if isinstance(q, Mapping):
                    hint = "; joints by name are: robot.posture('standing', {...})"
                elif getattr(q, "shape", None) == (self.nq - 7,):
                    hint = (
                        ": the base's position and quaternion come before the joints, as in"
                        " robot.posture('standing')"
                    )
                elif getattr(q, "shape", None) == (self.nv,):
                    hint = ": that is the size of a velocity v"
                raise InvalidInputError(f"{error}{hint}") from None
        self._normalise(array)
        return array

    def check_velocity(self, v: ArrayLike) -> Array:
        """Return ``v`` as a fresh (nv,) array.

        Raises
        ------
        InvalidInputError
            Wrong size, not finite, or beyond 1e6.
        """
        array = plain_copy(v, (self.nv,), LARGEST)
        return finite_array("v", v, (self.nv,), LARGEST) if array is None else array

    def _normalise(self, q: Array) -> None:
        """Normalise what should be of norm 1 in ``q`` and is but for rounding."""
        _normalise(q[3:BASE_NQ], "quaternion q[3:7] (order x, y, z, w)")
        for k in self.limits.unbounded:
            start = self.limits.starts[k]
            _normalise(q[start : start + 2], f"(cos, sin) of joint {self.limits.names[k]!r}")


def _normalise(part: Array, what: str) -> None:
    off = math.hypot(*part.tolist()) - 1.0
    if abs(off) > lib.wbc_unit:
        raise InvalidInputError(f"{what} has norm {1.0 + off:.6g}, expected 1; normalise it")
    if abs(off) > lib.wbc_unit_rounding:
        part /= 1.0 + off


def refuse_loops(what: str, robot: KinematicTree) -> None:
    """Refuse a robot with closed loops, or with gears that are no plain ratios."""
    curved = [f"gear of {name}" for name, one in robot.couplings.items() if not one.is_linear]
    known = [f"loop {name}" for name in robot.loops] + curved
    if known:
        raise InvalidInputError(
            f"{what}: {robot.name} has {listed(known)}, and closed loops are not supported here;"
            " controllers and plants know them"
        )
