"""A human's motion on a robot, and its tracking errors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wbc.gait.legs import SIDES
from wbc.motion.dropouts import runs
from wbc.retargeting.scaling import MotionScale
from wbc.retargeting.targets import Targets
from wbc.robot import Robot
from wbc.robot.series import CentroidalSeries, sole_series
from wbc.tracking.deviation import Unbalanced
from wbc.validate import Array, Bools

CONTACT_HEIGHT = 1e-3  # m: higher corners do not touch the ground


@dataclass(frozen=True)
class Reached:
    """A task's tracking error over the motion.

    Attributes
    ----------
    task:
        Its name.
    rms, largest:
        Error [``unit``].
    at:
        When it was largest [s].
    """

    task: str
    rms: float
    largest: float
    at: float
    unit: str

    def __str__(self) -> str:
        return (
            f"{self.task}: {self.rms:.3g} {self.unit} rms, {self.largest:.3g} {self.unit}"
            f" at {self.at:.2f} s"
        )


@dataclass(frozen=True, eq=False)
class Retargeted:
    """A human's motion on a robot, n frames; made by :func:`wbc.retarget`.

    World axes, the ground at z = 0, SI units, linear before angular.

    Attributes
    ----------
    robot, source:
        The robot, and the recording that the motion comes from.
    scale:
        From the human to the robot.
    time:
        (n,) [s], even, from 0.
    q, v, acceleration:
        Configurations (n, nq), velocities and their rates (n, nv).
    whole:
        CoM, momentum, inertia and their rates.
    targets:
        Of the tasks, scaled to the robot.
    wrenches:
        On the feet, left and right, at their sole frames (n, 2, 6) [N, N m].
    torque:
        Of the joints (n, nv - 6).
    cop:
        (n, 2) [m]; NaN where the motion requires no force of the ground.
    reached:
        Tracking errors by task.
    unbalanced:
        Where the motion cannot be balanced as it is, and why.
    broken:
        Violated constraints, by how much, when and where; empty if there are none.
    notes:
        What was changed, left out and guessed.
    """

    robot: Robot
    source: str
    scale: MotionScale
    time: Array
    q: Array
    v: Array
    acceleration: Array
    whole: CentroidalSeries
    targets: Targets
    wrenches: Array
    torque: Array
    cop: Array
    reached: tuple[Reached, ...]
    unbalanced: tuple[Unbalanced, ...]
    broken: tuple[Unbalanced, ...]
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        return f"Retargeted({self.robot.name!r}, {len(self.time)} frames, {self.time[-1]:.4g} s)"

    def __len__(self) -> int:
        return len(self.time)

    @property
    def contacts(self) -> Bools:
        """Which feet touch the ground (n, 2), left and right."""
        return self.targets.down

    @property
    def rate(self) -> float:
        """Frames per second [Hz]."""
        return 1.0 / self.targets.dt

    @property
    def com_correlation(self) -> Array:
        """Of the CoM's path with the human's, scaled: x, y and z (3,).

        Along an axis in which the human moves by millimetres, balance moves the robot by as much:
        there the errors in ``reached`` say more.
        """
        return correlations(self.whole.com, self.targets.human_com)

    @property
    def angular_momentum_correlation(self) -> Array:
        """Of the angular momentum with the human's, scaled: x, y and z (3,)."""
        return correlations(self.whole.momentum[:, 3:], self.targets.angular_momentum)

    @property
    def slide(self) -> float:
        """Largest displacement of a sole's corner while it touches the ground [m]."""
        return float(slides(self.robot, self.targets, self.q).max())

    def save(self, path: str | Path, layout: str = "wbc") -> None:
        """Write the motion; see :mod:`wbc.retargeting.layouts` for the layouts.

        Parameters
        ----------
        layout:
            ``wbc``, ``tracking`` (mjlab, BeyondMimic: ``.npz``) or ``unitree`` (``.csv``).

        Raises
        ------
        InvalidInputError
            Another ending than the layout's.
        UnknownNameError
            No such layout.
        OSError
            The file cannot be written.
        """
        from wbc.retargeting.layouts import save

        save(self, path, layout)


def slides(robot: Robot, targets: Targets, q: Array) -> Array:
    """Return the largest distance of a sole's corners from where they touched down (n, 2) [m].

    0 in the air. Of a foot that stands along its length only, the line's ends count.
    """
    soles = sole_series(robot, q)
    found = np.zeros((len(q), len(SIDES)))
    for number, side in enumerate(SIDES):
        path, T = targets.feet.paths[side], soles[side]
        R, place = path.rotation, path.place
        for first, end in runs(path.down):
            # The corners that touch at the wanted pitch, in axes of the sole.
            local = np.einsum("nji,nkj->nki", R, path.corners - place[:, None])[first:end]
            if side in targets.feet.line_feet:
                local[..., 1] = 0.0
            # The edge of a pointed sole is one corner: lifted corners are replaced by the lowest.
            low = np.argmin(path.corners[first:end, :, 2], axis=1)
            lifted = path.corners[first:end, :, 2] > CONTACT_HEIGHT
            lowest = local[np.arange(len(local)), low][:, None]
            local = np.where(lifted[..., None], lowest, local)
            same = np.abs(np.diff(local, axis=0)).max(axis=(1, 2)) < 1e-6
            at = local @ np.swapaxes(T[first:end, :3, :3], 1, 2) + T[first:end, None, :3, 3]
            for a, b in runs(np.concatenate((same, [False]))):
                distance = np.linalg.norm(at[a : b + 1] - at[a], axis=2).max(axis=1)
                found[first + a : first + b + 1, number] = distance
    return found


def correlations(a: Array, b: Array) -> Array:
    """Return Pearson's correlation of columns; 1 where both are constant, 0 where one is."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    squares = (a**2).sum(axis=0), (b**2).sum(axis=0)
    sizes = np.sqrt(squares[0] * squares[1])
    constant, both = sizes < 1e-12, np.where(np.maximum(*squares) < 1e-12, 1.0, 0.0)
    return np.where(constant, both, (a * b).sum(axis=0) / np.where(constant, 1.0, sizes))
