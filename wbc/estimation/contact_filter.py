"""A contact-aided right-invariant extended Kalman filter of an IMU and feet that stand.

After Hartley, Ghaffari, Eustice and Grizzle, *Contact-aided invariant extended Kalman filtering for
robot state estimation* (IJRR 2020). Rotation, velocity, position and the feet's positions are one
element of the group SE_{2+k}(3); the feet's rotations stand beside it, each an element of SO(3).
The error of a group element is log(X^ X^-1), in world axes; of a bias it is the difference. Its
dynamics and the rows of a foot's place do not depend on the state but through the biases, so
neither do gains: an estimate that begins far off converges like one that does not, and yaw and
position, which nothing observes, gain no information by linearising anew. The arithmetic is the
core's (``source/filter.c``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wbc.errors import InvalidInputError
from wbc.kinds import check_kind, whole_number
from wbc.native import doubles, ffi, integers, lib
from wbc.rotations import check_rotation
from wbc.validate import Array, check_fields, finite_array, finite_number

SHOWN = 15  # rotation, velocity, position, biases of gyroscope and accelerometer
Counts: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True)
class FilterNoise:
    """How much an IMU and standing feet are believed, as densities of white noise.

    The IMU's are those of its data sheet; the defaults are an Xsens MTi-1's, rounded up. Those of
    the feet cover what simulated soles creep on their ground.

    Attributes
    ----------
    gyroscope, accelerometer:
        Of the readings [rad/s/Hz^(1/2)], [m/s^2/Hz^(1/2)].
    gyroscope_walk, accelerometer_walk:
        Of the biases' rates [rad/s^2/Hz^(1/2)], [m/s^3/Hz^(1/2)].
    creep, roll:
        Of the motion of feet that stand [m/s/Hz^(1/2)], [rad/s/Hz^(1/2)].
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
    """What came of a foot's place.

    Attributes
    ----------
    taken:
        Whether it was within the gate, and corrected the estimate.
    squared:
        Normalised innovation squared: chi-square of as many degrees of freedom as rows.
    residual:
        (6,) innovation: position [m] and rotation [rad], world axes.
    """

    taken: bool
    squared: float
    residual: Array


