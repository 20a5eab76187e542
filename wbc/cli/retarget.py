"""``wbc retarget``: a recorded human's motion on a humanoid."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbc.cli import human_options
from wbc.cli.errors import print_notes
from wbc.cli.options import Quiet, robots_beginning

if TYPE_CHECKING:
    from wbc.retargeting import Retargeted

# Kept in step with wbc.retargeting, which is not imported only to print the help.
RATE, DURATION, FRICTION, MARGIN = 50.0, "froude", 0.6, 0.01
ROLL = 1.0
HUMAN = tuple(each.name for each in fields(human_options.HumanOptions))
# Keywords of wbc.retarget.
KEYWORDS = ("rate", "duration", "cutoff", "roll", "balance", "friction", "margin", "links")
MCAP = "mcap"


class FileLayout(StrEnum):
    """What a file holds."""

    WBC = "wbc"
    TRACKING = "tracking"
    UNITREE = "unitree"


def retarget(
    motion: Annotated[
        Path,
        typer.Argument(
            help="A human's recording: .c3d, .trc, .bvh, .csv of rigid bodies, or .npz of SMPL"
            " poses; or a .yaml of one and of these options.",
            metavar="MOTION",
        ),
    ],
    context: typer.Context,
    robot: Annotated[
        str | None,
        typer.Option(
            help="The robot: a name, or a URDF or MJCF file.", autocompletion=robots_beginning
        ),
    ] = None,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output", "-o", help="Write the robot's motion, .npz, .csv or .mcap; repeatable."
        ),
    ] = None,
    layout: Annotated[
        FileLayout | None,
        typer.Option(
            help="Of the files: wbc (.npz, all), tracking (.npz, as mjlab and BeyondMimic read),"
            " unitree (.csv, as the retargeted LAFAN1); by default wbc, of a .csv unitree."
        ),
    ] = None,
    rate: Annotated[float, typer.Option(help="Frames per second, in Hz.")] = RATE,
    duration: Annotated[
        str,
        typer.Option(
            help="froude: times scale with the square root of lengths; kept: the human's; or a"
            " factor."
        ),
    ] = DURATION,
    cutoff: Annotated[
        float | None, typer.Option(help="Of the human's low-pass, in Hz; by default by the steps.")
    ] = None,
    roll: Annotated[
        float,
        typer.Option(help="Part of the pitch of the human's feet, 0 to 1; 0: soles always level."),
    ] = ROLL,
    balance: Annotated[
        bool, typer.Option(help="Move the CoM so that the CoP is where feet stand.")
    ] = True,
    friction: Annotated[
        float, typer.Option(help="Friction coefficient, to check the motion.")
    ] = FRICTION,
    margin: Annotated[float, typer.Option(help="Least distance between bodies, in m.")] = MARGIN,
    link: Annotated[
        list[str] | None,
        typer.Option(
            help="Frame of the robot for a part of the body, as in head=neck_link; repeatable."
        ),
    ] = None,
    problem: Annotated[
        Path | None,
        typer.Option(
            help="Write a .yaml for wbc sim in which the robot follows the motion in physics, on"
            " both feet; next to the motion (-o motion.npz)."
        ),
    ] = None,
    view: Annotated[
        bool,
        typer.Option("--view", help="Play it in the browser, the human beside it (extra view)."),
    ] = False,
    quiet: Quiet = False,
    ground: Annotated[
        float | None, typer.Option(help="Height of the human's ground, in m.")
    ] = None,
    static: human_options.Static = None,
    forces: human_options.Forces = None,
    subject: human_options.Subject = None,
    mass: human_options.Mass = None,
    stature: human_options.Stature = None,
    sex: human_options.Sex = human_options.SEX,
    up: human_options.Up = None,
    unit: human_options.Unit = None,
) -> None:
    """Make a humanoid move as a recorded human: feet, CoM, momentum, ellipsoid, trunk and arms."""
    from wbc.cli.outputs import Outputs, check_place
    from wbc.cli.progress import shown_progress
    from wbc.errors import InvalidInputError
    from wbc.extras import require
    from wbc.files import write_text
    from wbc.retargeting import retarget as retargeted
    from wbc.retargeting.layouts import check_layout
    from wbc.robot import Robot
    from wbc.view.mcap_export import mcap_format, write_retargeted

    if view:
        require("viser", "wbc retarget --view")
    written = [(path, _layout(path, layout)) for path in output or []]
    for path, kind in written:
        if kind == MCAP:
            mcap_format(path)
        else:
            check_layout(path, kind)
        check_place("--output", path)
    if problem is not None:
        _check_problem(problem, written)
    given: dict[str, Any] = {
        "motion": motion, "robot": robot, "static": static, "forces": forces,
        "subject": subject, "mass": mass, "stature": stature, "sex": sex, "up": up,
        "unit": unit, "ground": ground, "rate": rate, "duration": _duration(duration),
        "cutoff": cutoff, "roll": roll, "balance": balance, "friction": friction,
        "margin": margin, "links": _links(link or []),
    }  # fmt: skip
    if motion.suffix.lower() in (".yaml", ".yml"):
        given |= _options_of_file(motion, given.keys(), context)
    if given["robot"] is None:
        raise InvalidInputError("--robot: name the robot that is to move as the human")
    loaded = Robot.load(given["robot"])
    if not quiet:
        print_notes(loaded)
    human = human_options.HumanOptions(**{name: given[name] for name in HUMAN}).motion(
        given["motion"],
        given["ground"],
        by_steps=False,  # a robot balances by itself
    )
    with shown_progress(quiet) as progress:
        keywords = {key: given[key] for key in KEYWORDS}
        found = retargeted(human, loaded, **keywords, progress=progress)
    outputs = Outputs()
    for path, kind in written:
        if kind == MCAP:
            outputs.save(path, lambda place: write_retargeted(found, place))
        else:
            outputs.save(path, lambda place, kind=kind: found.save(place, kind))  # type: ignore[misc]
    if problem is not None:
        text = _problem(found, problem, written, given)
        outputs.save(problem, lambda place: write_text(place, text))
    if not quiet:
        from wbc.cli.analyze_human import print_human
        from wbc.cli.analyze_report import print_dropouts
        from wbc.cli.printing import print_written

        print_human(human)
        print_dropouts(human.motion.dropouts)
        print_retargeted(found)
        print_written(outputs.written, 9)
    code = outputs.exit_code()
    if view:
        from wbc.view.live.retargeted import view_retargeted

        viewer = view_retargeted(human, found)
        typer.echo("Ctrl-C ends it", err=True)
        viewer.wait()
        if viewer.error:
            typer.echo(viewer.error, err=True)
    raise typer.Exit(code)


def _options_of_file(path: Path, keys: Iterable[str], context: typer.Context) -> dict[str, Any]:
    """Return the options of a file, except those given on the command line."""
    from wbc.problem.retarget import load_retarget

    names = {key: "link" if key == "links" else key for key in keys}
    sources = {key: context.get_parameter_source(name) for key, name in names.items()}
    overridden = {key for key, by in sources.items() if by and by.name == "COMMANDLINE"}
    return {
        key: value
        for key, value in load_retarget(path).items()
        if key not in overridden - {"motion"}
    }


def _check_problem(path: Path, written: list[tuple[Path, str]]) -> None:
    """Refuse a problem file with another ending, or without a written motion."""
    from wbc.cli.outputs import check_place
    from wbc.errors import InvalidInputError

    if path.suffix.lower() not in (".yaml", ".yml"):
        raise InvalidInputError(f"--problem {path}: is written as .yaml")
    if not any(kind == "wbc" for _, kind in written):
        raise InvalidInputError(f"--problem {path}: needs the motion's file; give -o motion.npz")
    check_place("--problem", path)


def _problem(
    found: Retargeted, path: Path, written: list[tuple[Path, str]], given: dict[str, Any]
) -> str:
    import os

    from wbc.problem.standing_problem import standing_problem
    from wbc.retargeting import body_map
    from wbc.retargeting.standing import StandingMotion
    from wbc.robot.library import is_file_name

    folder = path.resolve().parent
    file = next(place for place, kind in written if kind == "wbc")
    model = str(given["robot"])
    return standing_problem(
        StandingMotion.of(found),
        os.path.relpath(file.resolve(), folder),
        model=str(Path(model).resolve()) if is_file_name(model) else model,
        trunk=body_map(found.robot, given["links"]).trunk,
        name=path.name,
    )


def _layout(path: Path, layout: FileLayout | None) -> str:
    if path.suffix.lower() == ".mcap":
        return MCAP
    if layout is not None:
        return layout.value
    return "unitree" if path.suffix.lower() == ".csv" else "wbc"


def _links(given: list[str]) -> dict[str, str]:
    from wbc.errors import InvalidInputError

    found = {}
    for text in given:
        part, equals, frame = text.partition("=")
        if not equals or not frame:
            raise InvalidInputError(f"--link {text}: expected PART=FRAME, as in head=neck_link")
        found[part.strip()] = frame.strip()
    return found


def _duration(text: str) -> str | float:
    try:
        return float(text)
    except ValueError:
        return text  # a word, or refused later


def print_retargeted(found: Retargeted) -> None:
    """Print scale, notes, tracking errors, violations, and what cannot be balanced."""
    from wbc.cli.console import plain_console
    from wbc.cli.printing import heads, print_line, print_unbalanced
    from wbc.retargeting.robot_setup import NO_SELF_COLLISION

    console, scale = plain_console(), found.scale
    sizes = f"lengths {scale.length:.3f}, times {scale.time:.3f}, masses {scale.mass:.3f}"
    print_line("scale", sizes)
    for note in found.notes:
        print_line("note", note, "yellow")
    table = heads("task", "rms", "largest", "at")
    for one in found.reached:
        size = f"{one.largest:.3g} {one.unit}"
        table.add_row(one.task, f"{one.rms:.3g} {one.unit}", size, f"{one.at:.2f} s")
    console.print(table)
    for name, values in (
        ("CoM", found.com_correlation),
        ("angular momentum", found.angular_momentum_correlation),
    ):
        text = " ".join(f"{value:.3f}" for value in values)
        print_line("follows", f"{name}: correlation {text} (x y z)")
    text = f"{1e3 * found.slide:.2f} mm at most while they touch the ground"
    print_line("soles", f"slide by {text}")
    for violation in found.broken:
        print_line("not kept", str(violation), "red")
    if not found.broken:
        no_margins = any(note.startswith(NO_SELF_COLLISION) for note in found.notes)
        margins = "" if no_margins else " margins,"
        print_line("kept", f"soles, limits,{margins} speeds, accelerations")
    print_unbalanced(found.unbalanced)
    span = f"{len(found)} frames, {found.time[-1]:.4g} s at {found.rate:g} Hz"
    console.print(f"{found.robot.name}: {span}")
