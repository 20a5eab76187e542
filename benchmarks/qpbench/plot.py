"""QP solvers in a picture: performance profiles, and times by solver."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from qpbench.summary import RATIOS
from wbc.view import style

WIDTH, HEIGHT, TITLE = 10.5, 4.4, 0.45  # inches
DASHES = ("-", "--", ":", "-.")


def plot_bench(summary: Mapping[str, Any], path: str | Path) -> None:
    """Draw the figures of ``wbc bench`` at the first accuracy.

    Raises
    ------
    InvalidInputError
        A file that no picture can be written to.
    """
    file = style.picture_file(path)
    eps, at = next(iter(summary["accuracies"].items()))
    figures = {name: one["all"] for name, one in at["solvers"].items()}
    ranked = sorted(figures, key=lambda name: figures[name]["shifted_geometric_mean"])
    count = sum(one["QPs"] for one in summary["sequences"].values())
    title = f"{count} QPs in {len(summary['sequences'])} sequences, accuracy {eps}"
    figure = style.sheet(WIDTH, HEIGHT + TITLE, title, plots=HEIGHT)
    left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": (1.0, 1.15)})
    style.plain(left, "performance profile", "time / time of the fastest", "share of QPs solved")
    for k, name in enumerate(ranked):
        colour, dash = _line(k)
        left.plot(RATIOS, at["profile"][name], dash, color=colour, linewidth=1.4)
    left.set_xscale("log")
    left.set_xlim(1.0, RATIOS[-1])
    left.set_ylim(0.0, 1.02)
    left.set_xticks([1, 3, 10, 30, 100], ["1", "3", "10", "30", "100"])
    style.plain(right, "median, 99th percentile and 99.9th", "time of a QP [us]", "")
    for k, name in enumerate(reversed(ranked)):
        one = figures[name]
        p50, p99, p999 = (1e6 * one[key] for key in ("median", "p99", "p99.9"))
        colour, dash = _line(len(ranked) - 1 - k)
        right.plot([p50, p999], [k, k], dash, color=colour, linewidth=1.4)
        right.plot([p50], [k], "o", color=colour, markersize=5)
        right.plot([p99], [k], "|", color=colour, markersize=9)
        right.plot([p999], [k], ">", color=colour, markersize=4)
    labels = [f"{name} ({100 * figures[name]['success']:.4g} %)" for name in reversed(ranked)]
    right.set_yticks(np.arange(len(ranked)), labels)
    right.set_xscale("log")
    style.save(figure, file)


def _line(rank: int) -> tuple[str, str]:
    """Return colour and dashes of a solver, in both plots."""
    count = len(style.SERIES)
    return style.SERIES[rank % count], DASHES[rank // count % len(DASHES)]
