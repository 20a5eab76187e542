"""``wbc push``: the largest pushes from all sides that a robot survives."""

from __future__ import annotations

import os
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbc.cli.errors import complain, print_note, print_notes
from wbc.cli.options import Assign, Processes, Quiet, Solver, name_of, overrides_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from wbc.cli.interrupts import Interrupts
    from wbc.cli.progress import ProgressCall
    from wbc.problem.pushed_problem import LoadPushed, PushedProblem, PushSettings
    from wbc.simulation import PushGrid, PushMap
    from wbc.simulation.campaign import CampaignLog

PUSH_EXIT_CODES = (
    "Exit codes: 0 every push was tried; 1 bad input; 2 wrong usage; 130 or 143 ended by Ctrl-C or"
    " SIGTERM. The same command then goes on where it ended, also after a kill; pushes that an"
    " output (.json or .npz) has are not tried again."
)
RATIOS = "0.8:2.0:0.1"
PARTIAL = ".partial"  # suffix of the journal, until the campaign is done
MOST_RATIOS = 1000
OUTLINE = 360  # directions of the theoretical bounds in a picture


def push(
    problem: Annotated[
        Path, typer.Argument(help="A problem of the torque level.", metavar="PROBLEM.yaml")
    ],
    directions: Annotated[
        int, typer.Option(help="How many, evenly around; the first is forwards (world x).")
    ] = 16,
    ratios: Annotated[
        str,
        typer.Option(
            help="Impulses in parts of M omega d: from:to:step, or a list as in 1.0,1.2,1.5.",
            metavar="FROM:TO:STEP",
        ),
    ] = RATIOS,
    failures: Annotated[
        int,
        typer.Option(help="A direction ends after so many failures in a row; 0: the whole grid."),
    ] = 2,
    body: Annotated[
        str, typer.Option(help="Link or frame that is pushed, where the CoM is at the start.")
    ] = "base",
    duration: Annotated[float, typer.Option(help="Of a push, of constant force, in s.")] = 0.1,
    at: Annotated[float, typer.Option(help="When it begins, in s.")] = 0.1,
    compare: Annotated[
        Path | None,
        typer.Option(help="Push this problem, too, and say how much more the first survives."),
    ] = None,
    workers: Processes = None,
    output: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            help="Write the result: .json, .npz with arrays, .csv a row per direction;"
            " repeatable. Every push is kept beside the first (without one, here) until the end.",
        ),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw what is survived by direction, beside theory.")
    ] = None,
    solver: Solver = None,
    assign: Assign = None,
    quiet: Quiet = False,
) -> None:
    """Push a robot from all sides, ever harder, and say what it survives without a step.

    A direction's limit is the largest impulse up to which all smaller ones of the grid were
    survived: the robot stood to the end of the simulation and was at rest there. Pushes of the
    file's own are left out.
    """
    from wbc.cli.outputs import check_outputs
    from wbc.cli.progress import starting
    from wbc.problem.pushed_problem import LoadPushed, PushSettings
    from wbc.simulation import PushGrid

    grid = PushGrid(directions, ratios_of(ratios), failures)
    settings = PushSettings(body=body, duration=duration, at=at)
    check_outputs(output or [], plot)
    overrides = overrides_of(assign, solver)
    paths = [problem] if compare is None else [problem, compare]
    with starting(f"loading {', '.join(map(str, paths))}", quiet):
        loads = [LoadPushed.of(path, overrides, settings) for path in paths]
    count = workers or len(os.sched_getaffinity(0))
    raise typer.Exit(_campaign(paths, loads, settings, grid, count, output or [], plot, quiet))


def ratios_of(text: str) -> list[float]:
    """Return the ratios of ``from:to:step`` or of a list of numbers."""
    from wbc.errors import InvalidInputError

    mistake = f"--ratios {text}: expected from:to:step, as in {RATIOS}, or numbers as in 1.0,1.2"
    try:
        if ":" not in text:
            return [float(part) for part in text.split(",")]
        first, last, step = (float(part) for part in text.split(":"))
    except ValueError:
        raise InvalidInputError(mistake) from None
    if not (0.0 < first <= last < float("inf") and step > 0.0):
        raise InvalidInputError(f"{mistake}; from must be above 0, to not below it, step above 0")
    steps = (last - first) / step
    if not steps < MOST_RATIOS:
        raise InvalidInputError(f"--ratios {text}: more than {MOST_RATIOS} impulses")
    return [round(first + k * step, 9) for k in range(int(steps + 1e-6) + 1)]


