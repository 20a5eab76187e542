"""Writing of a report as one self-contained page."""

from __future__ import annotations

import base64
import html
import io
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg

from wbc.files import ending_of, write_text
from wbc.problem.pendulum.result import PendulumHistory, unit_of
from wbc.robot import Robot
from wbc.simulation.terrain import LEVEL, Terrain
from wbc.view import style
from wbc.view.history import HistoryLike, read_history
from wbc.view.pendulum_plots import plots_of
from wbc.view.report.replay import pendulum_replay, replay_data, replay_rows
from wbc.view.run import explanation_plots
from wbc.view.series import plot_errors, plot_moments
from wbc.view.simulation import simulation_plots

SHOWN = 12  # rows of a table
WIDTH, HEIGHT, DPI = 6.0, 2.7, 130  # inches of a plot, pixels per inch
Draw = Callable[[Axes], None]


def report_format(path: str | Path) -> None:
    """Raise InvalidInputError unless the file's ending is ``.html``."""
    ending_of(path, (".html", ".htm"), "a report is written as .html")


def write_report(
    robot: Robot,
    history: HistoryLike,
    summary: Mapping[str, Any],
    path: str | Path,
    *,
    title: str,
    simulation: Mapping[str, Any] | None = None,
    terrain: Terrain = LEVEL,
) -> Path:
    """Write a run as one self-contained HTML file, and return its path.

    It holds a replay in 3-D with a time slider, the plots, tables of tasks, constraints and times,
    the problem's text and the versions. The file is replaced atomically.

    Parameters
    ----------
    history:
        As for :func:`wbc.view.plot_run`.
    summary:
        As :meth:`wbc.run.Result.summary` returns it.
    simulation:
        Arrays of a simulation, as :meth:`wbc.simulation.SimulationResult.save` writes them.
    terrain:
        The terrain of a simulation.

    Raises
    ------
    InvalidInputError
        The path does not end in ``.html``, or :func:`wbc.view.plot_run` refuses the run.
    OSError
        The file cannot be written.
    """
    report_format(path)
    return _write(path, report_text(robot, history, summary, title, simulation, terrain))


def report_text(
    robot: Robot,
    history: HistoryLike,
    summary: Mapping[str, Any],
    title: str,
    simulation: Mapping[str, Any] | None = None,
    terrain: Terrain = LEVEL,
) -> str:
    """Return the text of the page that :func:`write_report` writes."""
    run = read_history(robot, history, terrain)
    data = replay_data(run, replay_rows(run.time))
    draws: list[Draw] = [
        lambda axes: plot_moments(axes, run.time, run.moments),
        *explanation_plots(run),
    ]
    if run.errors:
        draws.insert(0, lambda axes: plot_errors(axes, run.time, run.errors))
    if simulation is not None:
        draws = [*simulation_plots(robot, simulation), *draws]
    data["plots"] = [_plot_picture(draw) for draw in draws]
    return _page(data, summary, title)


def write_pendulum_report(
    history: PendulumHistory, summary: Mapping[str, Any], path: str | Path, *, title: str
) -> Path:
    """Write a pendulum's motion as one HTML file, as :func:`write_report` does a robot's run.

    ``summary``: as :meth:`wbc.problem.pendulum.result.PendulumResult.summary` returns it.

    Raises InvalidInputError: the path does not end in ``.html``; OSError: the file cannot be
    written.
    """
    report_format(path)
    data = pendulum_replay(history, replay_rows(history.time))
    data["plots"] = [
        _plot_picture(lambda axes, draw=draw: draw(axes, history))  # type: ignore[misc]
        for draw in plots_of(history)
    ]
    return _write(path, _page(data, summary, title))


def _plot_picture(draw: Draw) -> dict[str, Any]:
    """Return a plot as PNG in base64, and the ends of its time axis in it, if it has one."""
    figure = style.sheet(WIDTH, HEIGHT, None, HEIGHT)
    figure.set_dpi(DPI)
    axes = figure.subplots()
    draw(axes)
    FigureCanvasAgg(figure).draw()  # the layout is known only then
    place, over_time = axes.get_position(), axes.get_xlabel().startswith("time")
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=DPI)
    return {
        "png": base64.b64encode(file.getvalue()).decode("ascii"),
        "times": list(map(float, axes.get_xlim())) if over_time else None,
        "across": [float(place.x0), float(place.x1)],
        "title": axes.get_title(loc="left"),
    }


