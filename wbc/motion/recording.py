"""A recorded motion, and its reader."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.kinds import check_path
from wbc.motion.columns import (
    PLACE,
    QUATERNION,
    check_finite,
    check_limits,
    check_times,
    configuration_columns,
    cos_sin_to_angles,
    read_base,
    read_columns,
)
from wbc.motion.dropouts import Dropout, fill_gaps
from wbc.motion.forces import MeasuredForces, read_forces
from wbc.motion.table import MotionTable, RecordingError, read_csv, read_npz
from wbc.robot import Robot
from wbc.robot.model import check_robot
from wbc.validate import Array, finite_array, finite_number, read_only, real_array, set_fields

LONGEST_GAP = 0.1  # s
# rad or m: encoders are not always calibrated, nor are limits always the mechanical stops. Joints
# past them by less are told (RmpSeries.past_limits); by more is an error.
BEYOND = 0.1
MIN_ROWS = 8  # for accelerations


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion as it was recorded, in rad and m; made by :func:`read_motion`, or from arrays.

    Attributes
    ----------
    robot:
        The robot that moves.
    time:
        Times (n,) [s], increasing, not necessarily evenly.
    joints:
        Joint positions (n, nv-6) [rad or m], in the order of ``robot.joint_names``.
    base:
        Position [m] and quaternion xyzw of the base (n, 7); None if it was not recorded.
    dropouts:
        Missing or frozen data, and whether they were interpolated.
    source:
        Its origin, for messages.
    forces:
        Measured forces of the soles; None without sensors.

    Raises
    ------
    InvalidInputError
        Arrays of a wrong shape or not finite, fewer than 8 rows, times that do not increase, or
        quaternions of norm 0.
    """

    robot: Robot
    time: Array
    joints: Array
    base: Array | None = None
    dropouts: tuple[Dropout, ...] = ()
    source: str = "motion"
    forces: MeasuredForces | None = None

    def __repr__(self) -> str:
        span = f"{len(self.time)} frames, {self.time[-1] - self.time[0]:.4g} s"
        return f"Motion({self.robot.name!r}, {span})"

    def __post_init__(self) -> None:
        source = self.source
        check_robot(f"{source}: robot", self.robot)
        count = real_array(f"{source}: time", self.time).size
        if count < MIN_ROWS:
            raise InvalidInputError(
                f"{source}: {count} rows; accelerations need at least {MIN_ROWS}"
            )
        time = finite_array(f"{source}: time", self.time, (count,))
        joints = finite_array(f"{source}: joints", self.joints, (count, self.robot.nv - 6))
        if not (np.diff(time) > 0.0).all():
            raise InvalidInputError(f"{source}: time must increase from row to row")
        set_fields(self, time=read_only(time), joints=read_only(joints))
        if self.base is not None:
            base = finite_array(f"{source}: base", self.base, (count, 7))
            norm = np.linalg.norm(base[:, 3:], axis=1)
            if norm.min() == 0.0:
                raise InvalidInputError(f"{source}: base: a quaternion has norm 0")
            base[:, 3:] /= norm[:, None]
            set_fields(self, base=read_only(base))

    @property
    def rate(self) -> float:
        """Rows per second, by the median step [Hz]."""
        return 1.0 / float(np.median(np.diff(self.time)))


