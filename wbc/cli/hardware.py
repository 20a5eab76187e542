"""``wbc hardware``: run a problem on a robot, be a robot, check one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbc.cli.errors import complain, errors_in_one_line, print_note
from wbc.cli.options import Assign, Quiet, overrides_of, robots_beginning

if TYPE_CHECKING:
    from wbc.hardware.loop_result import LoopResult
    from wbc.hardware.setup import Where
    from wbc.robot import Robot

HARDWARE_EXIT_CODES = (
    "Exit codes: 0 it went as asked; 1 bad input, or no robot; 2 wrong usage; 3 a fault stopped it,"
    " or a check was not passed; 130 or 143 ended by Ctrl-C or SIGTERM, braking."
)
STOPPED = 3

hardware = typer.Typer(
    help="On a robot: run a problem, be a simulated robot, check a real one.",
    no_args_is_help=True,
)


def robots_on_buses(incomplete: str) -> list[str]:
    """Return the names of robots on buses that begin so."""
    from wbc.hardware.unitree import PROFILES

    return [name for name in PROFILES if name.startswith(incomplete)]


OnBus = Annotated[
    str,
    typer.Option(
        "--robot",
        help="Which robot is on the bus, as unitree_g1: joint order, gains, messages.",
        autocompletion=robots_on_buses,
    ),
]
Bus = Annotated[str, typer.Option(help="unitree (DDS, extra unitree), or udp (needs nothing).")]
Interface = Annotated[
    str, typer.Option(help="Network interface, as eth0, or lo; with --bus udp an address.")
]
Domain = Annotated[int, typer.Option(help="DDS domain; with --bus udp, moves the ports.", min=0)]
Priority = Annotated[
    int, typer.Option(help="Of SCHED_FIFO, where allowed; 0 asks for none.", min=0, max=99)
]
Slower = Annotated[
    float,
    typer.Option(
        help="Slow motion, so many times, on lo, of run and sim alike: for slow machines.",
        min=1.0,
    ),
]
Cpus = Annotated[
    list[int] | None,
    typer.Option(help="CPU to run on; a second one for the controller. Keep others off it."),
]


@hardware.command(epilog=HARDWARE_EXIT_CODES)
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
            " robot can tell (wbc hardware sim --truth)."
        ),
    ] = "sensors",
    unattended: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Arm, stand up, run so long, sit down, end: for the simulator, on lo only.",
            min=0.0,
        ),
    ] = None,
    log: Annotated[
        Path, typer.Option(help="Where the last 10 s go when something stops it.")
    ] = Path("hardware.npz"),
    keep: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Let the log reach back so far (1 to 2 MB a second), and write it in the end, too:"
            " from the beginning, wbc replay runs it again.",
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
    """Run a problem on a robot: words and Enter, arm, stand, run, sit, stop, reset, quit.

    An empty line stops at once; so does a second Ctrl-C, the first one sits down.
    """
    with errors_in_one_line():
        from wbc.cli.interrupts import noted_interrupts
        from wbc.errors import InvalidInputError
        from wbc.hardware.operator import Keyboard, Script, Wish
        from wbc.hardware.real_time import slow_down
        from wbc.hardware.setup import Where, loop_of
        from wbc.hardware.unitree import profile_named
        from wbc.problem import Problem, load_problem

        _check_places(log, report)
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
        say = _silent if quiet else typer.echo
        operator = Keyboard(say) if unattended is None else Script(unattended)
        loop = loop_of(
            loaded,
            profile,
            lambda: where.open(profile, loaded.parts.robot),
            operator,
            estimator=estimator,
            log=log,
            keep=keep,
            watch=_watch_of(loaded.parts.robot) if view else None,
            priority=priority,
            cpus=cpu or (),
            say=say,
        )
        with noted_interrupts() as interrupts:
            loop.interrupted = lambda: _sits(interrupts, operator, Wish.SIT)
            result = loop.run()
        loop.bus.close()
        _tell(result, report, quiet)
        if interrupts():
            raise typer.Exit(interrupts.exit_code)
        raise typer.Exit(0 if result.good else STOPPED)


def _watch_of(robot: Any) -> Any:
    from functools import partial

    from wbc.extras import require

    require("viser", "wbc hardware run --view")
    from wbc.view.live.hardware import watch_loop

    return partial(watch_loop, robot)


def _sits(interrupts: Any, operator: Any, wish: Any) -> bool:
    if not interrupts():
        return False
    operator.ask(wish)
    return True


def _silent(text: str) -> None: ...


def _check_places(log: Path, report: Path | None) -> None:
    """Raise InvalidInputError for files that could not be written: when it matters is too late."""
    from wbc.cli.outputs import check_place
    from wbc.errors import InvalidInputError

    for option, path, suffix in (("--log", log, ".npz"), ("--report", report, ".json")):
        if path is None:
            continue
        if path.suffix != suffix:
            raise InvalidInputError(f"{option} {path}: expected a name ending in {suffix}")
        check_place(option, path)


def _tell(result: LoopResult, report: Path | None, quiet: bool) -> None:
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
        f"cycles   {result.cycles} and {result.missed} left out; {100 * within:.2f} % began within"
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


@hardware.command(epilog=HARDWARE_EXIT_CODES)
def sim(
    model: Annotated[
        str, typer.Argument(help="The robot: a name, or a file.", autocompletion=robots_beginning)
    ] = "g1",
    robot: OnBus = "unitree_g1",
    bus: Bus = "unitree",
    interface: Interface = "lo",
    domain: Domain = 0,
    truth: Annotated[
        bool, typer.Option("--truth", help="Tell where the base really is, too.")
    ] = False,
    no_gantry: Annotated[
        bool, typer.Option("--no-gantry", help="Without straps: who falls lies.")
    ] = False,
    lifted: Annotated[
        float, typer.Option(help="How much higher it hangs, in m: 0.1 for wbc hardware check.")
    ] = 0.0,
    push: Annotated[
        list[str] | None,
        typer.Option(
            metavar="AT,FX,FY,SECONDS",
            help="Push the trunk at a time, in s and N; repeatable.",
        ),
    ] = None,
    push_body: Annotated[str, typer.Option(help="Which body is pushed.")] = "base",
    patience: Annotated[
        float, typer.Option(help="Seconds without a command after which it brakes.", min=0.001)
    ] = 0.017,
    armature: Annotated[float, typer.Option(help="Of the rotors, in kg m^2.", min=0.0)] = 0.003,
    duration: Annotated[float, typer.Option(help="How long it lives, in s.", min=0.0)] = 1e9,
    report: Annotated[Path | None, typer.Option(help="Write what it did: a .json.")] = None,
    priority: Priority = 50,
    slower: Slower = 1.0,
    cpu: Annotated[int | None, typer.Option(help="CPU to run on.")] = None,
    quiet: Quiet = False,
) -> None:
    """Be a robot: physics, motors at 1 kHz, messages, a watchdog that brakes.

    It hangs in its gantry's straps at the height of its crouch, feet on the ground.
    """
    with errors_in_one_line():
        import json

        from wbc.cli.interrupts import noted_interrupts
        from wbc.errors import InvalidInputError
        from wbc.extras import require
        from wbc.files import write_text
        from wbc.hardware.real_time import pin, real_time, slow_down
        from wbc.hardware.robot_side import RobotSettings
        from wbc.hardware.setup import Where, simulated_robot
        from wbc.hardware.unitree import profile_named
        from wbc.robot import Robot

        require("mujoco", "wbc hardware sim")
        loaded, profile = Robot.load(model, armature=armature), profile_named(robot)
        settings = RobotSettings(truth=truth, gantry=not no_gantry, patience=patience)
        with real_time(priority):  # which the bus's own threads inherit
            end = Where(bus, interface, domain).open_robot(profile, loaded)
        side = simulated_robot(loaded, profile, end, settings, lifted=lifted)
        for one in push or ():
            try:
                at, fx, fy, seconds = (float(word) for word in one.split(","))
            except ValueError:
                raise InvalidInputError(f"--push {one}: expected AT,FX,FY,SECONDS") from None
            side.push(at, push_body, (fx, fy, 0.0), seconds)
        pin(cpu)
        slow_down(slower)
        if not quiet:
            typer.echo(f"{loaded.name} on {bus} {interface}: ready")
        with noted_interrupts() as interrupts:
            done = side.run(duration, cancelled=interrupts, priority=priority, say=print_note)
        if report is not None:
            write_text(report, json.dumps(done.to_data()) + "\n")
        if not quiet:
            for event in done.events:
                typer.echo(f"{event.time:.4f}  {event.what}")
            typer.echo(
                f"{done.commands} commands, {done.damaged} damaged; tilted by at most"
                f" {done.tilt:.2f} rad; {done.late} of {done.steps} steps made up for,"
                f" {1e3 * done.latest:.1f} ms late at most"
            )
        raise typer.Exit(0)


@hardware.command(epilog=HARDWARE_EXIT_CODES)
def check(
    model: Annotated[
        str, typer.Argument(help="The robot's model.", autocompletion=robots_beginning)
    ] = "g1",
    robot: OnBus = "unitree_g1",
    bus: Bus = "unitree",
    interface: Interface = "lo",
    domain: Domain = 0,
    move: Annotated[
        bool | None,
        typer.Option("--move/--no-move", help="Move joints, or do not, without asking."),
    ] = None,
    priority: Priority = 40,
    slower: Slower = 1.0,
) -> None:
    """Check a robot: bus, rates, sensors; then, after asking, order and sign of each joint."""
    with errors_in_one_line():
        from wbc.hardware.check import CheckFinding, CheckGains, listen, move_joints
        from wbc.hardware.real_time import real_time, slow_down
        from wbc.hardware.setup import Where, checks_of, safety_of
        from wbc.hardware.unitree import profile_named
        from wbc.hardware.unitree.profiles import by_pattern
        from wbc.robot import Robot

        loaded, profile = Robot.load(model), profile_named(robot)
        where = Where(bus, interface, domain)
        slow_down(slower)
        end = where.open(profile, loaded)
        wrong = 0

        def told(finding: CheckFinding) -> None:
            nonlocal wrong
            wrong += not finding.good
            mark = (
                typer.style("ok   ", fg="green") if finding.good else typer.style("WRONG", fg="red")
            )
            typer.echo(f"{mark} {finding.what:28s} {finding.seen}")

        with real_time(priority) as refused:
            for note in refused:
                print_note(note)
            for finding in listen(end, loaded, checks_of(loaded)):
                told(finding)
            if wrong:
                complain("joints are not moved before this is mended")
                raise typer.Exit(STOPPED)
            if move is None:
                move = _asked_to_move(loaded, where)
            if move:
                kp, kd = by_pattern(loaded, profile.stiffness), by_pattern(loaded, profile.holding)
                safety = safety_of(loaded, profile, 0.002)
                move_joints(end, loaded, safety, checks_of(loaded), CheckGains(kp, kd), told=told)
        end.close()
        raise typer.Exit(STOPPED if wrong else 0)


def _asked_to_move(robot: Robot, where: Where) -> bool:
    count = len(robot.joint_names)
    typer.echo(
        f"Now each of the {count} joints of the robot on {where.interface!r} is moved by 2 degrees."
        "\nIt must hang freely, hands off, the stop button in reach."
    )
    return typer.prompt("Type move to go on", default="", show_default=False).strip() == "move"
