"""The reaction mass pendulum of a motion, frame by frame."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from wbc.files import ending_of, write_arrays, write_whole
from wbc.motion.dropouts import Dropout
from wbc.motion.noise import Noise
from wbc.rmp.ground import in_contact
from wbc.robot import Robot
from wbc.spatial import COMPONENTS
from wbc.validate import Array, Bools, read_only

LIMIT_TOLERANCE = 1e-3  # rad or m past a limit, by rounding and the filter
FORMATS = (".npz", ".csv")
_XYZ, _123 = ("_x", "_y", "_z"), ("_1", "_2", "_3")
# Columns of the CSV: array, endings of its columns, units of them (one for all, or two halves).
_COLUMNS: tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...] = (
    ("time", ("",), ("s",)),
    ("com", _XYZ, ("m",)),
    ("com_velocity", _XYZ, ("m/s",)),
    ("com_acceleration", _XYZ, ("m/s^2",)),
    ("momentum", (*_XYZ, *(f"_k{a}" for a in "xyz")), ("kg m/s", "kg m^2/s")),
    ("momentum_rate", (*_XYZ, *(f"_k{a}" for a in "xyz")), ("N", "N m")),
    ("ground_force", _XYZ, ("N",)),
    ("ground_moment", ("",), ("N m",)),
    ("cop", _XYZ, ("m",)),
    ("cmp", _XYZ, ("m",)),
    ("cop_margin", ("",), ("m",)),
    ("flight", ("",), ("1",)),
    ("leg_length", ("",), ("m",)),
    ("leg_direction", _XYZ, ("1",)),
    ("leg_angles", ("_theta", "_phi"), ("rad",)),
    ("inertia", tuple(f"_{component}" for component in COMPONENTS), ("kg m^2",)),
    ("second_moments", _123, ("kg m^2",)),
    ("semi_axes", _123, ("m",)),
    ("radii", _123, ("m",)),
    ("axes", tuple(f"_{k}{a}" for a in "xyz" for k in "123"), ("1",)),
    ("axes_defined", _123, ("1",)),
    ("average_angular_velocity", _XYZ, ("rad/s",)),
    ("axes_angular_velocity", _XYZ, ("rad/s",)),
)


def series_format(path: str | Path) -> str:
    """Return the ending of a series' file.

    Raises InvalidInputError: neither ``.npz`` nor ``.csv``.
    """
    expected = "a series is written as .npz (everything) or .csv (the pendulum)"
    return ending_of(path, FORMATS, expected)


@dataclass(frozen=True, eq=False)
class ReadOnlyArrays:
    """Base class that makes all array fields read-only."""

    def __post_init__(self) -> None:
        for array in self.arrays().values():
            read_only(array)

    def arrays(self) -> dict[str, Array]:
        """Return every array by its name."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if isinstance(value, np.ndarray)}


@dataclass(frozen=True, eq=False)
class Uncertainty(ReadOnlyArrays):
    """Standard deviations of a pendulum's quantities in n frames, from its recording's noise.

    To first order in the noise. A 95 % band is ``BAND`` = 1.96 of them on each side. Quantities of
    the ground's force are NaN where the ground does not push.

    Attributes
    ----------
    noise:
        Of the recording.
    beyond:
        Number of standard deviations that noise alone does not exceed anywhere in the recording,
        with a probability of 95 %.
    com:
        (n, 3) [m]; with a planted foot, as all positions, relative to it.
    momentum, momentum_rate:
        (n, 6) [kg m/s, kg m^2/s; N, N m]; the latter's first half is also the ground's force.
    cop, cmp:
        Along x and y (n, 2) [m].
    cop_margin:
        (n,) [m]; None without feet.
    leg_length, leg_angles:
        (n,) [m], (n, 2) [rad]. The length of a leg near the vertical is quadratic in the CoP's
        error: there its deviation is too large.
    second_moments, semi_axes, radii:
        (n, 3) [kg m^2, m, m].
    average_angular_velocity:
        (n, 3) [rad/s].
    """

    noise: Noise
    beyond: float
    com: Array
    momentum: Array
    momentum_rate: Array
    cop: Array
    cmp: Array
    cop_margin: Array | None
    leg_length: Array
    leg_angles: Array
    second_moments: Array
    semi_axes: Array
    radii: Array
    average_angular_velocity: Array


