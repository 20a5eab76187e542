"""``wbc hardware run``: run a problem on a robot."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wbc.cli.errors import print_note
from wbc.cli.hardware_options import STOPPED, Bus, Cpus, Domain, Interface, OnBus, Priority, Slower
from wbc.cli.options import Assign, Quiet, overrides_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from concurrent.futures import Executor

    from wbc.hardware.loop_result import LoopResult


def run(
    problem: Annotated[
        Path, typer.Argument(help="A problem of the torque level.", metavar="PROBLEM.yaml")
    ],
    robot: OnBus = "unitree_g1",
    bus: Bus = "unitree",
    interface: Interface = "lo",
    domain: Domain = 0,
    estimator: Annotated[
        str,
        typer.Option(
            help="Of the base: sensors (IMU, encoders, torques), or truth, which only a simulated"
            " robot sends (wbc hardware sim --truth)."
        ),
    ] = "sensors",
    unattended: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Arm, stand up, run for this time, sit down, end: for the simulator, on lo only.",
            min=0.0,
        ),
    ] = None,
    log: Annotated[
        Path, typer.Option(help="File for the last 10 s when a fault stops the robot.")
    ] = Path("hardware.npz"),
    keep: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Length of the log (1 to 2 MB a second), which is also written at the end: one"
            " from the beginning can be run again by wbc replay.",
        ),
    ] = None,
    view: Annotated[
        bool,
        typer.Option("--view", help="Show estimate, mode and faults in the browser (extra view)."),
    ] = False,
    report: Annotated[
        Path | None, typer.Option(help="Write times, events and faults: a .json.")
    ] = None,
    priority: Priority = 40,
    slower: Slower = 1.0,
    cpu: Cpus = None,
    assign: Assign = None,
    quiet: Quiet = False,
) -> None:
    """Run a problem on a robot: type arm, stand, run, sit, stop, reset or quit, each with Enter.

    An empty line stops at once, and so does a second Ctrl-C. At the first one, or if the terminal
    is closed, the robot sits down.
    """
    from concurrent.futures import ThreadPoolExecutor
    from functools import partial

    from wbc.cli.interrupts import noted_interrupts
    from wbc.errors import InvalidInputError
    from wbc.extras import require
    from wbc.hardware.operator import Keyboard, Script, Wish
    from wbc.hardware.real_time import slow_down
    from wbc.hardware.setup import Where, loop_of
    from wbc.hardware.unitree import profile_named
    from wbc.problem import Problem, load_problem

    _check_files(log, report)
    loaded = load_problem(problem, overrides_of(assign))
    if not isinstance(loaded, Problem):
        raise InvalidInputError(f"{problem}: a pendulum's problem runs on no robot")
    where, profile = Where(bus, interface, domain), profile_named(robot)
    if slower > 1.0 and not where.is_here:
        raise InvalidInputError(f"--slower: a robot on {interface!r} would not be slower")
    slow_down(slower)
    if unattended is not None and not where.is_here:
        raise InvalidInputError(
            f"--unattended: nobody would stop a robot on {interface!r}; it is for lo"
        )
    watch = None
    if view:
        require("viser", "wbc hardware run --view")
        from wbc.view.live.hardware import watch_loop

        watch = partial(watch_loop, loaded.parts.robot)
    voice = ThreadPoolExecutor(1)
    say = (lambda text: None) if quiet else _printer(voice)
    operator = Keyboard(say) if unattended is None else Script(unattended)
    if unattended is None:
        say(f"{robot} on {bus} {interface}: type {', '.join(Wish)}; an empty line stops at once")
    loop = loop_of(
        loaded,
        profile,
        lambda: where.open(profile, loaded.parts.robot),
        operator,
        estimator=estimator,
        log=log,
        keep=keep,
        watch=watch,
        priority=priority,
        cpus=cpu or (),
        say=say,
    )
    with noted_interrupts(hangup=True) as interrupts:
        loop.interrupted = interrupts
        result = loop.run()
    loop.bus.close()
    voice.shutdown()
    _print_result(result, report, quiet)
    if interrupts():
        raise typer.Exit(interrupts.exit_code)
    good = result.good and not (unattended is not None and result.hung)
    raise typer.Exit(0 if good else STOPPED)


def _printer(voice: Executor) -> Callable[[str], None]:
    """Return a function that prints in a thread: a paused terminal (Ctrl-S) stops no cycle."""
    voice.submit(int)  # starts its thread now, before there is a priority to inherit

    def say(text: str) -> None:
        with suppress(RuntimeError):  # the keyboard's thread, as the command ends
            voice.submit(_print, text)

    return say


def _print(text: str) -> None:
    with suppress(OSError):  # a closed terminal must not let a robot fall
        typer.echo(text)


def _check_files(log: Path, report: Path | None) -> None:
    """Raise InvalidInputError early for files that cannot be written."""
    from wbc.cli.outputs import check_place
    from wbc.errors import InvalidInputError

    for option, path, suffix in (("--log", log, ".npz"), ("--report", report, ".json")):
        if path is None:
            continue
        if path.suffix != suffix:
            raise InvalidInputError(f"{option} {path}: expected a name ending in {suffix}")
        check_place(option, path)
    if log.exists():
        print_note(f"--log {log}: is there already; a log of this run replaces it")


def _print_result(result: LoopResult, report: Path | None, quiet: bool) -> None:
    import json

    import numpy as np

    from wbc.files import write_text

    for note in result.notes:
        print_note(note)
    late = 1e3 * np.percentile(result.lateness, [50, 99, 100]) if result.cycles else np.zeros(3)
    took = 1e3 * np.percentile(result.seconds, [50, 99]) if result.seconds.size else np.zeros(2)
    within = result.share_within(2e-4)
    if report is not None:
        data = {
            "reason": result.reason,
            "ended_at": result.ended_at,
            "good": result.good,
            "cycles": result.cycles,
            "missed": result.missed,
            "held": result.held,
            "share_within_0.2_ms": within,
            "lateness_ms": {"median": late[0], "p99": late[1], "worst": late[2]},
            "tick_ms": {"median": took[0], "p99": took[1]},
            "events": [[e.time, str(e.mode), e.what, e.answer.name] for e in result.events],
            "faults": {str(fault): count for fault, count in result.faults.items()},
            "dropped": dict(result.dropped),
            "notes": list(result.notes),
            "logs": [str(path) for path in result.logs],
        }
        write_text(report, json.dumps(data, indent=1) + "\n")
    if quiet:
        return
    typer.echo(f"ended: {result.reason}")
    typer.echo(
        f"cycles   {result.cycles} and {result.missed} skipped; {100 * within:.2f} % began within"
        f" 0.2 ms of their time, late by {late[0]:.3f} ms (median), {late[1]:.3f} (p99),"
        f" {late[2]:.2f} (worst)"
    )
    typer.echo(
        f"ticks    {took[0]:.2f} ms (median), {took[1]:.2f} (p99), from reading to command; held in"
        f" {result.held} cycles"
    )
    for fault, count in result.faults.most_common():
        typer.echo(f"fault    {fault}: {count} cycles")
    for path in result.logs:
        typer.echo(f"log      {path}")
