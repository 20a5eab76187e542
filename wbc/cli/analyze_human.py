"""``wbc analyze`` of a human's recording: body, quality of the fit, and force plates."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import typer
from rich.console import Console
from rich.text import Text

from wbc.cli.human_options import HumanOptions
from wbc.cli.printing import heads
from wbc.errors import InvalidInputError

if TYPE_CHECKING:
    from wbc.human import Comparison, HumanMotion

WORST = 4  # markers that are named


def is_human(motion: Path, robot: str | None, options: HumanOptions) -> bool:
    """Return whether a recording is a human's.

    Raises
    ------
    InvalidInputError
        A human's with a robot, or a robot's without one, or with a human's options.
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


def analyze_human(
    path: Path,
    options: HumanOptions,
    *,
    cutoff: tuple[float | str | None] | None,
    ground: float | None,
    rate: float | None,
    noise: bool,
    feet: str | list[str] | None,
    longest_gap: float,
    output: Sequence[Path],
    plot: Path | None,
    snapshots: int | list[float],
    quiet: bool,
) -> int:
    """Analyse a human's recording and print, write and draw it; return the exit code."""
    from wbc.cli.analyze_report import print_analysis
    from wbc.cli.outputs import Outputs
    from wbc.cli.progress import shown_progress
    from wbc.human import compared
    from wbc.motion import analyze

    human = options.motion(path, ground, longest_gap=longest_gap)
    with shown_progress(quiet) as progress:
        series = analyze(
            human.motion,
            rate=rate,
            cutoff=human.cutoff if cutoff is None else cutoff[0],
            feet=feet,
            ground_height=human.ground_height,
            noise=human.noise if noise else None,
            progress=progress,
        )
    found = compared(series, human.recording.plates, human.down, human.motion.time)
    outputs = Outputs()
    for target in output:
        outputs.save(target, series.save)
    if plot is not None:
        from wbc.files import as_text
        from wbc.view.human import human_figure
        from wbc.view.style import literal, save

        body, name = human.body, literal(as_text(path.name))
        title = f"{name}: a human of {body.stature:.2f} m and {body.mass:.1f} kg"
        outputs.draw(
            plot,
            lambda picture: save(
                human_figure(series, found, title=title, snapshots=snapshots), picture
            ),
        )
    if not quiet:
        print_human(human)
        print_analysis(series, [], human=True)
        if human.recording.plates:
            print_plates(found)
        for one in outputs.written:
            typer.echo(f"wrote {one}")
    return outputs.exit_code()


def print_human(human: HumanMotion) -> None:
    """Print the human's build, the markers' residuals and the notes."""
    console, body = Console(highlight=False), human.body
    head = f"{body.sex}, {body.stature:.2f} m, {body.mass:.1f} kg"
    console.print(Text.assemble(("human    ", "dim"), head))
    by_marker = sorted(human.rms_by_marker.items(), key=lambda item: -item[1])
    worst = ", ".join(f"{name} {1e3 * rms:.1f}" for name, rms in by_marker[:WORST])
    text = f"{1e3 * human.rms:.1f} mm rms of {len(by_marker)} (largest: {worst})"
    console.print(Text.assemble(("markers  ", "dim"), text))
    for note in human.notes:
        console.print(Text.assemble(("note     ", "yellow"), note))


def print_plates(found: Comparison | None) -> None:
    """Print the motion's ground force and CoP against those of force plates."""
    console = Console(highlight=False)
    if found is None:
        text = "they never measure all of the ground's force: nothing to compare"
        console.print(Text.assemble(("plates   ", "yellow"), text))
        return
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