class ContactFilter:
    """The filter; see the module. At rest at the origin, upright, until :meth:`reset`.

    Parameters
    ----------
    feet:
        How many there are; none is held in the beginning.
    gravity:
        (3,) [m/s^2], world axes.

    Attributes
    ----------
    struct:
        As the core has it.
    """

    def __init__(
        self, feet: int, noise: FilterNoise | None = None, gravity: ArrayLike = (0.0, 0.0, -9.81)
    ) -> None:
        check_kind("filter, noise", noise, FilterNoise, or_none=True)
        feet = whole_number("filter, feet", feet)
        noise = noise or FilterNoise()
        self.noise, self.feet = noise, feet
        n = SHOWN + 6 * feet
        # All that changes: the state, the covariance, the origin; copied and put back as one.
        self._memory = np.zeros(int(lib.FILTER_FEET) + 12 * feet + n * n + 3)
        at = int(lib.FILTER_FEET) + 12 * feet
        self._x, self._P = self._memory[:at], self._memory[at : at + n * n].reshape(n, n)
        self._origin = self._memory[at + n * n :]
        self._held = np.zeros(feet, dtype=np.int64)
        self._scratch, self._said = np.zeros(7 * n), np.zeros(7)
        g = finite_array("filter, gravity", gravity, (3,))
        self._made = feet, noise, g
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
        """Return how to make it anew, and what it knows: what the core has is no object."""
        return type(self), self._made, self.memory()

    def __setstate__(self, memory: tuple[Array, Counts]) -> None:
        self.restore(memory)

    @property
    def sizes(self) -> dict[str, int]:
        """How many numbers the core writes of it, for who has the memory elsewhere."""
        sizes = self._x.size, self._P.size, self._scratch.size
        return dict(zip(("FILTER_X", "FILTER_P", "FILTER_SCRATCH"), sizes, strict=True))

    # ------------------------------------------------------------------ what is known

    @property
    def rotation(self) -> Array:
        """Of the IMU to the world (3, 3); a copy, as all here."""
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
        """Which feet are counted on to stand."""
        return tuple(bool(one) for one in self._held.tolist())

    @property
    def covariance(self) -> Array:
        """(15, 15) of estimate minus truth, as in :class:`~wbc.estimation.Estimate`."""
        out = np.empty((SHOWN, SHOWN))
        lib.wbc_filter_covariance(self.struct, doubles(out))
        return out

    @property
    def invariant_covariance(self) -> Array:
        """(n, n) of the invariant error: rotation, velocity, position, biases, each foot."""
        return self._P.copy()

    def foot(self, k: int) -> tuple[Array, Array]:
        """Return position (3,) and rotation (3, 3) of a foot that is held, world axes."""
        own = self._x[21 + 12 * k : 33 + 12 * k]
        return own[:3] + self._origin, own[3:].reshape(3, 3).copy()

    # ------------------------------------------------------------------ what changes it

    def reset(
        self,
        rotation: Array,
        position: Array,
        velocity: ArrayLike = (0.0, 0.0, 0.0),
        gyroscope_bias: ArrayLike = (0.0, 0.0, 0.0),
        accelerometer_bias: ArrayLike = (0.0, 0.0, 0.0),
        covariance: Array | None = None,
    ) -> None:
        """Begin anew with a state, no foot held, and a covariance (15, 15), 0 if None.

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
        P = None
        if covariance is not None:
            P = finite_array("filter, covariance", covariance, (SHOWN, SHOWN))
        given = ffi.NULL if P is None else doubles(np.ascontiguousarray(P))
        lib.wbc_filter_reset(self.struct, doubles(state), given)

    def predict(self, rate: Array, force: Array, dt: float, scale: float = 1.0) -> None:
        """Move on by ``dt`` [s] with the mean angular velocity and specific force (3,) over it.

        Exact where both are constant in the IMU's axes. ``scale`` multiplies the variance of both
        readings, for those that were guessed.

        Raises
        ------
        InvalidInputError
            Something is NaN, or of another shape.
        """
        given = (
            finite_array("filter, rate", rate, (3,)),
            finite_array("filter, force", force, (3,)),
        )
        step = finite_number("filter, dt", dt, least=0.0)
        lib.wbc_filter_predict(self.struct, *map(doubles, given), step, scale)

    def hold(self, k: int, place: Array, noise: Array) -> None:
        """Count on foot ``k`` to stand from now on where it is seen; see :meth:`correct`."""
        lib.wbc_filter_hold(self.struct, self._foot(k), *map(doubles, _seen(place, noise)))

    def release(self, k: int) -> None:
        """Count on foot ``k`` no longer."""
        lib.wbc_filter_release(self.struct, self._foot(k))

    def correct(
        self, k: int, place: Array, noise: Array, gate: float = np.inf, rotation: bool = True
    ) -> Correction:
        """Correct by where a foot that is held is seen.

        Parameters
        ----------
        place:
            (12,) position, then rotation row by row, of the foot in the IMU's axes.
        noise:
            (6, 6) covariance of both in these axes [m^2, rad^2].
        gate:
            Largest normalised innovation squared; beyond, nothing is changed.
        rotation:
            Whether the foot's rotation says something, too; not of a foot that rolls.

        Raises
        ------
        InvalidInputError
            The innovation has no covariance, as with noise 0; something is NaN, or of another
            shape; no such foot.
        """
        k, given, rows = self._foot(k), _seen(place, noise), (6 if rotation else 3)
        to = doubles(self._said)
        said = lib.wbc_filter_correct(self.struct, k, *map(doubles, given), rows, gate, to)
        if said == lib.NOT_FINITE:
            raise InvalidInputError(
                f"filter: the innovation of foot {k} has no positive covariance: its place is"
                " without any noise"
            )
        return Correction(said == lib.DONE, float(self._said[0]), self._said[1:].copy())

    def _foot(self, k: int) -> int:
        """Return the number of a foot that there is: the core writes by it."""
        return whole_number("filter, foot", k, most=self.feet - 1)

    def memory(self) -> tuple[Array, Counts]:
        """Return all that it knows, for :meth:`restore`."""
        return self._memory.copy(), self._held.copy()

    def restore(self, memory: tuple[Array, Counts]) -> None:
        """Go back to what :meth:`memory` returned."""
        self._memory[:], self._held[:] = memory


def _seen(place: Array, noise: Array) -> tuple[Array, Array]:
    """Return place (12,) and covariance (6, 6) of a foot as the core reads them."""
    covariance = finite_array("filter, noise of a foot", noise, (6, 6))
    return finite_array("filter, place of a foot", place, (12,)), np.ascontiguousarray(covariance)
