"""The output of ``wbc run``: a status and a few short tables."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, JustifyMethod, RenderResult
from rich.table import Table
from rich.text import Text

from wbc.cli.console import plain_console
from wbc.problem import Result, RunStatus
from wbc.problem.pendulum.result import PendulumResult, PendulumStatus, unit_of
from wbc.robot.names import COM
from wbc.run.shaping_report import ShapingReport
from wbc.simulation import SimulationStatus
from wbc.tracking.deviation import Unbalanced

SHOWN = 5
SHOWN_PAIRS = 6  # that self-collision does not watch
WORST = 12  # of what cannot be balanced, that are printed
GAP = 3  # between columns
_STOPPED = {
    "met": "; it stopped once the tasks were met",
    "settled": "; it stopped when nothing better was found for long",
    "seconds": "; it ran out of time",
    "interrupted": "; it was interrupted",
}


def print_result(result: Result, written: Iterable[Path]) -> None:
    """Print a run's status, each task's error, and the worst margins and times."""
    console = plain_console()
    time = result.history.time
    seconds = len(time) * float(time[1] - time[0]) if time.size > 1 else 0.0
    reach = f", {result.reach}" if result.reach else ""
    reason = f"{result.reason}{reach} ({len(result.history)} ticks, {seconds:.2f} s)"
    console.print(head(result.status, reason))
    console.print(tasks_table(result))
    if result.inertia:
        console.print(_inertia(result))
    if result.shaping is not None:
        console.print(postures_table(result.shaping))
    if result.clearance:
        console.print(_constraints(result))
    if result.held_back:
        console.print(_held_back(result))
    console.print(_rest(result))
    print_written(written)


def print_pendulum_result(result: PendulumResult, written: Iterable[Path]) -> None:
    """Print the status of a pendulum's problem, and its measures."""
    console = plain_console()
    console.print(head(result.status, result.reason))
    table = heads("measured", "")
    for name, value in result.measures.items():
        table.add_row(Text(name), Text(f"{value:.4g} {unit_of(name)}".rstrip()))
    console.print(table)
    print_written(written)


def head(status: RunStatus | PendulumStatus | SimulationStatus, reason: str) -> Text:
    """Return the line of a status; a reason that begins with it does not repeat it."""
    colour, word = "green" if status.good else "red", status.value.replace("_", " ")
    rest = reason.removeprefix(word)
    rest = rest if rest.startswith(" ") else f": {reason}"
    return Text(word, style=f"bold {colour}").append(rest, style="not bold default")


def print_line(name: str, text: str, style: str = "dim") -> None:
    """Print a name of at most eight letters, and what is told under it."""
    plain_console().print(Text.assemble((f"{name:9}", style), text))


def print_written(written: Iterable[Path], width: int = 15) -> None:
    """Print which files were written."""
    for path in written:  # never folded: a path is to be copied
        line = Text.assemble((f"{'written':{width}}", "dim"), str(path))
        plain_console().print(line, soft_wrap=True)


def tasks_table(result: Result) -> Table:
    """Return a table of the tasks' errors."""
    accepts = any(task.tolerance is not None for task in result.tasks.values())
    table = heads("task", "error", "largest entry", *(["tolerance"] if accepts else []))
    for name, task in result.tasks.items():
        units = dict.fromkeys(task.units)
        unit = f" {', '.join(units)}" if units != {"1": None} else ""
        worst = int(np.argmax(np.abs(task.error)))
        largest = f"{task.rows[worst]} {task.error[worst]:+.3g}"
        cells = [Text(name), Text(f"{task.norm:.3g}{unit}"), Text(largest)]
        if np.isnan(task.error).all():  # about forces, which no tick decided
            cells[1:] = [Text("unknown"), Text("it was never on")]
        if task.tolerance is not None:
            met = task.norm <= task.tolerance
            cells.append(Text(f"{task.tolerance:g}", style="green" if met else "red"))
        table.add_row(*cells)
    return table


def _inertia(result: Result) -> Table:
    table = heads("inertia [kg m^2]", "start", "wanted", "reached", "of it")
    for name, one in result.inertia.items():
        columns = one.start, one.wanted, one.reached
        largest = float(np.abs(columns).max()) or 1.0
        decimals = max(3 - math.floor(math.log10(largest)), 4)  # of small robots, too
        for k, component in enumerate(one.components):
            numbers = (f"{values[k]:.{decimals}f}" for values in columns)
            about = "" if one.about == COM else f" about {_words_of(one.about)}"
            part = f"{100 * one.share(k):.0f} %" if one.wanted[k] > 0.0 else ""
            table.add_row(Text(f"{name}: {component} in {one.axes} axes{about}"), *numbers, part)
    return table