def _campaign(
    paths: Sequence[Path],
    loads: Sequence[LoadPushed],
    settings: PushSettings,
    grid: PushGrid,
    workers: int,
    output: list[Path],
    plot: Path | None,
    quiet: bool,
) -> int:
    """Run the campaign, write and print its results, and return the exit code."""
    from wbc.cli.outputs import Outputs
    from wbc.cli.push_report import print_maps
    from wbc.problem.pushed_problem import conditions
    from wbc.simulation.campaign import CampaignLog
    from wbc.simulation.push_map import save_maps, saved_outcomes

    pushed = [load() for load in loads]
    names = _names(paths)
    if not quiet:
        print_notes(pushed[0].robot)
        _print_left_out(names, pushed)
    made_with = conditions(settings)
    made_of = {
        "problems": {name: load.inputs() for name, load in zip(names, loads, strict=True)},
        **made_with,
    }
    kept = _journal_path(output, paths[0], made_of)
    log = CampaignLog(kept, made_of)
    with log:
        if log.entries and not quiet:
            typer.echo(f"goes on with what is in {kept}, pushes: {len(log.entries)}", err=True)
        for each in output:
            saved = saved_outcomes(each, made_of)
            for name, outcomes in saved.items():
                log.known.setdefault(name, []).extend(outcomes)
            keys = [outcome.key for outcomes in saved.values() for outcome in outcomes]
            if keys and not quiet:
                own = sum(one in grid.keys for one in keys)
                others = f" and {len(keys) - own} beside it" if own < len(keys) else ""
                told = f"{each} has {own} pushes of this grid{others} already"
                typer.echo(f"{told}; delete it to begin anew", err=True)
        maps, interrupts = _push_all(names, loads, pushed, grid, workers, log, quiet)
        outputs = Outputs()
        if not interrupts():
            for each in output:
                outputs.save(each, lambda path: save_maps(path, maps, made_of))
            if plot is not None:
                outputs.draw(plot, lambda path: _draw(maps, path, settings))
            if not outputs.failures:
                log.remove()
        if not quiet:
            print_maps(maps, settings, outputs.written)
            _print_unpushed(names, pushed, maps)
    code = outputs.exit_code()
    if interrupts():
        complain(f"interrupted; the same command goes on with what is in {kept}")
        return interrupts.exit_code
    return code


def _journal_path(output: Sequence[Path], problem: Path, made_of: Mapping[str, object]) -> Path:
    """Return the path of the journal: beside the output, or in the current folder.

    Without an output its name depends on the inputs, so that campaigns do not block each other.
    """
    import hashlib
    import json

    if output:
        return output[0].with_name(output[0].name + PARTIAL)
    told = hashlib.sha256(json.dumps(made_of, sort_keys=True).encode()).hexdigest()
    return Path(f"{problem.stem}-{told[:8]}.push{PARTIAL}")


def _names(paths: Sequence[Path]) -> list[str]:
    """Return distinct names of problems."""
    from wbc.files import as_text

    stems = [name_of(path) for path in paths]
    tells = len(set(stems)) == len(stems)
    return stems if tells else [f"{k + 1}: {as_text(str(p))}" for k, p in enumerate(paths)]


def _print_left_out(names: Sequence[str], pushed: Sequence[PushedProblem]) -> None:
    for name, one in zip(names, pushed, strict=True):
        if one.own_pushes:
            plural = "es" if one.own_pushes > 1 else ""
            print_note(f"{name}: {one.own_pushes} push{plural} of simulation.pushes left out")


def _print_unpushed(
    names: Sequence[str], pushed: Sequence[PushedProblem], maps: Sequence[PushMap]
) -> None:
    """For a robot that survived nothing, print whether it rests without a push."""
    for name, one, found in zip(names, pushed, maps, strict=True):
        if found.outcomes and not any(outcome.survived for outcome in found.outcomes):
            alone = one(0.0, 0.0)
            if not alone.survived:
                print_note(f"{name}: nor does it survive without any push: {alone.reason}")


def _push_all(
    names: Sequence[str],
    loads: Sequence[LoadPushed],
    pushed: Sequence[PushedProblem],
    grid: PushGrid,
    workers: int,
    log: CampaignLog,
    quiet: bool,
) -> tuple[list[PushMap], Interrupts]:
    """Push every problem, until the end or a signal."""
    from wbc.cli.interrupts import noted_interrupts
    from wbc.cli.progress import shown_progress
    from wbc.simulation import PushMap, run_campaign
    from wbc.simulation.campaign import compass_angles

    maps = []
    with shown_progress(quiet) as progress, noted_interrupts() as interrupts:
        for name, load, one in zip(names, loads, pushed, strict=True):
            outcomes = run_campaign(
                grid,
                load if workers > 1 else partial(_identity, one),  # already loaded in this process
                workers=workers,
                known=log.known.get(name, ()),
                record=partial(log.record, name),
                progress=None if progress is None else _timed(progress),
                cancelled=interrupts,
            )
            theory = one.bounds(grid.angles), one.bounds(compass_angles(OUTLINE))
            earlier = {push.key: push for push in log.known.get(name, ())}
            beside = [push for place, push in earlier.items() if place not in grid.keys]
            maps.append(PushMap(name, one.robot.name, grid, outcomes, *theory, beside))
    return maps, interrupts


def _timed(progress: ProgressCall) -> ProgressCall:
    """Return a progress function that adds a campaign's remaining time."""
    began = time.monotonic()

    def call(done: int, total: int, info: Mapping[str, Any] | None = None) -> None:
        clock = {"seconds": time.monotonic() - began, "left": total - done}
        progress(done, total, {**(info or {}), **clock})

    return call


def _identity(one: PushedProblem) -> PushedProblem:
    return one


def _draw(maps: Sequence[PushMap], path: Path, settings: PushSettings) -> None:
    from wbc.view.push import pushes_figure
    from wbc.view.style import save

    save(pushes_figure(maps, duration=settings.duration), path)
