"""The panel of numbers: time, tick, errors, and what holds the command back, by name."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

import numpy as np
from viser import GuiApi

from wbc.view.live.layers.margins import Pair
from wbc.view.live.messages import TickInfo
from wbc.view.live.shown_frame import ShownFrame

MOST_LISTED = 6  # names under a heading
_STYLE = "font-size:0.8em;line-height:1.35;padding:0 0.9em 0.4em;font-variant-numeric:tabular-nums"
_HEAD = "margin-top:0.5em;font-weight:600;color:#555"
_NONE = "<span style='color:#999'>none</span>"
_BAD, _WARN = "#c92a2a", "#b35900"


class LivePanel:
    """The page's words and numbers about the frame that is shown."""

    def __init__(self, gui: GuiApi, note: str) -> None:
        self._html = gui.add_html("")
        self._note = note

    def show(self, shown: ShownFrame, nearest: Sequence[Pair]) -> None:
        """Write the numbers of a frame."""
        frame, told = shown.frame, shown.frame.told
        paused = "" if frame.playing else " (paused)"
        parts = [_line("time", f"{frame.time:.3f} s{paused}")]
        for text in filter(None, (frame.remark, self._note)):
            parts.append(f"<div style='color:{_WARN}'>{escape(text)}</div>")
        if frame.phase:
            parts.append(_line("phase", escape(frame.phase)))
        if shown.cast is not None:
            parts.append(_line("held", escape(", ".join(shown.held) or "nothing")))
        if frame.pull is not None:
            newtons = np.linalg.norm(frame.pull.force)
            parts.append(_line("pull", f"{newtons:.3g} N at {escape(frame.pull.frame)}"))
        if told is not None:
            budget = None if shown.cast is None else shown.cast.dt
            parts += [_tick(told, budget), _status(told)]
            parts += [_heading("Errors"), _errors(shown, told)]
            parts += [_heading("Constraints that hold back"), _names(told.active)]
            parts += [_heading("Joint limits that hold back"), _names(told.at_limit)]
            if told.relaxed:
                worst = sorted(told.relaxed.items(), key=lambda one: -abs(one[1]))
                words = (f"{name}: {by:.3g}" for name, by in worst)
                parts += [_heading("Gave way"), _names(words)]
        if nearest:
            parts += [_heading("Nearest pairs (least kept)"), *map(_pair, nearest[:MOST_LISTED])]
        self._html.content = f"<div style='{_STYLE}'>{''.join(parts)}</div>"


def _line(name: str, value: str) -> str:
    return (
        "<div style='display:flex;justify-content:space-between;gap:1em'>"
        f"<span style='color:#555'>{name}</span><span style='text-align:right'>{value}</span></div>"
    )


def _heading(text: str) -> str:
    return f"<div style='{_HEAD}'>{text}</div>"


def _tick(told: TickInfo, budget: float | None) -> str:
    solver = "" if told.solve is None else f" (solver {1e3 * told.solve:.2f})"
    text = f"{1e3 * told.seconds:.2f} ms{solver}"
    if budget is None:
        return _line("tick", text)
    colour = _BAD if told.seconds > budget else "inherit"
    return _line("tick", f"<span style='color:{colour}'>{text} of {1e3 * budget:.3g}</span>")


def _status(told: TickInfo) -> str:
    if not told.ok:
        return f"<div style='color:{_BAD}'>{escape(told.report)}</div>"
    scaled = f", {100.0 * told.step_scale:.0f} % commanded" if told.step_scale < 1.0 else ""
    return _line("QP", f"solved{scaled}")


def _errors(shown: ShownFrame, told: TickInfo) -> str:
    tasks = () if shown.cast is None else shown.cast.tasks
    units = {task.name: ", ".join(dict.fromkeys(task.units)) for task in tasks}
    lines = [
        _line(escape(name), f"{np.linalg.norm(error):.3g} {escape(units.get(name, ''))}")
        for name, error in told.errors.items()
    ]
    return "".join(lines) or _NONE


def _names(names: Iterable[str] | None) -> str:
    if names is None:
        return "<span style='color:#999'>not recorded</span>"
    names = list(names)
    lines = [f"<div>{escape(name)}</div>" for name in names[:MOST_LISTED]]
    if len(names) > MOST_LISTED:
        lines.append(f"<div style='color:#999'>and {len(names) - MOST_LISTED} more</div>")
    return "".join(lines) or _NONE


def _pair(pair: Pair) -> str:
    red, green, blue = pair.colour
    dot = f"<span style='color:rgb({red},{green},{blue})'>&#9679;</span>"
    lengths = f"{1e3 * pair.distance:.1f}&nbsp;({1e3 * pair.margin:.3g})&nbsp;mm"
    return _line(f"{dot} {escape(pair.label)}", lengths)