def _words_of(about: str | tuple[float, ...]) -> str:
    return about if isinstance(about, str) else "({:g}, {:g}, {:g}) m".format(*about)


def _constraints(result: Result) -> Table:
    table = heads("constraint", "least left [mm]", "at", "time [s]")
    for name, worst in result.clearance.items():
        told = f"{name} (may give way)" if name in result.yielding else name
        left = (
            f"{1e3 * worst.value:.3g}" if worst.unit == "m" else f"{worst.value:.3g} {worst.unit}"
        )
        size = Text(left, style="" if worst.value >= 0.0 else "yellow")
        table.add_row(Text(told), size, Text(worst.where), f"{worst.tick * result.dt:.3f}")
    return table


def _held_back(result: Result) -> Table:
    table = heads("held back by", "for [s]", "from", "to")
    rows = list(result.held_back.items())
    for label, one in rows[:SHOWN]:
        times = (one.ticks * result.dt, one.first, one.last + result.dt)
        table.add_row(Text(label), *(f"{time:.3f}" for time in times))
    if len(rows) > SHOWN:
        table.add_row(Text(f"and {len(rows) - SHOWN} more", style="dim"))
    return table


def unwatched_text(pairs: Mapping[str, str]) -> str:
    """Return pairs of bodies by why self-collision does not watch them, as many as can be read."""
    by_reason: dict[str, list[str]] = {}
    for pair, why in list(pairs.items())[:SHOWN_PAIRS]:
        by_reason.setdefault(why, []).append(pair)
    parts = [f"{why}: {', '.join(those)}" for why, those in by_reason.items()]
    if len(pairs) > SHOWN_PAIRS:
        parts.append(f"and {len(pairs) - SHOWN_PAIRS} more (wbc collisions lists all)")
    return "; ".join(parts)


def _rest(result: Result) -> Table:
    table = facts()
    margin, slip, balance = result.margin, result.slip, result.balance
    if np.isfinite(margin.value):
        left = round(margin.value, 9) + 0.0  # less is rounding; -0.0 + 0.0 is 0
        how = f"at least {left:.2g} left" if left >= 0.0 else f"exceeded by at most {-left:.2g}"
        table.add_row("joint limits", f"{how} ({margin.where}, tick {margin.tick})")
    if slip is not None:
        table.add_row("slip", f"at most {slip.value:.2g} m ({slip.where}, tick {slip.tick})")
    if balance is not None:
        phase = f"{balance.where}, " if balance.where else ""
        side = "inside" if balance.value >= 0.0 else "outside"
        size = f"{1e3 * abs(balance.value):.1f} mm {side}"
        table.add_row(
            "balance", Text(f"CoM {size} the soles at worst ({phase}tick {balance.tick})")
        )
    for text in result.not_kept:
        table.add_row("not kept", Text(text, style="red"))
    for name, pairs in result.provenance.get("unwatched_pairs", {}).items():
        table.add_row("not watched", Text(f"{unwatched_text(pairs)} ({name})"))
    table.add_row("QP", Text(_qp(result)))
    wall, cpu = (result.tick_times()[clock] for clock in ("wall", "cpu"))
    table.add_row(
        "tick time",
        f"median {1e3 * wall['median']:.2f} ms, p99 {1e3 * wall['p99']:.2f} ms "
        f"(CPU {1e3 * cpu['median']:.2f}, {1e3 * cpu['p99']:.2f})",
    )
    for name, text in search_rows(result.shaping) if result.shaping is not None else ():
        table.add_row(name, Text(text))
    return table


def _qp(result: Result) -> str:
    if not result.failures:
        counts = ", ".join(f"{what} in {n} ticks" for what, n in result.left_out.items())
        without = f"; left out: {counts}" if counts else ""
        return f"every tick solved, KKT residual {result.worst_kkt:.1g} at most{without}"
    return failed_ticks(result)


def failed_ticks(result: Result) -> str:
    """Return how many ticks failed, if any did, and what was wrong in the first."""
    first, count, ticks = result.failures[0], len(result.failures), len(result.history)
    return f"{count} of {ticks} ticks failed; the first, tick {first.tick}: {first.report}"


# ---------------------------------------------------------------------- search over postures


