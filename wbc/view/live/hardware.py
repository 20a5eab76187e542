"""A robot's loop in the browser: estimate with its uncertainty, mode, faults, cycle times."""

from __future__ import annotations

import os
import time

import numpy as np

from wbc.hardware.log_row import FAULTS, MODES, bits_set
from wbc.hardware.ring_log import RingLog
from wbc.robot import Robot
from wbc.validate import Array
from wbc.view.live.viewer import PERIOD, Viewer


def watch_loop(robot: Robot, ring: RingLog, port: int | None = None) -> None:
    """Show a loop's log in a browser until the loop's process ends.

    ``port``: of the page; by default the first that is free from 8080 on.

    Raises MissingPackageError: viser is not installed.
    """
    loop, seen = os.getppid(), float("nan")
    with Viewer(robot, title=f"{robot.name}: hardware", port=port, steer=False) as viewer:
        while os.getppid() == loop and not viewer.closed:
            row = ring.newest()
            if row and row["time"][0] != seen and np.isfinite(row["q"]).all():
                seen = float(row["time"][0])
                snapshot = robot.snapshot(row["q"], row["v"])
                phase = str(MODES[int(row["mode"][0])])
                viewer.update(snapshot, None, seen, phase=phase, remark=remark(robot, row))
            time.sleep(PERIOD)


def remark(robot: Robot, row: dict[str, Array]) -> str:
    """Return the remarks on a row of the log, in words."""
    tilt, yaw, velocity, position = row["deviations"].tolist()
    feet = tuple(robot.feet)
    stands = ", ".join(feet[k] for k in bits_set(row["standing"][0])) or "none"
    faults = ", ".join(str(FAULTS[k]) for k in bits_set(row["faults"][0])) or "none"
    return (
        f"estimate +-{1e3 * position:.1f} mm, {1e3 * velocity:.1f} mm/s, tilt"
        f" {np.degrees(tilt):.2f}, heading {np.degrees(yaw):.2f} degrees; standing on: {stands};"
        f" cycle {1e3 * row['lateness'][0]:.2f} ms late, tick {1e3 * row['answer_time'][0]:.2f} ms;"
        f" faults: {faults}"
    )
