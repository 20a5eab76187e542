"""``wbc run`` and ``wbc sim``: a problem, run or simulated, printed, written and drawn."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

import typer

from wbc.cli import options
from wbc.cli.errors import NOT_REACHED, QP_FAILED, complain, print_note, print_notes

if TYPE_CHECKING:
    from wbc.cli.outputs import Outputs
    from wbc.controllers import Controller
    from wbc.controllers.closed_loop import LoopTick
    from wbc.problem import Problem, Result
    from wbc.problem.pendulum.problem import PendulumProblem
    from wbc.problem.pendulum.result import PendulumResult
    from wbc.run.simulate import Show as ShowTick
    from wbc.simulation import SimulationResult
    from wbc.view.live.run_viewer import RunViewer
    from wbc.view.options import View

    AnyResult = Result | SimulationResult | PendulumResult

EXIT_CODES = (
    "Exit codes: 0 solved; 1 bad input; 2 wrong usage; 3 not at rest or a tolerance not met in"
    " time, or balance, contacts or margins not kept; 4 a QP failed; 130 or 143 ended by Ctrl-C or"
    " SIGTERM, with what was computed until then written."
)
SIM_EXIT_CODES = (
    "Exit codes: 0 it stood, and every tolerance was met; 1 bad input, or the physics blew up; 2"
    " wrong usage; 3 it fell, or a tolerance was not met; 4 a tick had no solution; 130 or 143"
    " ended by Ctrl-C or SIGTERM, with what was computed until then written."
)


def run(
    problem: Annotated[
        Path,
        typer.Argument(help="The problem file; - reads it from stdin.", metavar="PROBLEM.yaml"),
    ],
    output: options.Output = None,
    plot: options.Plot = None,
    view_from: options.ViewFrom = "front-left",
    show: options.Show = "all",
    solver: options.Solver = None,
    assign: options.Assign = None,
    quiet: options.Quiet = False,
    view: options.Watched = False,
    save_tick: options.SaveTick = None,
    stream: options.Streamed = None,
) -> None:
    """Run a problem and report the result."""
    from wbc.errors import InvalidInputError
    from wbc.view.options import View

    look = View.of(view_from, show)  # checked before the run
    if plot is None and look != View.of():
        raise InvalidInputError("--view-from, --show: are of the picture; name it with --plot")
    chosen = _RunOptions(problem, output or [], plot, quiet, view, save_tick, stream)
    raise typer.Exit(_run(chosen, options.overrides_of(assign, solver), look, simulated=False))


def _run(
    chosen: _RunOptions, overrides: dict[str, Any], look: View | None = None, *, simulated: bool
) -> int:
    """Run or simulate a problem, write, print and show the result; return the exit code."""
    from wbc.cli.interrupts import Interrupts, noted_interrupts
    from wbc.cli.outputs import Outputs
    from wbc.cli.progress import shown_progress, starting
    from wbc.cli.sim_report import print_unbalanced_motion
    from wbc.errors import InvalidInputError

    with starting(f"loading {chosen.path}", chosen.quiet):
        from wbc.problem import Problem, Result, load_problem
        from wbc.problem.pendulum.result import PendulumResult

        problem = load_problem(chosen.path, overrides)
    if simulated and not isinstance(problem, Problem):
        raise InvalidInputError(
            f"{chosen.path}: a pendulum's problem simulates itself: wbc run"
            f" {quote(str(chosen.path))}"
        )
    if isinstance(problem, Problem) and not chosen.quiet:
        print_notes(problem.parts.robot)
        if simulated:
            print_unbalanced_motion(problem.parts.plan)
    watching = chosen.watching(problem)
    plans = not isinstance(problem, Problem) and problem.spec.plan is not None
    # Ctrl-C ends a plan at once: there is no partial result.
    listening = nullcontext(Interrupts()) if plans else noted_interrupts()
    result: AnyResult
    outputs = Outputs()
    with (
        shown_progress(chosen.quiet) as progress,
        listening as interrupts,
        chosen.shown_by(problem, watching, outputs) as show,
    ):
        if isinstance(problem, Problem):
            start = problem.simulate if simulated else problem.run
            result = start(progress, cancelled=interrupts, show=show)
        else:
            result = problem.run(progress, cancelled=interrupts)
    shaping, ended = getattr(result, "shaping", None), result.status
    # A search over postures handles Ctrl-C itself.
    interrupted = interrupts() or bool(shaping and shaping.effort.stopped == "interrupted")
    _write(chosen, result, look, outputs, keep=interrupted)
    failed = QP_FAILED if ended.value == "qp_failed" else NOT_REACHED
    code = outputs.exit_code(0 if ended.good else failed)
    if interrupted:
        where = ", ".join(str(one) for one in outputs.written) or "nowhere"
        complain(f"interrupted; what was computed until then is in {where}")
        return interrupts.exit_code
    if watching is not None and not isinstance(result, PendulumResult):
        run = result if isinstance(result, Result) else result.run
        watching.replay(run.history)
        typer.echo(f"it can be played again at {watching.viewer.url}; Ctrl-C ends", err=True)
        watching.viewer.wait()
    return code


def _write(
    chosen: _RunOptions, result: AnyResult, look: View | None, outputs: Outputs, *, keep: bool
) -> None:
    """Write, draw and print the result; ``keep``: to a temporary file, if there is no output."""
    from wbc.cli.printing import print_pendulum_result, print_result
    from wbc.cli.sim_report import print_simulation
    from wbc.problem import Result
    from wbc.simulation import SimulationResult

    output = chosen.output
    if keep and not output:
        output = [Path(tempfile.mkdtemp(prefix="wbc-")) / f"{chosen.name}.npz"]
    for each in output:
        outputs.save(each, result.save)
    if chosen.plot is not None:
        outputs.draw(chosen.plot, lambda path: _draw(result, path, chosen.name, look))
    if chosen.quiet:
        pass
    elif isinstance(result, Result):
        print_result(result, outputs.written)
    elif isinstance(result, SimulationResult):
        print_simulation(result, outputs.written)
    else:
        print_pendulum_result(result, outputs.written)


def _draw(result: AnyResult, path: Path, name: str, look: View | None) -> None:
    from wbc.problem import Result
    from wbc.simulation import SimulationResult
    from wbc.view import plot_pendulum, plot_run, style
    from wbc.view.portrait import DEFAULT
    from wbc.view.simulation import simulation_figure

    title = f"{name}: {result.status.value.replace('_', ' ')}"
    if isinstance(result, Result):
        title += f", {result.reach.partition(', at ')[0]}" if result.reach else ""
        title = style.literal(title)
        plot_run(result.robot, result.history, path, title=title, view=look or DEFAULT)
    elif isinstance(result, SimulationResult):
        title = style.literal(f"{name}: {result.reason}")
        figure = simulation_figure(result.robot, result.arrays, title, result.terrain)
        style.save(figure, path)
    else:
        plot_pendulum(result.history, path, title=style.literal(title))


def sim(
    problem: Annotated[
        Path,
        typer.Argument(
            help="A problem of the torque level; - reads it from stdin.", metavar="PROBLEM.yaml"
        ),
    ],
    output: options.Output = None,
    plot: options.Plot = None,
    solver: options.Solver = None,
    assign: options.Assign = None,
    quiet: options.Quiet = False,
    view: options.Watched = False,
    save_tick: options.SaveTick = None,
    stream: options.Streamed = None,
) -> None:
    """Simulate a problem of the torque level and report whether the robot stood."""
    chosen = _RunOptions(problem, output or [], plot, quiet, view, save_tick, stream)
    raise typer.Exit(_run(chosen, options.overrides_of(assign, solver), simulated=True))


# ---------------------------------------------------------------------- shared parts


@dataclass(frozen=True)
class _RunOptions:
    """Options of a run besides the problem."""

    path: Path
    output: list[Path]
    plot: Path | None
    quiet: bool
    view: bool
    save_tick: Path | None
    stream: str | None

    @property
    def name(self) -> str:
        """Of the problem, for titles and files."""
        return options.name_of(self.path)

    def __post_init__(self) -> None:
        from wbc.cli.outputs import check_outputs, check_place
        from wbc.errors import InvalidInputError
        from wbc.extras import require

        check_outputs(self.output, self.plot)
        if self.view:
            require("viser", "--view")
        if self.save_tick is not None:
            check_place("--save-tick", self.save_tick)
            others = [self.path, *self.output, *([] if self.plot is None else [self.plot])]
            if self.save_tick.resolve() in [one.resolve() for one in others]:
                raise InvalidInputError(
                    f"--save-tick {self.save_tick}: is the problem or an output; name another file"
                )

    @contextmanager
    def shown_by(
        self, problem: Problem | PendulumProblem, watching: RunViewer | None, outputs: Outputs
    ) -> Iterator[ShowTick | None]:
        """Yield the observer of every tick: viewer, stream, the saver of the first relaxed tick.

        Failures of these are noted in ``outputs``; the run goes on.
        """
        from wbc.errors import InvalidInputError
        from wbc.problem import Problem

        if self.save_tick is not None and not isinstance(problem, Problem):
            raise InvalidInputError("--save-tick saves robots' ticks, this is a pendulum's problem")
        observers: list[ShowTick] = [] if watching is None else [watching.show]
        if self.save_tick is not None:
            observers.insert(0, _TickSaver(self.save_tick, outputs))
        with ExitStack() as ending:
            if self.stream is not None:
                from wbc.view.streams import stream_of

                if not isinstance(problem, Problem):
                    raise InvalidInputError("--stream sends robots, this is a pendulum's problem")
                stream = stream_of(problem.parts.robot, self.stream)
                ending.callback(outputs.try_to, f"--stream {self.stream}", stream.close)
                observers.append(stream.show)
                if not self.quiet:
                    print_note(f"streaming to {stream.where}")

            def observe(now: LoopTick, controller: Controller | None) -> None:
                for observer in observers:
                    observer(now, controller)

            yield observe if observers else None

    def watching(self, problem: Problem | PendulumProblem) -> RunViewer | None:
        """Return the live viewer of the run, if requested."""
        from wbc.errors import InvalidInputError
        from wbc.problem import Problem
        from wbc.view.live.run_viewer import RunViewer

        if not self.view:
            return None
        if not isinstance(problem, Problem):
            raise InvalidInputError(
                "--view shows robots, and this is a pendulum's problem; use --plot"
            )
        terrain = problem.spec.simulation.ground()
        return RunViewer(problem.parts.robot, title=self.name, terrain=terrain)


class _TickSaver:
    """Saves the first failed or relaxed tick."""

    def __init__(self, path: Path, outputs: Outputs) -> None:
        self._path, self._outputs, self._done = path, outputs, False

    def __call__(self, now: LoopTick, controller: Controller | None) -> None:
        if now.tick.policy is None or self._done:
            return
        self._done = True
        if not self._outputs.try_to(f"--save-tick {self._path}", lambda: now.tick.save(self._path)):
            return
        print_note(
            f"t = {now.time:.3f} s: {now.tick.report()}; saved: ask again by wbc replay"
            f" {quote(str(self._path))}"
        )
