"""``wbc analyze``: a recorded motion as its reaction mass pendulum."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbc.cli.errors import errors_in_one_line, print_notes
from wbc.cli.options import Plot, Quiet

if TYPE_CHECKING:
    from wbc.motion import RmpSeries

# Kept in step with wbc.motion, which is not imported only to print the help.
CUTOFF, LONGEST_GAP, BEYOND, SNAPSHOTS, FEET = "10", 0.1, 0.1, "6", "auto"
SHOWN_DROPOUTS = 10


class Missing(StrEnum):
    """Where joints that the file does not have stay."""

    STANDING = "standing"
    NEUTRAL = "neutral"


def analyze(
    motion: Annotated[Path, typer.Argument(help="The recording: .csv or .npz.", metavar="MOTION")],
    robot: Annotated[str, typer.Option(help="The robot: a name, or a URDF or MJCF file.")],
    planted: Annotated[
        str | None, typer.Option(help="Flat foot, if no base was recorded: left, right, auto.")
    ] = None,
    feet: Annotated[
        str, typer.Option(help="Feet that stand, as in left,right; auto: by height; or none.")
    ] = FEET,
    ground: Annotated[float, typer.Option(help="Height of the ground, in m.")] = 0.0,
    rate: Annotated[
        float | None, typer.Option(help="Rows per second of a file without times, in Hz.")
    ] = None,
    resample: Annotated[
        float | None, typer.Option(help="Frames per second of the result, in Hz.")
    ] = None,
    cutoff: Annotated[
        str, typer.Option(help="Of the zero-phase low-pass, in Hz; none or 0: no filter.")
    ] = CUTOFF,
    degrees: Annotated[
        bool, typer.Option("--degrees", help="Angles without a unit are in degrees.")
    ] = False,
    missing: Annotated[
        Missing | None, typer.Option(help="Joints without a column stay as in this posture.")
    ] = None,
    ignore: Annotated[
        list[str] | None, typer.Option(help="Columns to pass over, as in 'imu_*'; repeatable.")
    ] = None,
    beyond: Annotated[
        float, typer.Option(help="How far joints may be past their limits, in rad.")
    ] = BEYOND,
    fill: Annotated[bool, typer.Option("--fill", help="Fill NaN and frozen rows too.")] = False,
    longest_gap: Annotated[float, typer.Option(help="Longest time to fill, in s.")] = LONGEST_GAP,
    output: Annotated[
        list[Path] | None,
        typer.Option("--output", "-o", help="Write the series: .npz (all), .csv; repeatable."),
    ] = None,
    plot: Plot = None,
    snapshots: Annotated[
        str, typer.Option(help="In the picture: how many, or their times in s, as in 0,2.5,4.")
    ] = SNAPSHOTS,
    quiet: Quiet = False,
) -> None:
    """Reduce a recorded motion to its reaction mass pendulum over time."""
    with errors_in_one_line():
        from wbc.cli.outputs import Outputs
        from wbc.cli.progress import shown_progress
        from wbc.motion import analyse, read_motion
        from wbc.robot import Robot

        moments = _snapshots(snapshots)
        low_pass = _cutoff(cutoff)
        _check_outputs(motion, output or [], plot, moments)
        loaded = Robot.load(robot)
        if not quiet:
            print_notes(loaded)
        recording = read_motion(
            motion,
            loaded,
            rate=rate,
            degrees=degrees,
            missing=missing.value if missing else None,
            ignore=ignore or (),
            beyond=beyond,
            fill=fill,
            longest_gap=longest_gap,
        )
        with shown_progress(quiet) as progress:
            series = analyse(
                recording,
                rate=resample,
                cutoff=low_pass,
                planted=planted,
                feet=_feet(feet),
                ground_height=ground,
                progress=progress,
            )
        outputs = Outputs()
        for path in output or []:
            outputs.save(path, series.save)
        if plot is not None:
            outputs.draw(plot, lambda picture: _draw(series, picture, moments))
        if not quiet:
            _print(series, low_pass is not None, outputs.written)
        code = outputs.exit_code()
    raise typer.Exit(code)


def _cutoff(text: str) -> float | None:
    if text.lower() in ("none", "0"):
        return None
    return _number("--cutoff (Hz, or none)", text) or None


def _number(option: str, text: str) -> float:
    """Return the number >= 0 that an option's text spells."""
    from wbc.validate import finite_number

    try:
        value: object = float(text)
    except ValueError:
        value = text  # refused by its name
    return finite_number(option, value, least=0.0)


def _feet(text: str) -> str | list[str] | None:
    if text in ("auto", "none"):
        return text if text == "auto" else None
    return [name.strip() for name in text.split(",") if name.strip()]


def _snapshots(text: str) -> int | list[float]:
    if text.strip().isdecimal():
        return int(text)
    return [_number("--snapshots (how many, or times in s)", t) for t in text.split(",")]


def _check_outputs(
    motion: Path, outputs: list[Path], plot: Path | None, snapshots: int | list[float]
) -> None:
    """Raise InvalidInputError for what could never be written, before any work is done."""
    from wbc.cli.outputs import check_picture, check_place
    from wbc.errors import InvalidInputError
    from wbc.motion.series import series_format

    for path in outputs:
        if path.exists() and motion.exists() and path.samefile(motion):
            raise InvalidInputError(f"--output {path}: is the recording itself; name another file")
        series_format(path)
        check_place("--output", path)
    if plot is not None:
        check_picture("--plot", plot)
        from wbc.view.analysis import check_snapshots

        check_snapshots(snapshots)


