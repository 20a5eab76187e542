"""``wbc analyze``: a recorded motion as its reaction mass pendulum."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbc.cli import human_options
from wbc.cli.errors import print_notes
from wbc.cli.options import Plot, Quiet

if TYPE_CHECKING:
    from wbc.human import HumanMotion
    from wbc.motion import RmpSeries

# Kept in step with wbc.motion, which is not imported only to print the help.
CUTOFF, LONGEST_GAP, BEYOND, SNAPSHOTS, FEET = "10", 0.1, 0.1, "6", "auto"
# Of a robot's recording only.
ROBOTS = ("planted", "rate", "degrees", "missing", "ignore", "beyond", "fill")


class Missing(StrEnum):
    """Posture of joints that the file does not have."""

    STANDING = "standing"
    NEUTRAL = "neutral"


class NoiseOption(StrEnum):
    """The noise of the recording."""

    ESTIMATED = "estimated"
    NONE = "none"


def analyze(
    motion: Annotated[
        Path,
        typer.Argument(
            help="A robot's recording, .csv or .npz; or a human's, .c3d, .trc, .bvh, .csv of rigid"
            " bodies, or .npz of SMPL poses.",
            metavar="MOTION",
        ),
    ],
    context: typer.Context,
    robot: Annotated[
        str | None,
        typer.Option(help="The robot: a name, or a URDF or MJCF file; none for a human."),
    ] = None,
    planted: Annotated[
        str | None, typer.Option(help="Flat foot, if no base was recorded: left, right, auto.")
    ] = None,
    feet: Annotated[
        str,
        typer.Option(
            help="Feet that stand, as in left,right; auto: by height and sliding; or none."
        ),
    ] = FEET,
    ground: Annotated[
        float | None,
        typer.Option(help="Height of the ground, in m; by default 0, or where a human stands."),
    ] = None,
    rate: Annotated[
        float | None, typer.Option(help="Rows per second of a file without times, in Hz.")
    ] = None,
    resample: Annotated[
        float | None, typer.Option(help="Frames per second of the result, in Hz.")
    ] = None,
    cutoff: Annotated[
        str | None,
        typer.Option(
            help="Of the zero-phase low-pass, in Hz; none or 0: no filter; residual: as high as"
            f" the recording's noise allows. By default {CUTOFF}; a human's by the steps."
        ),
    ] = None,
    noise: Annotated[
        NoiseOption,
        typer.Option(help="Estimated from the recording, for bands and verdicts; none: no bands."),
    ] = NoiseOption.ESTIMATED,
    degrees: Annotated[
        bool, typer.Option("--degrees", help="Angles without a unit are in degrees.")
    ] = False,
    missing: Annotated[
        Missing | None, typer.Option(help="Joints without a column stay as in this posture.")
    ] = None,
    ignore: Annotated[
        list[str] | None, typer.Option(help="Columns to ignore, as in 'imu_*'; repeatable.")
    ] = None,
    beyond: Annotated[
        float, typer.Option(help="How far joints may be past their limits, in rad.")
    ] = BEYOND,
    fill: Annotated[bool, typer.Option("--fill", help="Fill NaN and frozen rows too.")] = False,
    longest_gap: Annotated[float, typer.Option(help="Longest gap to fill, in s.")] = LONGEST_GAP,
    output: Annotated[
        list[Path] | None,
        typer.Option("--output", "-o", help="Write the series: .npz (all), .csv; repeatable."),
    ] = None,
    plot: Plot = None,
    snapshots: Annotated[
        str, typer.Option(help="In the picture: how many, or their times in s, as in 0,2.5,4.")
    ] = SNAPSHOTS,
    quiet: Quiet = False,
    static: human_options.Static = None,
    forces: human_options.Forces = None,
    subject: human_options.Subject = None,
    mass: human_options.Mass = None,
    stature: human_options.Stature = None,
    sex: human_options.Sex = human_options.SEX,
    up: human_options.Up = None,
    unit: human_options.Unit = None,
) -> None:
    """Reduce a recorded motion to its reaction mass pendulum over time."""
    from wbc.cli.analyze_human import is_human
    from wbc.cli.outputs import Outputs
    from wbc.cli.progress import shown_progress
    from wbc.motion import analyze, read_motion
    from wbc.robot import Robot

    snapshot_times = _snapshots(snapshots)
    low_pass = _cutoff(CUTOFF if cutoff is None else cutoff)
    _check_outputs(motion, output or [], plot, snapshot_times)
    options = human_options.HumanOptions(static, forces, subject, mass, stature, sex, up, unit)
    human: HumanMotion | None = None
    how: dict[str, Any]
    if is_human(motion, robot, options):
        _refuse_robot_options(context)
        human = options.motion(motion, ground, longest_gap=longest_gap)
        recording, how = human.motion, {"ground_height": human.ground_height, "noise": human.noise}
        how["cutoff"] = human.cutoff if cutoff is None else low_pass
    else:
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
        how = {"ground_height": ground or 0.0, "noise": noise.value, "cutoff": low_pass}
    if noise is NoiseOption.NONE:
        how["noise"] = None
    with shown_progress(quiet) as progress:
        series = analyze(
            recording, rate=resample, planted=planted, feet=_feet(feet), **how, progress=progress
        )
    outputs = Outputs()
    for path in output or []:
        outputs.save(path, series.save)
    if plot is not None:
        outputs.draw(plot, lambda picture: _draw(series, human, picture, snapshot_times))
    if not quiet:
        _print(series, human, outputs.written)
    raise typer.Exit(outputs.exit_code())


def _refuse_robot_options(context: typer.Context) -> None:
    """Raise InvalidInputError for options that have no effect on a human's recording."""
    from wbc.errors import InvalidInputError

    sources = {name: context.get_parameter_source(name) for name in ROBOTS}
    given = [f"--{name}" for name, by in sources.items() if by and by.name == "COMMANDLINE"]
    if given:
        raise InvalidInputError(f"{', '.join(given)}: only of a robot's recording, with --robot")


