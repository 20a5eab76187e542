"""A contact-aided right-invariant extended Kalman filter of an IMU and feet that stand.

After Hartley, Ghaffari, Eustice and Grizzle, *Contact-aided invariant extended Kalman filtering for
robot state estimation* (IJRR 2020). Rotation, velocity, position and the feet's positions are one
element of the group SE_{2+k}(3); the feet's rotations are further elements of SO(3). The error of
a group element is log(X^ X^-1), in world axes; that of a bias is the difference. The error
dynamics and the rows of a foot's place depend on the state through the biases only, and so do the
gains: convergence does not depend on the initial error, and yaw and position, which are
unobservable, gain no spurious information by relinearisation. The arithmetic is the core's
(``source/filter.c``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wbc.errors import InvalidInputError
from wbc.kinds import check_kind, switch, whole_number
from wbc.native import doubles, ffi, integers, lib
from wbc.rotations import check_rotation
from wbc.validate import Array, check_fields, finite_array, finite_number

STATE_SIZE = 15  # rotation, velocity, position, biases of gyroscope and accelerometer
Counts: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True)
class FilterNoise:
    """Noise densities of an IMU and of feet in contact.

    The IMU's are those of its data sheet; the defaults are an Xsens MTi-1's, rounded up. Those of
    the feet cover the creep of simulated soles.

    Attributes
    ----------
    gyroscope, accelerometer:
        Of the readings [rad/s/Hz^(1/2)], [m/s^2/Hz^(1/2)].
    gyroscope_walk, accelerometer_walk:
        Of the biases' rates [rad/s^2/Hz^(1/2)], [m/s^3/Hz^(1/2)].
    creep, roll:
        Of the motion of feet in contact [m/s/Hz^(1/2)], [rad/s/Hz^(1/2)].
    """

    gyroscope: float = 1.5e-4
    accelerometer: float = 2.0e-3
    gyroscope_walk: float = 1.0e-5
    accelerometer_walk: float = 1.0e-4
    creep: float = 2.0e-3
    roll: float = 1.0e-2

    def __post_init__(self) -> None:
        check_fields(self, "filter noise, ", *self.__dataclass_fields__, least=0.0)


class Correction(NamedTuple):
    """The result of a correction by a foot's place."""

    taken: bool  # whether it was within the gate, and corrected the estimate
    # normalised innovation squared: chi-square with as many degrees of freedom as rows
    squared: float
    residual: Array  # (6,) innovation: position [m] and rotation [rad], world axes


