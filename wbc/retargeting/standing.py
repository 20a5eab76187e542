"""Motions on both feet, without steps: a robot can follow these as they are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wbc.errors import InvalidInputError, shown
from wbc.files import ArrayFileError, read_arrays
from wbc.gait.legs import SIDES
from wbc.retargeting.cop_correction import SupportedFrames, supports
from wbc.retargeting.result import Retargeted
from wbc.robot import Robot
from wbc.robot.series import sole_series
from wbc.validate import Array, Bools, finite_array, read_only

ARRAYS = {"time": "f", "q": "f", "contacts": "b", "joint_names": "U"}  # and NumPy's kinds
MAX_BYTES = 2**30  # of a file's arrays
# Of soles from their first frame [m], from the ground [m], and of their tilt [rad].
MAX_SLIDING, MAX_HEIGHT, MAX_TILT = 5e-3, 5e-3, 0.02
MIN_FRAMES = 4
STEPS_HINT = "for steps see wbc.retargeting.steps.footsteps(motion, count)"


@dataclass(frozen=True, eq=False)
class StandingMotion:
    """A robot's motion on both feet, n frames; soles lie flat on the ground z = 0 all the time.

    Made by :meth:`of` or :meth:`read`.

    Attributes
    ----------
    robot, source:
        The robot, and where the motion comes from.
    time:
        (n,) [s], increasing, from 0.
    q:
        Configurations (n, nq).
    """

    robot: Robot
    source: str
    time: Array
    q: Array

    @classmethod
    def of(cls, motion: Retargeted) -> StandingMotion:
        """Return a retargeted motion as one that stands.

        Raises
        ------
        InvalidInputError
            A foot leaves the ground, moves on it or rolls: the message says which, when and by how
            much.
        """
        if not isinstance(motion, Retargeted):
            raise InvalidInputError(
                f"standing motion: expected what wbc.retarget(...) returns, got {shown(motion)}"
            )
        return _checked(motion.robot, motion.source, motion.time, motion.q, motion.contacts)

    @classmethod
    def read(cls, path: str | Path, robot: Robot) -> StandingMotion:
        """Return the motion of a file that ``motion.save("motion.npz")`` wrote.

        Raises
        ------
        InvalidInputError
            No such file, another one, of another robot, or see :meth:`of`.
        """
        try:
            arrays = read_arrays(
                path, lambda names: set(names) & set(ARRAYS), lambda n: ARRAYS[n], MAX_BYTES
            )
        except OSError as error:
            raise InvalidInputError(f"{path}: {error.strerror or error}") from error
        for name in ARRAYS:
            if name not in arrays:
                hint = "write a motion with wbc retarget RECORDING --robot NAME -o motion.npz"
                raise ArrayFileError(path, f"it has no array {name!r}; {hint}")
        if tuple(arrays["joint_names"].ravel().tolist()) != robot.joint_names:
            raise InvalidInputError(
                f"{path}: its joints are not those of {robot.name}, in their order; retarget the"
                " recording to this robot"
            )
        count = len(arrays["time"].ravel())
        if arrays["contacts"].shape != (count, len(SIDES)):
            raise ArrayFileError(path, f"expected shape {(count, len(SIDES))}", "contacts")
        time = finite_array(f"{path}: time", arrays["time"], (count,))
        q = finite_array(f"{path}: q", arrays["q"], (count, robot.nq))
        return _checked(robot, Path(path).name, time, q, arrays["contacts"])

    @property
    def start(self) -> Array:
        """The first configuration (nq,)."""
        return self.q[0]

    def stands(self, q: Array) -> tuple[SupportedFrames, ...]:
        """Return the supports of other configurations (n, nq), where their soles are."""
        soles, corners = sole_series(self.robot, q), {}
        for side in SIDES:
            polygon = self.robot.feet[side].polygon
            flat = np.column_stack((polygon, np.zeros(len(polygon))))
            T = soles[side]
            corners[side] = flat @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
            corners[side] = np.round(corners[side], 4)  # soles at rest are one support
        return supports(corners, np.ones((len(q), len(SIDES)), dtype=bool))


def _checked(robot: Robot, source: str, time: Array, q: Array, contacts: Bools) -> StandingMotion:
    if len(time) < MIN_FRAMES or (np.diff(time) <= 0.0).any():
        raise InvalidInputError(
            f"{source}: expected {MIN_FRAMES} frames at least, in order of time; it has {len(time)}"
        )
    for n, side in enumerate(SIDES):
        if side not in robot.feet:
            raise InvalidInputError(f"{source}: {robot.name} has no {side} foot to stand on")
        if not contacts[:, n].all():
            at = float(time[int(np.argmin(contacts[:, n]))])
            raise InvalidInputError(
                f"{source}: the {side} foot leaves the ground at {at:.2f} s: no motion on both"
                f" feet; {STEPS_HINT}"
            )
    q = np.array([robot.check_configuration(one) for one in q])
    soles = sole_series(robot, q)
    for side in SIDES:
        T = soles[side]
        for what, by, most, unit in (
            ("moves", np.linalg.norm(T[:, :3, 3] - T[0, :3, 3], axis=1), MAX_SLIDING, "m"),
            ("is off the ground", np.abs(T[:, 2, 3]), MAX_HEIGHT, "m"),
            ("rolls", np.arccos(np.clip(T[:, 2, 2], -1.0, 1.0)), MAX_TILT, "rad"),
        ):
            worst = int(np.argmax(by))
            if by[worst] > most:
                raise InvalidInputError(
                    f"{source}: the {side} foot {what} by {by[worst]:.2g} {unit} at"
                    f" {time[worst]:.2f} s; only soles that lie still are held: retarget with"
                    " roll 0"
                )
    return StandingMotion(robot, source, read_only(time - time[0]), read_only(q))
