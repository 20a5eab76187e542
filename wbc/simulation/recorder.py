"""The record of a simulation, by control period, as arrays and files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.controllers.torque_tick import TorqueTick
from wbc.robot.series import revolute_joints
from wbc.run.columns import Column, configuration_columns, velocity_columns
from wbc.run.saving import save_result
from wbc.simulation.plant import Plant
from wbc.validate import Array

WRENCH = ("fx [N]", "fy [N]", "fz [N]", "mx [N m]", "my [N m]", "mz [N m]")
PLACE = ("x [m]", "y [m]", "z [m]")
_MISSING = (np.nan, np.nan, np.nan)


class Recorder:
    """Records a plant after each of its steps; ``wbc analyze`` reads what it saves.

    The first row is the state at which it is made. Arrays, one row each:

    ``time`` (n,) [s], ``q`` (n, nq), ``v`` (n, nv): the true state.
    ``torque`` (n, nv-6): commanded for the period that ended then [N m or N].
    ``forces/FRAME`` (n, 6): true ones on each sole, at its frame's origin, world axes; of the
    physics' last step. ``cop`` (n, 3): of all contacts but walls [m], NaN in the air.
    ``planned_forces/FRAME``, ``planned_cop``: those of the controller's tick, NaN without one.
    ``wrenches/FRAME`` (n, 6): of :meth:`Plant.apply`, means over the period, at the frame's origin,
    world axes.
    ``relaxed`` (n,): whether the tick was relaxed. ``push`` (n, 3): sum of pushes [N].
    ``joint_names`` (nv-6,): of the columns of ``torque``.
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._rows: list[dict[str, Any]] = []
        self.add()

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, tick: TorqueTick | None = None) -> None:
        """Record the plant as it is now, after the step that ``tick`` commanded."""
        plant, cop = self._plant, self._plant.cop
        q, v = plant.state()
        row: dict[str, Any] = {"time": plant.time, "q": q, "v": v, "torque": plant.torque}
        planned, unplanned = ({}, np.nan) if tick is None else (tick.forces, 0.0)
        for frame, wrench in plant.contact_forces.items():
            row[f"forces/{frame}"] = wrench
            row[f"planned_forces/{frame}"] = planned.get(frame, np.full(6, unplanned))
        row["cop"] = _MISSING if cop is None else cop
        row["planned_cop"] = _MISSING if tick is None or tick.cop is None else tick.cop
        row["relaxed"] = tick is not None and bool(tick.policy)
        row["push"] = plant.push_force
        for frame, wrench in plant.applied.items():
            row[f"wrenches/{frame}"] = wrench
        self._rows.append(row)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return everything recorded, by name."""
        names = dict.fromkeys(name for row in self._rows for name in row)
        no_wrench = np.zeros(6)
        arrays: dict[str, NDArray[Any]] = {
            name: np.array([row.get(name, no_wrench) for row in self._rows]) for name in names
        }
        arrays["joint_names"] = np.array(self._plant.robot.joint_names)
        return arrays

    def columns(self) -> list[Column]:
        """Return a table: columns that :func:`wbc.read_motion` knows, then names with a slash."""
        arrays, robot = self.arrays(), self._plant.robot
        table: list[Column] = [
            ("time [s]", arrays["time"]),
            *configuration_columns(robot, arrays["q"]),
            *velocity_columns(robot, arrays["v"]),
        ]
        turning = zip(robot.joint_names, revolute_joints(robot), strict=True)
        units = [f"{name} [{'N m' if turns else 'N'}]" for name, turns in turning]
        table += _split("torque", units, arrays["torque"])
        for name, array in arrays.items():
            if name.partition("/")[0] in ("forces", "planned_forces", "wrenches"):
                table += _split(name, WRENCH, array)
            elif name in ("cop", "planned_cop"):
                table += _split(name, PLACE, array)
        return table

    def save(self, path: str | Path, summary: Mapping[str, Any] | None = None) -> None:
        """Write ``.npz``, a table as ``.csv``, or the summary as ``.json``; whole or not at all.

        ``summary`` is merged into the recorder's own.

        Raises
        ------
        InvalidInputError
            Another ending.
        OSError
            The file cannot be written.
        """
        plant = self._plant
        saturated = zip(plant.robot.joint_names, plant.saturated.tolist(), strict=True)
        own = {
            "robot": plant.robot.name,
            "mass": plant.robot.mass,
            "dt": plant.dt,
            "physics_dt": plant.physics_dt,
            "duration": plant.time,
            "saturated": {name: count for name, count in saturated if count},
            "notes": list(plant.notes),
        }
        save_result(path, {**own, **(summary or {})}, self.arrays, self.columns)


def _split(name: str, parts: Sequence[str], array: Array) -> list[Column]:
    return [(f"{name}/{part}", array[:, k]) for k, part in enumerate(parts)]
