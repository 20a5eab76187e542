"""Measured forces at the soles of a recording, and the ground's wrench by them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wbc.errors import InvalidInputError
from wbc.motion.columns import kept_columns
from wbc.motion.table import NUMBERS, MotionTable, RecordingError, read_recorded
from wbc.robot import Robot
from wbc.robot.series import CentroidalSeries
from wbc.tasks.force_task import WRENCH
from wbc.validate import Array, finite_array, read_only, real_array, set_fields

PREFIX = "forces/"


@dataclass(frozen=True, eq=False)
class MeasuredForces:
    """Wrenches of the ground on the feet.

    Raises InvalidInputError: arrays of other shapes, or not finite.
    """

    time: Array  # (n,) [s], increasing
    # By foot: (n, 6) force [N] and moment [N m] at the origin of its sole's frame, world axes.
    wrenches: Mapping[str, Array]

    def __post_init__(self) -> None:
        count = real_array("measured forces, time", self.time).size
        found = {
            foot: read_only(finite_array(f"measured forces, {foot}", wrench, (count, 6)))
            for foot, wrench in self.wrenches.items()
        }
        time = read_only(finite_array("measured forces, time", self.time, (count,)))
        set_fields(self, time=time, wrenches=found)


def read_forces(
    path: Path, table: MotionTable, robot: Robot, time: Array, ignore: Sequence[str]
) -> MeasuredForces | None:
    """Return the forces that ``wbc sim -o FILE`` wrote for the soles, or None without any.

    ``table``: the numbers of the file; those of an NPZ file lack the forces.
    ``time``: (n,) of the file's rows [s].
    ``ignore``: columns to ignore; shell-style patterns.

    Raises RecordingError: arrays of other shapes, or not finite.
    """
    feet = {f"{PREFIX}{foot.frame}": name for name, foot in robot.feet.items()}
    if path.suffix.lower() == ".npz":
        arrays = read_recorded(path, lambda _: feet.keys(), lambda _: NUMBERS)
    else:
        kept = reversed(kept_columns(table, ignore))  # of columns of one name the first
        where = {table.columns[k].partition(" [")[0]: k for k in kept}
        named = {foot: [f"{foot}/{row}" for row in WRENCH] for foot in feet}
        arrays = {
            foot: table.values[:, [where[name] for name in names]]
            for foot, names in named.items()
            if where.keys() >= set(names)
        }
    if not arrays:
        return None
    try:
        return MeasuredForces(time, {feet[name]: array for name, array in arrays.items()})
    except InvalidInputError as error:
        raise RecordingError(str(error), str(path)) from error


def ground_wrench(wrenches: Mapping[str, Array], whole: CentroidalSeries) -> tuple[Array, Array]:
    """Return force [N] and moment about the CoM [N m], both (m, 3), of wrenches on the feet."""
    force, moment = np.zeros_like(whole.com), np.zeros_like(whole.com)
    for foot, wrench in wrenches.items():
        force += wrench[:, :3]
        arm = whole.soles[foot][:, :3, 3] - whole.com
        moment += wrench[:, 3:] + np.cross(arm, wrench[:, :3])
    return force, moment