def _cutoff(text: str) -> float | str | None:
    if text.lower() in ("none", "0"):
        return None
    if text.lower() == "residual":
        return "residual"
    return _number("--cutoff (Hz, none or residual)", text) or None


def _number(option: str, text: str) -> float:
    """Return the number >= 0 of an option's text."""
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
    """Raise InvalidInputError for outputs that cannot be written, before any work is done."""
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
    elif snapshots != int(SNAPSHOTS):
        raise InvalidInputError("--snapshots: are of the picture; name it with --plot")


def _draw(
    series: RmpSeries, human: HumanMotion | None, path: Path, snapshots: int | list[float]
) -> None:
    from wbc.cli.analyze_human import beside_plates
    from wbc.files import as_text
    from wbc.view.analysis import analysis_figure
    from wbc.view.human import human_figure
    from wbc.view.style import literal, save

    name = literal(as_text(Path(series.source).name))
    if human is None:
        title = f"{name}: {series.robot.name}, {series.robot.mass:.1f} kg"
        title += "; forces as measured" if series.measured else ""
        figure = analysis_figure(series, title=title, snapshots=snapshots)
    else:
        title = f"{name}: a human of {human.body.stature:.2f} m and {human.body.mass:.1f} kg"
        plates = beside_plates(series, human)
        figure = human_figure(series, plates, title=title, snapshots=snapshots)
    save(figure, path)


def _print(series: RmpSeries, human: HumanMotion | None, written: list[Path]) -> None:
    from wbc.cli.analyze_human import beside_plates, print_human, print_plates
    from wbc.cli.analyze_report import print_analysis
    from wbc.cli.printing import print_written

    if human is not None:
        print_human(human)
    print_analysis(series, human)
    if human is not None and human.recording.plates:
        print_plates(beside_plates(series, human))
    print_written(written, 9)