def _write(path: str | Path, text: str) -> Path:
    path = Path(path)
    write_text(path, text)
    return path


def _page(data: Mapping[str, Any], summary: Mapping[str, Any], title: str) -> str:
    problem = summary.get("problem") or {}
    replaced = (problem.get("overrides") or {}).items()
    overrides = "".join(f"--set {name}={json.dumps(value)}\n" for name, value in replaced)
    said = ("reason", "reach")
    texts = {
        "TITLE": html.escape(title),
        "REASON": html.escape(", ".join(str(summary[key]) for key in said if summary.get(key))),
        "TABLES": "\n".join(_tables(summary)),
        "PROBLEM": html.escape(str(problem.get("text", "not known"))),
        "OVERRIDES": html.escape(overrides),
        "STYLE": _part("page.css"),
        # In a script element only "</" could end it.
        "DATA": json.dumps(data, allow_nan=False).replace("</", "<\\/"),
        "SCRIPT": _part("page.js"),
    }
    # In one pass, so that inserted text is never substituted again.
    return re.sub(r"@([A-Z]+)@", lambda found: texts[found[1]], _part("page.html"))


def _part(name: str) -> str:
    return files("wbc.view.report").joinpath(name).read_text(encoding="utf-8")


def _tables(summary: Mapping[str, Any]) -> Iterable[str]:
    def items(name: str) -> Iterable[tuple[str, Any]]:
        return (summary.get(name) or {}).items()

    measured = [(name, _number(value), unit_of(name)) for name, value in items("measures")]
    yield _table("Measured", ("what", "value", "unit"), measured)
    yield _table("Simulation", ("what", "value"), _simulated(summary.get("simulation") or {}))
    yield _table("Events", ("when", "what"), summary.get("events") or ())
    tasks = [
        (name, _number(one["norm"]), ", ".join(dict.fromkeys(one["units"])),
         _number(one["tolerance"]))
        for name, one in items("tasks")
    ]  # fmt: skip
    yield _table("Tasks at the end", ("task", "error", "unit", "tolerance"), tasks)
    constraints = [
        (name, _clearance(one), one["at"], _number(one["time"]))
        for name, one in items("constraints")
    ]
    yield _table("Constraints", ("constraint", "least left [mm]", "at", "time [s]"), constraints)
    held = []
    for name, one in items("held_back"):  # to the end of the last tick, as the terminal tells it
        until = one["last"] + one["seconds"] / one["ticks"]
        held.append((name, *map(_number, (one["seconds"], one["first"], until))))
    yield _table(f"Held back by ({len(held)})", ("row", "for [s]", "from", "to"), held[:SHOWN])
    times = [
        (clock, *(_number(one[key], 1e3) for key in ("median", "p99", "max")))
        for clock, one in items("tick_time")
    ]
    yield _table("Tick time [ms]", ("clock", "median", "99 %", "largest"), times)
    yield _table("Versions", ("package", "version"), items("versions"))


def _simulated(told: Mapping[str, Any]) -> Iterable[tuple[str, str]]:
    for push in told.get("pushes") or ():
        size = sum(float(one) ** 2 for one in push["impulse"]) ** 0.5
        yield "push", f"{size:.3g} N s on {push['body']} from {push['at']:g} s"
    for name, key, factor, unit in (
        ("something gave way in", "relaxed", 100.0, "% of the ticks"),
        ("CoP inside the soles by at least", "least_cop_margin", 1e3, "mm"),
        ("trunk tilted by at most", "peak_tilt", 1.0, "rad"),
        ("frames lost by the sensors", "lost_frames", 1.0, ""),
    ):
        if told.get(key) is not None:
            yield name, f"{factor * float(told[key]):.3g} {unit}"
    for joint, share in (told.get("saturated") or {}).items():
        yield f"{joint} at its torque bound", f"{100.0 * share:.3g} % of the time"
    for note in told.get("notes") or ():
        yield "left out", str(note)


def _table(title: str, heads: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
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


def _clearance(one: Mapping[str, Any]) -> str:
    unit = one.get("unit", "m")  # older results do not say it
    left = one["least_clearance"]
    return _number(left, 1e3) if unit == "m" or left is None else f"{_number(left)} {unit}"


def _number(value: Any, factor: float = 1.0) -> str:
    return "" if value is None else f"{factor * float(value):.4g}"