def read_motion(
    path: str | Path,
    robot: Robot,
    *,
    rate: float | None = None,
    degrees: bool = False,
    missing: str | None = None,
    ignore: Sequence[str] = (),
    beyond: float = BEYOND,
    fill: bool = False,
    longest_gap: float = LONGEST_GAP,
) -> Motion:
    """Read a recorded motion from a CSV or NPZ file.

    CSV: a line of column names, then rows of numbers. ``time`` or ``t``; a column for each joint,
    in any order; optionally the floating base as ``base_x``, ``base_y``, ``base_z`` with
    ``base_qx``, ``base_qy``, ``base_qz``, ``base_qw`` or with ``base_roll``, ``base_pitch``,
    ``base_yaw`` (R = Rz Ry Rx). A unit may follow a name: ``left_knee [deg]``, ``left_knee (deg)``,
    ``left_knee_deg``, ``time [ms]``, ``base_x [mm]``.

    Without names, as Unitree's retargeted motions: base x y z [m], quaternion x y z w, and all
    joints in the robot's order.

    NPZ: arrays named like those columns; or ``time``, ``names`` and ``positions`` (n, k); or
    ``time`` and ``q`` (n, nq), as ``wbc run -o`` writes. Both with the forces on the soles that
    ``wbc sim -o`` adds. Or ``fps``, ``joint_pos``, ``body_pos_w`` and ``body_quat_w`` (w x y z; the
    base is the first body, or that after ``world`` in ``body_names``), as mjlab and BeyondMimic
    have them, with ``joint_names``; ``joint_pos`` may be MuJoCo's qpos.

    Lost rows are interpolated, and reported as dropouts, up to ``longest_gap``. Rows that repeat
    while the robot moves (a frozen sensor) are reported, and kept unless ``fill`` is given.

    Parameters
    ----------
    rate:
        Rows per second [Hz] of a file that has no times.
    degrees:
        Angles whose column names no unit are in degrees.
    missing:
        Posture (``standing``, ``neutral``) for joints that the file does not have.
    ignore:
        Columns to ignore, names or patterns such as ``imu_*``; what ``wbc run`` and ``wbc sim``
        write beside time, configuration and forces is always ignored.
    beyond:
        How far a joint may be past its limits [rad or m]; by default 0.1, nearly 6 degrees.
    fill:
        Interpolate missing numbers and frozen rows too, up to ``longest_gap``.
    longest_gap:
        Longest gap that is interpolated [s].

    Raises
    ------
    RecordingError
        The file cannot be used as it is; the message names file, column and row.
    UnknownNameError
        A column that is no joint of the robot (UnknownColumnError), or an unknown posture.
    InvalidInputError
        Options that are not positive numbers.
    """
    longest_gap = finite_number("longest_gap", longest_gap, least=0.0)
    beyond = finite_number("beyond", beyond, least=0.0)
    check_path("read_motion, path", path)
    check_robot("read_motion, robot", robot)
    table = cos_sin_to_angles(_table(Path(path), robot), robot)
    where, values = read_columns(table, robot, ignore, degrees)
    time = _times(table, values, where.get("time"), rate)
    forces = read_forces(Path(path), table, robot, time, ignore)
    check_finite(table, values, list(where.values()), fill)
    joints = _joints(table, values, where, missing, robot)
    check_limits(table, joints, [where.get(name) for name in robot.joint_names], robot, beyond)
    base = read_base(table, values, where)
    names = (*robot.joint_names, *(() if base is None else (*PLACE, *QUATERNION)))
    content = joints if base is None else np.hstack((joints, base))
    time, content, dropouts = fill_gaps(
        table, time, content, names, where, robot, fill, longest_gap
    )
    if len(time) < MIN_ROWS:
        raise RecordingError(f"{len(time)} rows; at least {MIN_ROWS} are needed", table.source)
    joints, rest = np.split(content, [robot.nv - 6], axis=1)
    place = None if base is None else rest
    return Motion(robot, time, joints, place, dropouts, table.source, forces)


def _table(path: Path, robot: Robot) -> MotionTable:
    ending = path.suffix.lower()
    if ending == ".csv":
        return read_csv(path, (*PLACE, *QUATERNION, *robot.joint_names))
    if ending == ".npz":
        return read_npz(path, configuration_columns(robot))
    raise RecordingError("a motion is read from .csv or .npz", str(path))


def _times(table: MotionTable, values: Array, column: int | None, rate: float | None) -> Array:
    if column is None:
        if rate is None:
            what = "there is no column 'time'; add one, or give the rate in rows per second"
            raise RecordingError(what, table.source)
        return np.arange(len(values)) / finite_number("rate", rate, above=0.0)
    if rate is not None:
        raise table.error("the file has times; leave the rate out", column)
    check_times(table, values[:, column], column)
    return values[:, column]


def _joints(
    table: MotionTable, values: Array, where: Mapping[str, int], missing: str | None, robot: Robot
) -> Array:
    """Return joint positions (n, nv-6); those not in the file are of the posture ``missing``."""
    if missing is not None and missing not in robot.postures:
        raise UnknownNameError(f"posture of {robot.name}", missing, robot.postures)
    absent = [name for name in robot.joint_names if name not in where]
    if absent and missing is None:
        raise RecordingError(
            f"there is no column for {', '.join(absent)}; name the posture of joints without a"
            " column (missing): standing or neutral",
            table.source,
        )
    joints = np.empty((len(values), len(robot.joint_names)))
    if missing is not None:
        joints[:] = robot.limits.joint_positions(robot.postures[missing])
    for k, name in enumerate(robot.joint_names):
        if name in where:
            joints[:, k] = values[:, where[name]]
    return joints
