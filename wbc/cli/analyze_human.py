"""``wbc analyze`` of a human's recording: body, quality of the fit, and force plates."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wbc.cli.console import plain_console
from wbc.cli.human_options import HumanOptions
from wbc.cli.printing import heads, print_line
from wbc.errors import InvalidInputError

if TYPE_CHECKING:
    from wbc.human import Comparison, HumanMotion
    from wbc.motion import RmpSeries

WORST = 4  # markers that are named


def is_human(motion: Path, robot: str | None, options: HumanOptions) -> bool:
    """Return whether a recording is a human's.

    Raises InvalidInputError: a human's with a robot, or a robot's without one, or with a human's
    options.
    """
    from wbc.human import is_human_recording

    human = is_human_recording(motion)
    if human and robot is not None:
        raise InvalidInputError(f"{motion}: it is a human's recording; leave --robot out")
    if not human and robot is None:
        raise InvalidInputError(
            f"{motion}: name the robot that moves: --robot NAME or FILE; humans' recordings end in"
            " .c3d, .trc or .bvh, or are .npz with poses and trans"
        )
    if not human and options.given:
        raise InvalidInputError(f"{', '.join(options.given)}: only of a human's recording")
    return human


def beside_plates(series: RmpSeries, human: HumanMotion) -> Comparison | None:
    """Return a motion's ground force and CoP beside those of its force plates, if it has any."""
    from wbc.human import compared

    return compared(series, human.recording.plates, human.down, human.motion.time)


def print_human(human: HumanMotion) -> None:
    """Print the human's build, the markers' residuals and the notes."""
    body = human.body
    print_line("human", f"{body.sex}, {body.stature:.2f} m, {body.mass:.1f} kg")
    by_marker = sorted(human.rms_by_marker.items(), key=lambda item: -item[1])
    worst = ", ".join(f"{name} {1e3 * rms:.1f}" for name, rms in by_marker[:WORST])
    print_line("markers", f"{1e3 * human.rms:.1f} mm rms of {len(by_marker)} (largest: {worst})")
    for note in human.notes:
        print_line("note", note, "yellow")


def print_plates(found: Comparison | None) -> None:
    """Print the motion's ground force and CoP against those of force plates."""
    if found is None:
        text = "they never measure all of the ground's force: nothing to compare"
        print_line("plates", text, "yellow")
        return
    console = plain_console()
    count, both = len(found.time), int((~found.single).sum())
    table = heads("force plates, from the motion alone", "rms", "of the peak", "in the band")
    rms = np.sqrt((found.force_error**2).mean(axis=0))
    horizontal = float(np.sqrt((rms[:2] ** 2).sum()))
    held = {name: f"{100 * part:.0f} %" for name, part in found.held.items()}
    table.add_row("vertical force [N]", f"{rms[2]:.1f}", f"{100 * found.vertical:.1f} %",
                  held.get("force z", ""))  # fmt: skip
    across = " ".join(held.get(f"force {axis}", "") for axis in "xy")
    table.add_row(
        "horizontal force, x and y [N]",
        f"{horizontal:.1f}",
        f"{100 * found.horizontal:.1f} %",
        across,
    )
    cop = " ".join(held.get(f"cop {axis}", "") for axis in "xy")
    for single, name in ((True, "single"), (False, "double")):
        cop_rms = found.cop_rms(single)
        if np.isfinite(cop_rms):
            table.add_row(f"CoP in {name} support [mm]", f"{1e3 * cop_rms:.1f}", "", cop)
    console.print(table)
    span = f"{found.time[0]:.4g} s to {found.time[-1]:.4g} s"
    console.print(f"in {count} frames from {span}, {both} of them on both feet")
    if np.isfinite(found.late):
        console.print(
            f"by the vertical force the plates are {1e3 * found.late:.0f} ms later than markers"
        )