def _draw(series: RmpSeries, path: Path, snapshots: int | list[float]) -> None:
    from wbc.view.analysis import plot_analysis

    title = f"{Path(series.source).name}: {series.robot.name}, {series.robot.mass:.1f} kg"
    title += "; forces as measured" if series.measured else ""
    plot_analysis(series, path, title=title, snapshots=snapshots)


# ---------------------------------------------------------------------- what is printed


def _print(series: RmpSeries, filtered: bool, written: list[Path]) -> None:
    """Print what the motion came to, and what it lacked."""
    import numpy as np
    from rich.console import Console
    from rich.text import Text

    from wbc.cli.printing import heads, print_written

    console = Console(highlight=False)
    seconds = float(series.time[-1] - series.time[0])
    rate = (len(series) - 1) / seconds
    head = Text(Path(series.source).name, style="bold")
    head.append(
        f": {series.robot.name}, {series.robot.mass:.2f} kg, {len(series)} frames,"
        f" {seconds:.2f} s at {rate:.4g} Hz",
        style="not bold default",
    )
    console.print(head)
    for dropout in series.dropouts[:SHOWN_DROPOUTS]:
        console.print(Text.assemble(("dropout  ", "yellow"), str(dropout)))
    if len(series.dropouts) > SHOWN_DROPOUTS:
        console.print(f"and {len(series.dropouts) - SHOWN_DROPOUTS} more dropouts")
    for name, excess in series.past_limits.items():
        text = f"{name} is up to {excess:.3g} past its limits [rad or m]"
        console.print(Text.assemble(("limits   ", "yellow"), text))
    table = heads("", "least", "mean", "largest")
    for name, scale, values in _rows(series):
        known = scale * values[np.isfinite(values)]
        if known.size:
            numbers = (known.min(), known.mean(), known.max())
            table.add_row(Text(name), *(f"{number:.4g}" for number in numbers))
    console.print(table)
    console.print()
    console.print(_verdict(series, filtered))
    print_written(console, written, 9)


def _rows(series: RmpSeries) -> Iterator[tuple[str, float, Any]]:
    """Yield name with unit, factor to that unit, and values (n,) of each row of the table."""
    import numpy as np

    for k, axis in enumerate("xyz"):
        yield f"CoM {axis} [mm]", 1e3, series.com[:, k]
    for k, axis in enumerate("xy"):
        yield f"CoP {axis} [mm]", 1e3, series.cop[:, k]
    yield "CMP to CoP [mm]", 1e3, np.linalg.norm(series.cmp - series.cop, axis=1)
    if series.cop_margin is not None:
        yield "CoP inside the support by [mm]", 1e3, series.cop_margin
    yield "push of the ground [N]", 1.0, series.ground_force[:, 2]
    if series.measured:
        residual = np.linalg.norm(series.force_residual, axis=1)
        yield "measured force to M (c'' - g) [N]", 1.0, residual
    yield "leg length [mm]", 1e3, series.leg_length
    for k in range(3):
        yield f"radius r{k + 1} [mm]", 1e3, series.radii[:, k]
    momentum, axes = series.average_angular_velocity, series.axes_angular_velocity
    yield "turning by momentum, I^-1 k [rad/s]", 1.0, np.linalg.norm(momentum, axis=1)
    yield "turning of the axes [rad/s]", 1.0, np.linalg.norm(axes, axis=1)


def _verdict(series: RmpSeries, filtered: bool) -> Any:
    """Return a line about CoP, flight and axes, after a low-pass or not."""
    import numpy as np
    from rich.text import Text

    count = len(series)
    line = Text()
    unjudged = int(series.cop_unknown.sum())
    judged = series.cop_margin is not None and bool(np.isfinite(series.cop_margin).any())
    if series.cop_margin is None:
        line.append("CoP not judged: no feet. ")
    elif unjudged and not judged:
        line.append(
            "CoP not judged: no sole is ever flat on the ground; look at --ground, and at the unit"
            " of the base and the order of its quaternion. ",
            style="yellow",
        )
    elif series.cop_outside.any():
        first, farthest = series.time[series.cop_outside][0], -np.nanmin(series.cop_margin)
        # What was measured was possible: of a recorded simulation 4.2 mm, without filter 0.02 mm.
        why = "the motion is infeasible there"
        if series.measured:
            why = "it was measured, so the forces, the soles' shape or the ground's height are off"
            if filtered:
                why = "it was measured, so see by --cutoff none how much of that the filter does"
        line.append(
            f"CoP outside the support polygon in {series.cop_outside.sum()} of {count} frames, by"
            f" {1e3 * farthest:.2g} mm at most, first at {first:.12g} s: {why}. ",
            style="yellow" if series.measured else "red",
        )
    else:
        line.append("CoP inside the support polygon wherever there is one. ", style="green")
    if unjudged and judged:
        line.append(f"In {unjudged} of {count} frames no sole is flat on the ground. ")
    if series.flight.any():
        line.append(f"The ground does not push in {series.flight.sum()} of {count} frames. ")
    undefined = int((~series.axes_defined.all(axis=1)).sum())
    if undefined:
        line.append(f"Principal axes undefined in {undefined} frames.")
    return line
