"""Figures as tables, in Markdown and in one HTML file that opens offline."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from qpbench.compare import SpeedChange
from qpbench.solvers import ABOUT
from qpbench.summary import LIMIT, SHIFT

STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:70em;margin:2em auto;padding:0 1em;
color:#222}table{border-collapse:collapse;margin:1em 0}th,td{padding:.3em .7em;text-align:right;
border-bottom:1px solid #ddd}th:first-child,td:first-child{text-align:left}img{max-width:100%}
th{border-bottom:2px solid #888}caption{text-align:left;font-weight:bold}p{overflow-wrap:anywhere}
.wide{overflow-x:auto}td:first-child{white-space:nowrap}"""


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

    def html(self) -> str:
        """Return it in HTML."""
        head = "".join(f"<th>{html.escape(one)}</th>" for one in self.header)
        rows = "".join(
            f"<tr>{''.join(f'<td>{html.escape(one)}</td>' for one in row)}</tr>\n"
            for row in self.rows
        )
        return (
            f'<div class="wide"><table><caption>{html.escape(self.title)}</caption>\n'
            f"<tr>{head}</tr>\n{rows}</table></div>"
        )


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


def changes_table(changes: Sequence[SpeedChange]) -> Table:
    """Return the table of a comparison."""
    header = ("solver", "accuracy", "time now / then", "between", "solved then", "now", "verdict")
    rows = [
        (
            one.solver,
            one.eps,
            f"{one.ratio:.2f}",
            f"{one.low:.2f} to {one.high:.2f}",
            *(f"{100 * share:.4g} %" for share in one.success),
            one.verdict.value + (f": {one.reason}" if one.reason else ""),
        )
        for one in changes
    ]
    return Table("Compared with the earlier figures", header, rows)


def introduction(summary: Mapping[str, Any]) -> list[str]:
    """Return the origin and meaning of the figures, a sentence each."""
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


def markdown(summary: Mapping[str, Any], changes: Sequence[SpeedChange] = ()) -> str:
    """Return everything as a page of Markdown."""
    parts = ["## Solvers", *introduction(summary)]
    parts += [one.markdown() for one in _all(summary, changes)]
    return "\n\n".join(parts) + "\n"


def html_page(
    summary: Mapping[str, Any], changes: Sequence[SpeedChange] = (), picture: bytes | None = None
) -> str:
    """Return everything as one page, with a PNG picture inside."""
    told = "".join(f"<p>{html.escape(one)}</p>\n" for one in introduction(summary))
    image = ""
    if picture is not None:
        data = base64.b64encode(picture).decode()
        image = f'<img alt="performance profile and times" src="data:image/png;base64,{data}">\n'
    body = "\n".join(one.html() for one in _all(summary, changes))
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>QP solvers</title>'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<style>{STYLE}</style></head>\n<body><h1>QP solvers</h1>\n{told}{image}{body}"
        "</body></html>\n"
    )


def _all(summary: Mapping[str, Any], changes: Sequence[SpeedChange]) -> list[Table]:
    return [*tables(summary), *([changes_table(changes)] if changes else [])]


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
