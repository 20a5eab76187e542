"""What is read of figures and of reports."""

import base64
import json
import re
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure


def plots(figure: Figure) -> dict[str, Any]:
    """Return the axes of plots by their titles."""
    return {axes.get_title(loc="left"): axes for axes in figure.axes if axes.get_title(loc="left")}


def check_apart(figure: Figure, ticks: bool = True) -> None:
    """Fail if two texts overlap, ``ticks`` too, or one is cut off by the figure's edge."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    boxes = []
    for axes in figure.axes:
        legend = axes.get_legend()
        texts = [axes.title, axes._left_title, axes.xaxis.label, axes.yaxis.label, *axes.texts]
        texts += [axis.get_offset_text() for axis in (axes.xaxis, axes.yaxis) if ticks]
        texts += legend.get_texts() if legend is not None else []
        for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
            shown = zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=False)
            if ticks and axis.get_visible():  # x of twins is written once
                texts += [label for place, label in shown if low <= place <= high]
        boxes += [
            (text.get_text(), text.get_window_extent(renderer))
            for text in texts
            if text.get_text() and text.get_visible()
        ]
    assert len(boxes) > 10
    for k, (name, box) in enumerate(boxes):
        for other, another in boxes[k + 1 :]:
            assert not box.overlaps(another), f"{name!r} over {other!r}"
        assert box.x0 >= 0.0 and box.y0 >= 0.0, name
        assert box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1, name


def data_of(page: str) -> dict[str, Any]:
    """Return the data of a report's page."""
    (text,) = re.findall(r'id="data">(.*?)</script>', page, flags=re.DOTALL)
    data: dict[str, Any] = json.loads(text)
    return data


def numbers(text: str, shape: tuple[int, ...], kind: str = "<f4") -> np.ndarray:
    """Return an array of a report's data."""
    return np.frombuffer(base64.b64decode(text), dtype=kind).reshape(shape)