@dataclass(frozen=True, eq=False)
class RmpSeries(ReadOnlyArrays):
    """The reaction mass pendulum in n frames; made by :func:`wbc.motion.analyze`.

    World axes, SI units, the meaning of :class:`wbc.RmpState`. All arrays are read-only. NaN stands
    only where a quantity does not exist: without pressure on the ground (``flight``) there is no
    CoP, CMP, normal moment, margin or leg; no margin where no foot stands; no leg angles where the
    leg lies along y; no rate of the axes where one of them is undefined.

    Attributes
    ----------
    robot, source, dropouts:
        Of the recorded motion.
    ground_height:
        Height of the ground [m].
    measured:
        Whether the ground's force, and with it CoP, CMP and leg, is measured by the soles, rather
        than that of the motion.
    cutoff:
        Of the low-pass [Hz]; None: without.
    uncertainty:
        Standard deviations of the pendulum's quantities, from the recording's noise; None if not
        requested.
    time:
        (n,) [s], even.
    q, v, acceleration:
        Configuration (n, nq), velocity and its rate (n, nv).
    com, com_velocity, com_acceleration:
        (n, 3) [m, m/s, m/s^2].
    momentum, momentum_rate:
        Centroidal momentum and its rate (n, 6): linear [kg m/s, N], angular [kg m^2/s, N m].
    ground_force:
        (n, 3) [N]; with a negative z the motion requires a ground that pulls.
    ground_moment:
        n . m_r (n,) [N m], about the normal through the CoP.
    cop, cmp:
        (n, 3) [m], on the ground; never clipped.
    flight:
        True where the ground does not push (n,).
    feet:
        Names of the feet of ``standing``; empty if none are checked.
    standing:
        Which of them stand (n, f).
    cop_margin:
        Distance of the CoP inside the hull of the standing feet (n,) [m], negative outside; None
        without feet.
    leg_length, leg_direction, leg_angles:
        (n,) [m], (n, 3) and (theta, phi) (n, 2) [rad] of the leg from CoP to CoM.
    inertia:
        Centroidal CRB inertia xx xy xz yy yz zz (n, 6) [kg m^2].
    second_moments, semi_axes, radii:
        lambda_k [kg m^2], a_k and r_k [m] along the tracked axes (n, 3).
    axes:
        Tracked principal axes as columns (n, 3, 3).
    axes_defined:
        False for axes too close to call (n, 3).
    average_angular_velocity:
        Of the momentum: I^-1 k_G (n, 3) [rad/s].
    axes_angular_velocity:
        Of the principal axes (n, 3) [rad/s].
    """

    robot: Robot
    source: str
    dropouts: tuple[Dropout, ...]
    ground_height: float
    measured: bool
    cutoff: float | None
    uncertainty: Uncertainty | None
    time: Array
    q: Array
    v: Array
    acceleration: Array
    com: Array
    com_velocity: Array
    com_acceleration: Array
    momentum: Array
    momentum_rate: Array
    ground_force: Array
    ground_moment: Array
    cop: Array
    cmp: Array
    flight: Bools
    feet: tuple[str, ...]
    standing: Bools
    cop_margin: Array | None
    leg_length: Array
    leg_direction: Array
    leg_angles: Array
    inertia: Array
    second_moments: Array
    semi_axes: Array
    radii: Array
    axes: Array
    axes_defined: Bools
    average_angular_velocity: Array
    axes_angular_velocity: Array

    def __repr__(self) -> str:
        span = f"{len(self)} frames, {self.time[-1] - self.time[0]:.4g} s"
        return f"RmpSeries({self.robot.name!r}, {span})"

    def __len__(self) -> int:
        return int(self.time.size)

    @property
    def cop_outside(self) -> Bools:
        """True where the CoP is outside the support polygon (n,), perhaps by noise."""
        return self._margin < 0.0

    @property
    def infeasible(self) -> Bools:
        """True where the CoP is outside the support polygon by more than noise explains (n,).

        Without an uncertainty, wherever it is outside.
        """
        return self._margin < -self._beyond("cop_margin")

    @property
    def surely_inside(self) -> Bools:
        """True where the CoP is inside the support polygon by more than noise explains (n,)."""
        return self._margin > self._beyond("cop_margin")

    @property
    def surely_flying(self) -> Bools:
        """True where the ground does not push, by more than noise explains (n,)."""
        push = self.ground_force.copy()
        push[:, 2] += self._beyond("momentum_rate", 2)
        maybe_in_contact = in_contact(push, self.robot.weight).astype(bool)
        return self.flight & ~maybe_in_contact

    def _beyond(self, name: str, column: int | None = None) -> Array:
        """Return the largest error by noise of a quantity in n frames; 0 where it is unknown."""
        if self.uncertainty is None or self.measured:
            return np.zeros(len(self))
        deviation = getattr(self.uncertainty, name)
        if deviation is None:
            return np.zeros(len(self))
        deviation = deviation if column is None else deviation[:, column]
        return np.asarray(self.uncertainty.beyond * np.nan_to_num(deviation))

    @property
    def cop_unknown(self) -> Bools:
        """True where the ground pushes but no foot is known to stand (n,)."""
        return np.isnan(self._margin) & ~self.flight

    @property
    def _margin(self) -> Array:
        return np.full(len(self), np.nan) if self.cop_margin is None else self.cop_margin

    @property
    def force_residual(self) -> Array:
        """The ground's force less that of the motion, M (c'' - g) (n, 3) [N]."""
        required = self.momentum_rate[:, :3] - self.robot.mass * self.robot.model.gravity.linear
        return np.asarray(self.ground_force - required)

    @property
    def past_limits(self) -> dict[str, float]:
        """Largest excess of joints over their limits [rad or m]; only joints with one."""
        limits = self.robot.limits
        joints = self.q[:, list(limits.starts)]  # of continuous joints a cosine, without limits
        past = limits.past(joints).max(axis=0)
        names = zip(self.robot.joint_names, past.tolist(), strict=True)
        return {name: excess for name, excess in names if excess > LIMIT_TOLERANCE}

    def save(self, path: str | Path) -> None:
        """Write all arrays to an ``.npz``, or the pendulum to a ``.csv`` with units in its header.

        The file appears whole or not at all. The NPZ also holds ``joint_names``, ``feet`` and a
        ``summary`` as JSON; its ``time`` and ``q`` can be read as a motion again; ``noise/NAME``
        and ``deviation/NAME`` are the uncertainty. The CSV leaves out q, v and acceleration, has
        deviations of CoP and margin only, and writes ``nan`` where a quantity does not exist.

        Raises
        ------
        InvalidInputError
            Another ending.
        OSError
            The file cannot be written.
        """
        if series_format(path) == ".npz":
            self._save_npz(Path(path))
        else:
            self._save_csv(Path(path))

    def _save_npz(self, path: Path) -> None:
        summary = {
            "format": "wbc rmp series 1",
            "robot": self.robot.name,
            "mass": self.robot.mass,
            "source": self.source,
            "ground_height": self.ground_height,
            "measured_forces": self.measured,
            "dropouts": [str(one) for one in self.dropouts],
            "past_limits": self.past_limits,
            "cutoff": self.cutoff,
        }
        entries: dict[str, Any] = {
            "summary": np.array(json.dumps(summary, indent=2, allow_nan=False)),
            "joint_names": np.array(self.robot.joint_names, dtype=str),
            "feet": np.array(self.feet, dtype=str),
            **self.arrays(),
            **self._uncertainty_arrays(),
        }
        write_arrays(path, entries)

    def _uncertainty_arrays(self) -> dict[str, Any]:
        if self.uncertainty is None:
            return {}
        noise = self.uncertainty.noise
        channels = ("joints", "position", "rotation")
        found = {f"noise/{name}": getattr(noise, name) for name in channels}
        found["noise/beyond"] = np.array(self.uncertainty.beyond)
        arrays = self.uncertainty.arrays().items()
        return found | {f"deviation/{name}": values for name, values in arrays}

    def _save_csv(self, path: Path) -> None:
        """Write the pendulum's columns, nine digits each."""
        arrays, header, parts = self.arrays(), list[str](), list[Array]()
        for name, endings, units in _COLUMNS:
            if name in arrays:
                each = [units[k * len(units) // len(endings)] for k in range(len(endings))]
                header += [f"{name}{end} [{unit}]" for end, unit in zip(endings, each, strict=True)]
                parts.append(arrays[name].reshape(len(self), -1))
        if self.uncertainty is not None:
            header += ["cop_deviation_x [m]", "cop_deviation_y [m]"]
            parts.append(self.uncertainty.cop)
            if self.uncertainty.cop_margin is not None:
                header.append("cop_margin_deviation [m]")
                parts.append(self.uncertainty.cop_margin[:, None])
        header += [f"{foot}_stands [1]" for foot in self.feet]
        rows, names = np.column_stack([*parts, self.standing]), ",".join(header)
        look = {"delimiter": ",", "fmt": "%.9g", "header": names, "comments": ""}
        write_whole(path, lambda file: np.savetxt(file, rows, **look))