def postures_table(report: ShapingReport) -> Table:
    """Return the best postures with their costs and relative errors, from start to reached."""
    names = tuple(report.best.relative_errors)
    table = heads("posture", "cost", *(f"{name}, off by" for name in names), "starts", "IPOPT", "")

    def add(label: str, cost: float, errors: Iterable[float], *rest: str) -> None:
        parts = [f"{100 * error:.1f} %" for error in errors]
        table.add_row(Text(label), f"{cost:.4g}", *parts, *(Text(text) for text in rest))

    add("start", report.cost_start, report.relative_start.values(), "", "", "")
    for rank, one in enumerate(report.postures, 1):
        if rank > SHOWN and one.tried is None:
            continue
        status = one.status.replace("_", " ").lower()
        tried = "" if one.tried is None else "reached" if one.tried == "arrived" else "not reached"
        errors = one.relative_errors.values()
        add(str(rank), one.cost, errors, str(len(one.starts)), status, tried)
    add("end", report.cost_end, report.relative_end.values(), "", "", "")
    return table


def search_rows(report: ShapingReport) -> Iterator[tuple[str, str]]:
    """Yield the search's effort, its rejections, and the motion's final cost over the best."""
    effort = report.effort
    processes = f"{effort.workers} process{'es' if effort.workers > 1 else ''}"
    seconds = effort.build_seconds + effort.search_seconds
    yield (
        "search",
        f"{len(report.postures)} postures from {effort.searched} of {effort.starts} starts in"
        f" {seconds:.1f} s by {processes}, {effort.iterations} iterations"
        f"{_STOPPED.get(effort.stopped or '', '')}",
    )
    if report.rejected:
        yield (
            "rejected",
            "; ".join(f"{count} x {reason}" for reason, count in report.rejected.items()),
        )
    yield ("motion", f"cost {_above(report.above_best)}, found in {effort.reach_seconds:.1f} s")


def _above(part: float) -> str:
    if not np.isfinite(part) or abs(part) < 5e-5:
        return "that of the best posture"
    side = "above" if part > 0.0 else "below"
    return f"{100 * abs(part):.2g} % {side} that of the best posture"


class WholeWords(Table):
    """A table that wraps lines between words: columns are no narrower than their longest word.

    If the terminal is too narrow for that, columns get closer, and finally the longest words break.
    (Rich narrows the widest column first, and then truncates.)
    """

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """See rich's protocol."""
        cells = [[str(cell) for cell in (one.header, *one.cells)] for one in self.columns]
        words = (" ".join(column).split() for column in cells)
        widths = [max(map(cell_len, column), default=0) for column in words]  # of the longest
        whole = [max(map(cell_len, "\n".join(column).split("\n"))) for column in cells]
        most, gaps = options.max_width, len(widths) - 1
        wanted = [(own, gap) for own in (whole, widths) for gap in (int(self.padding[1]), 2, 1)]
        gap = next((gap for own, gap in wanted if sum(own) + gaps * gap <= most), 1)
        room = most - gaps * gap
        while sum(widths) > max(room, len(widths)):
            widths[widths.index(max(widths))] -= 1
        by_need = sorted(range(len(widths)), key=lambda k: whole[k] - widths[k])
        for left, k in zip(range(len(widths), 0, -1), by_need, strict=True):
            widths[k] += max(min(whole[k] - widths[k], (room - sum(widths)) // left), 0)
        self.padding = (0, gap, 0, 0)
        for column, width in zip(self.columns, widths, strict=True):
            column.width = width
        yield from super().__rich_console__(console, options)


def facts() -> Table:
    """Return an empty table of names and facts, below an empty line."""
    table = WholeWords(box=None, pad_edge=False, padding=(0, 3, 0, 0), show_header=False)
    table.add_column(style="dim", no_wrap=True)
    table.add_column(overflow="fold")
    table.add_row("", "")
    return table


def heads(*columns: str) -> Table:
    """Return an empty table under a line of heads: the first column to the left, numbers right."""
    table = WholeWords(box=None, pad_edge=False, padding=(0, GAP, 0, 0), header_style="dim")
    for k, column in enumerate(columns):
        justify: JustifyMethod = "left" if k == 0 else "right"
        table.add_column(Text(f"\n{column}"), justify=justify, overflow="fold")
    return table


def print_unbalanced(unbalanced: Sequence[Unbalanced], most: int = WORST) -> None:
    """Print where a motion cannot be balanced, and why; the worst first."""
    worst = sorted(unbalanced, key=lambda one: -one.by)
    for lacking in worst[:most]:
        print_line("balance", str(lacking), "yellow")
    if len(worst) > most:
        print_line("balance", f"{len(worst) - most} more", "yellow")
    if not worst:
        print_line("balance", "the ground and the joints can do it")
