"""What ``wbc run`` prints of a search over postures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from rich.table import Table
from rich.text import Text

from wbc.cli.tables import heads
from wbc.run.shaping_report import ShapingReport

SHOWN = 5
_STOPPED = {
    "met": "; it stopped once the tasks were met",
    "settled": "; it stopped when nothing better was found for long",
    "seconds": "; it ran out of time",
    "interrupted": "; it was interrupted",
}


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
    """Yield what the search took, what it rejected, and how near to its best the motion ends."""
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
    yield (
        "motion",
        f"cost {_above(report.above_best)}, found in {effort.reach_seconds:.1f} s",
    )


def _above(part: float) -> str:
    if not np.isfinite(part) or abs(part) < 5e-5:
        return "that of the best posture"
    side = "above" if part > 0.0 else "below"
    return f"{100 * abs(part):.2g} % {side} that of the best posture"