class ContactFilter:
    """The filter; see the module. At rest at the origin, upright, until :meth:`reset`.

    Parameters
    ----------
    feet:
        Their number; none is in contact at first.
    gravity:
        (3,) [m/s^2], world axes.

    Attributes
    ----------
    struct:
        Of the core.
    """

    def __init__(
        self, feet: int, noise: FilterNoise | None = None, gravity: ArrayLike = (0.0, 0.0, -9.81)
    ) -> None:
        check_kind("filter, noise", noise, FilterNoise, or_none=True)
        feet = whole_number("filter, feet", feet)
        noise = noise or FilterNoise()
        self.noise, self.feet = noise, feet
        n = STATE_SIZE + 6 * feet
        # The whole state in one array: state, covariance, origin; saved and restored at once.
        self._memory = np.zeros(int(lib.FILTER_FEET) + 12 * feet + n * n + 3)
        end = int(lib.FILTER_FEET) + 12 * feet
        self._x, self._P = self._memory[:end], self._memory[end : end + n * n].reshape(n, n)
        self._origin = self._memory[end + n * n :]
        self._held = np.zeros(feet, dtype=np.int64)
        self._scratch, self._result = np.zeros(7 * n), np.zeros(7)
        g = finite_array("filter, gravity", gravity, (3,))
        self._arguments = feet, noise, g
        squares = {name: getattr(noise, name) ** 2 for name in FilterNoise.__dataclass_fields__}
        self.struct = ffi.new(
            "wbc_filter *",
            {
                "feet": feet,
                "held": integers(self._held) if feet else ffi.NULL,
                "x": doubles(self._x),
                "P": doubles(self._P),
                "scratch": doubles(self._scratch),
                "origin": doubles(self._origin),
                "gravity": g.tolist(),
                **squares,
            },
        )
        self._x[:9] = np.eye(3).ravel()

    def __reduce__(self) -> tuple[Any, ...]:
        """Return constructor, arguments and memory: the core's struct cannot be pickled."""
        return type(self), self._arguments, self.memory()

    def __setstate__(self, memory: tuple[Array, Counts]) -> None:
        self.restore(memory)

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the arrays that the core writes, for memory that is allocated elsewhere."""
        x, P, scratch = self._x.size, self._P.size, self._scratch.size
        return {"FILTER_X": x, "FILTER_P": P, "FILTER_SCRATCH": scratch}

    # ------------------------------------------------------------------ state

    @property
    def rotation(self) -> Array:
        """Of the IMU to the world (3, 3); a copy, as all below."""
        return self._x[:9].reshape(3, 3).copy()

    @property
    def velocity(self) -> Array:
        """Of the IMU (3,) [m/s], world axes."""
        return self._x[9:12].copy()

    @property
    def position(self) -> Array:
        """Of the IMU (3,) [m], world axes."""
        return self._x[12:15] + self._origin

    @property
    def gyroscope_bias(self) -> Array:
        """(3,) [rad/s], in the IMU's axes."""
        return self._x[15:18].copy()

    @property
    def accelerometer_bias(self) -> Array:
        """(3,) [m/s^2], in the IMU's axes."""
        return self._x[18:21].copy()

    @property
    def held(self) -> tuple[bool, ...]:
        """Which feet are in contact."""
        return tuple(bool(one) for one in self._held.tolist())

    @property
    def covariance(self) -> Array:
        """(15, 15) of estimate minus truth, as in :class:`~wbc.estimation.Estimate`."""
        out = np.empty((STATE_SIZE, STATE_SIZE))
        lib.wbc_filter_covariance(self.struct, doubles(out))
        return out

    @property
    def invariant_covariance(self) -> Array:
        """(n, n) of the invariant error: rotation, velocity, position, biases, each foot."""
        return self._P.copy()

    def foot(self, k: int) -> tuple[Array, Array]:
        """Return position (3,) and rotation (3, 3) of a foot in contact, world axes."""
        k = self._held_foot(k)
        own = self._x[21 + 12 * k : 33 + 12 * k]
        return own[:3] + self._origin, own[3:].reshape(3, 3).copy()

    # ------------------------------------------------------------------ updates

    def reset(
        self,
        rotation: Array,
        position: Array,
        velocity: ArrayLike = (0.0, 0.0, 0.0),
        gyroscope_bias: ArrayLike = (0.0, 0.0, 0.0),
        accelerometer_bias: ArrayLike = (0.0, 0.0, 0.0),
        covariance: Array | None = None,
    ) -> None:
        """Restart at a state, without contacts, and a covariance (15, 15), 0 if None.

        The covariance is of estimate minus truth in world axes, as :attr:`covariance`.

        Raises
        ------
        InvalidInputError
            Something is NaN, of another shape, or no rotation.
        """
        R = finite_array("filter, rotation", rotation, (3, 3))
        check_rotation("filter, rotation", R)
        parts = {"velocity": velocity, "position": position}
        parts |= {"gyroscope_bias": gyroscope_bias, "accelerometer_bias": accelerometer_bias}
        numbers = [finite_array(f"filter, {name}", one, (3,)) for name, one in parts.items()]
        state = np.concatenate((R.ravel(), *numbers))
        P = ffi.NULL
        if covariance is not None:
            P = doubles(_covariance("filter, covariance", covariance, STATE_SIZE))
        lib.wbc_filter_reset(self.struct, doubles(state), P)

    def predict(self, rate: Array, force: Array, dt: float, scale: float = 1.0) -> None:
        """Predict over ``dt`` [s] with the mean angular velocity and specific force (3,) over it.

        Exact where both are constant in the IMU's axes. ``scale`` multiplies the variance of both
        readings, for guessed ones.

        Raises
        ------
        InvalidInputError
            Something is NaN, or of another shape.
        """
        readings = (
            finite_array("filter, rate", rate, (3,)),
            finite_array("filter, force", force, (3,)),
        )
        step = finite_number("filter, dt", dt, least=0.0)
        scale = finite_number("filter, scale", scale, least=0.0)
        lib.wbc_filter_predict(self.struct, *map(doubles, readings), step, scale)

    def hold(self, k: int, place: Array, noise: Array) -> None:
        """Add a contact of foot ``k`` at its measured place; see :meth:`correct`.

        Raises
        ------
        InvalidInputError
            No such foot, place or covariance.
        """
        lib.wbc_filter_hold(self.struct, self._foot(k), *map(doubles, _foot_arrays(place, noise)))

    def release(self, k: int) -> None:
        """Remove the contact of foot ``k``."""
        lib.wbc_filter_release(self.struct, self._foot(k))

    def correct(
        self, k: int, place: Array, noise: Array, gate: float = np.inf, rotation: bool = True
    ) -> Correction:
        """Correct by the measured place of a foot in contact.

        Parameters
        ----------
        place:
            (12,) position, then rotation row by row, of the foot in the IMU's axes.
        noise:
            (6, 6) covariance of both in these axes [m^2, rad^2].
        gate:
            Largest normalised innovation squared; beyond it nothing is changed.
        rotation:
            Whether the foot's rotation is measured, too; not of a foot that rolls.

        Raises
        ------
        InvalidInputError
            The innovation has no covariance, as with noise 0; something is NaN, or of another
            shape; no such foot, or none in contact.
        """
        k, arrays = self._held_foot(k), _foot_arrays(place, noise)
        rows = 6 if switch("filter, rotation", rotation) else 3
        if not (isinstance(gate, float) and gate == np.inf):
            gate = finite_number("filter, gate", gate, least=0.0)
        out = doubles(self._result)
        status = lib.wbc_filter_correct(self.struct, k, *map(doubles, arrays), rows, gate, out)
        if status == lib.NOT_FINITE:
            raise InvalidInputError(
                f"filter: the innovation of foot {k} has no positive covariance: its place is"
                " without any noise"
            )
        return Correction(status == lib.DONE, float(self._result[0]), self._result[1:].copy())

    def _foot(self, k: int) -> int:
        """Return a checked foot number: the core indexes memory by it."""
        return whole_number("filter, foot", k, most=self.feet - 1)

    def _held_foot(self, k: int) -> int:
        k = self._foot(k)
        if not self._held[k]:
            raise InvalidInputError(f"filter: foot {k} is not in contact; hold it first")
        return k

    def memory(self) -> tuple[Array, Counts]:
        """Return the whole state, for :meth:`restore`."""
        return self._memory.copy(), self._held.copy()

    def restore(self, memory: tuple[Array, Counts]) -> None:
        """Restore a state of :meth:`memory`."""
        self._memory[:], self._held[:] = memory


def _foot_arrays(place: Array, noise: Array) -> tuple[Array, Array]:
    """Return checked place (12,) and covariance (6, 6) of a foot for the core."""
    found = finite_array("filter, place of a foot", place, (12,))
    check_rotation("filter, place of a foot", found[3:].reshape(3, 3))
    return found, _covariance("filter, noise of a foot", noise, 6)


def _covariance(what: str, given: ArrayLike, size: int) -> Array:
    """Return a covariance (size, size): symmetric and positive semidefinite, to rounding."""
    P = np.ascontiguousarray(finite_array(what, given, (size, size)))
    rounding = 1e-9 * np.abs(P).max()
    if np.abs(P - P.T).max() > rounding or np.linalg.eigvalsh(P)[0] < -rounding:
        raise InvalidInputError(f"{what}: is no covariance (symmetric, positive semidefinite)")
    return P
