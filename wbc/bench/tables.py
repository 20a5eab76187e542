"""Figures as tables, in Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from wbc.bench.solvers import ABOUT
from wbc.bench.summary import LIMIT, SHIFT


class Table(NamedTuple):
    """A table under a title; the first column is text, the others are numbers as text."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]

    def markdown(self) -> str:
        """Return it in Markdown."""
        rule = ["---", *["---:"] * (len(self.header) - 1)]
        lines = [self.header, rule, *self.rows]
        return "\n".join([f"### {self.title}", "", *(f"| {' | '.join(one)} |" for one in lines)])


def tables(summary: Mapping[str, Any]) -> list[Table]:
    """Return the tables of a summary: solvers at each accuracy, then solvers by sequence."""
    found = []
    for eps, at in summary["accuracies"].items():
        ranked = sorted(
            at["solvers"].items(), key=lambda one: one[1]["all"]["shifted_geometric_mean"]
        )
        header = ("solver", "solved", "shifted geo. mean [us]", "median", "p99", "p99.9",
                  "iterations", "worst KKT", "")  # fmt: skip
        rows = [(name, *_row(of["all"]), ABOUT.get(name, "stateless")) for name, of in ranked]
        found.append(Table(f"All sequences, accuracy {eps}", header, rows))
        names = [name for name, _ in ranked]
        rows = [
            (name, str(about["unknowns"]), str(about["equalities"]), str(about["inequalities"]),
             *(_median(at["solvers"][solver]["sequences"][name]) for solver in names))
            for name, about in summary["sequences"].items()
        ]  # fmt: skip
        header = ("sequence", "n", "eq.", "ineq.", *names)
        found.append(Table(f"Median by sequence [us], accuracy {eps}", header, rows))
    return found


def introduction(summary: Mapping[str, Any]) -> list[str]:
    """Return what the figures are and where they come from, a sentence each."""
    versions = ", ".join(
        f"{name} {one}" for name, one in summary["versions"].items() if one != "not installed"
    )
    count = sum(one["QPs"] for one in summary["sequences"].values())
    return [
        f"{count} QPs in {len(summary['sequences'])} sequences, solved in the order in which a"
        f" controller met them, {summary['repeats']} times; solvers in turns.",
        "Thread CPU time of one call from Python with the conversion that it needs, the least of"
        " the passes for each QP; solved: the solver says so, and the KKT residuals, recomputed"
        " from the QP, agree to the accuracy.",
        f"Shifted geometric mean: shift {1e6 * SHIFT:g} us, a failure counts as"
        f" {1e3 * LIMIT:g} ms. A failed answer is marked ! in the second table.",
        f"{summary['machine']}; {versions}.",
        f"Command: {summary['command']}",
    ]


def markdown(summary: Mapping[str, Any]) -> str:
    """Return everything as a page of Markdown."""
    parts = ["## Solvers", *introduction(summary), *(one.markdown() for one in tables(summary))]
    return "\n\n".join(parts) + "\n"


def _row(figures: Mapping[str, Any]) -> tuple[str, ...]:
    times = [figures[name] for name in ("shifted_geometric_mean", "median", "p99", "p99.9")]
    worst = figures["worst_kkt"]
    return (
        f"{100 * figures['success']:.4g} %",
        *(f"{1e6 * one:.3g}" if one < 1e-3 else f"{1e6 * one:.0f}" for one in times),
        f"{figures['iterations']:.3g}" if figures["iterations"] else "-",
        "no answer" if worst is None or worst == float("inf") else f"{worst:.0e}",
    )


def _median(figures: Mapping[str, Any]) -> str:
    return f"{1e6 * figures['median']:.3g}{'' if figures['success'] == 1.0 else ' !'}"
