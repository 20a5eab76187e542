"""Writes a report: the page, with everything that it shows inside."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from wbc.errors import InvalidInputError
from wbc.files import write_whole
from wbc.robot import Robot
from wbc.view.history import History, read_history
from wbc.view.report.plots import report_plots
from wbc.view.report.replay import replay_data, replay_rows

SHOWN = 12  # rows of a table
Table = tuple[str, Sequence[str], Iterable[Sequence[str]]]  # title, heads, rows


def report_format(path: str | Path) -> None:
    """Raise InvalidInputError unless the file's ending is ``.html``."""
    if Path(path).suffix.lower() not in (".html", ".htm"):
        raise InvalidInputError(f"{path}: a report is written as .html")


def write_report(
    robot: Robot, history: History, summary: Mapping[str, Any], path: str | Path, *, title: str
) -> Path:
    """Write a run as one HTML file that needs nothing else, and return its path.

    It holds a replay in 3-D with a time slider, the plots, tables of tasks, constraints and times,
    the problem's text and the versions. It appears whole or not at all.

    Parameters
    ----------
    history:
        As for :func:`wbc.view.plot_run`.
    summary:
        As :meth:`wbc.run.Result.summary` returns it.

    Raises
    ------
    InvalidInputError
        Another ending, or what :func:`wbc.view.plot_run` refuses.
    OSError
        The file cannot be written.
    """
    path = Path(path)
    report_format(path)
    text = report_text(robot, history, summary, title)
    write_whole(path, lambda file: file.write(text.encode()))
    return path


def report_text(robot: Robot, history: History, summary: Mapping[str, Any], title: str) -> str:
    """Return the page that :func:`write_report` writes."""
    run = read_history(robot, history)
    data = replay_data(run, replay_rows(run.time))
    data["plots"] = report_plots(run)
    problem = summary.get("problem") or {}
    texts = {
        "TITLE": html.escape(title),
        "REASON": html.escape(str(summary.get("reason", ""))),
        "TABLES": "\n".join(_table(*table) for table in _tables(summary)),
        "PROBLEM": html.escape(str(problem.get("text", "not known"))),
        "OVERRIDES": html.escape(_overrides(problem.get("overrides") or {})),
        "STYLE": _part("page.css"),
        # In a script element only "</" could end it.
        "DATA": json.dumps(data, allow_nan=False).replace("</", "<\\/"),
        "SCRIPT": _part("page.js"),
    }
    # In one pass: what is put in is never looked at again.
    return re.sub(r"@([A-Z]+)@", lambda found: texts[found[1]], _part("page.html"))


def _part(name: str) -> str:
    return files("wbc.view.report").joinpath(name).read_text(encoding="utf-8")


def _overrides(overrides: Mapping[str, Any]) -> str:
    return "".join(f"--set {name}={json.dumps(value)}\n" for name, value in overrides.items())


def _tables(summary: Mapping[str, Any]) -> Iterable[Table]:
    tasks = summary.get("tasks") or {}
    yield (
        "Tasks at the end",
        ("task", "error", "unit", "tolerance"),
        [
            (name, _number(one["norm"]), ", ".join(dict.fromkeys(one["units"])),
             _number(one["tolerance"]))
            for name, one in tasks.items()
        ],
    )  # fmt: skip
    constraints = summary.get("constraints") or {}
    yield (
        "Constraints",
        ("constraint", "least left [mm]", "at", "time [s]"),
        [
            (name, _number(one["least_clearance"], 1e3), str(one["at"]), _number(one["time"]))
            for name, one in constraints.items()
        ],
    )
    held = list((summary.get("held_back") or {}).items())
    yield (
        f"Held back by ({len(held)})",
        ("row", "for [s]", "from", "to"),
        [
            (name, _number(one["seconds"]), _number(one["first"]), _number(one["last"]))
            for name, one in held[:SHOWN]
        ],
    )
    times = summary.get("tick_time") or {}
    yield (
        "Tick time [ms]",
        ("clock", "median", "99 %", "largest"),
        [
            (clock, *(_number(one[key], 1e3) for key in ("median", "p99", "max")))
            for clock, one in times.items()
        ],
    )
    yield ("Versions", ("package", "version"), list((summary.get("versions") or {}).items()))


def _table(title: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    body = [
        "<tr>" + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in row) + "</tr>"
        for row in rows
    ]
    if not body:
        return ""
    head = "".join(f"<th>{html.escape(one)}</th>" for one in heads)
    return (
        f"<section><h2>{html.escape(title)}</h2><table><thead><tr>{head}</tr></thead><tbody>"
        f"{''.join(body)}</tbody></table></section>"
    )


def _number(value: Any, factor: float = 1.0) -> str:
    return "" if value is None else f"{factor * float(value):.4g}"
