"""Sliders for the tasks' targets (inertia, CoM) and weights."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from viser import GuiApi

from wbc.spatial import COMPONENTS, DIAGONAL, vech
from wbc.validate import Array
from wbc.view.live.messages import ControllerInfo, Release, Request, SetTarget, SetWeight, TaskInfo
from wbc.view.live.shown_frame import ShownFrame

USER_HOLD_TIME = 0.6  # s after the user has moved a slider, until it follows the target again
FACTORS = (0.5, 2.0)  # of an inertia, relative to that at the first frame
OFFSET = 0.15  # of the robot's size: how far a slider moves the CoM
TAB_ORDER = 0.5  # order on the page: after the button, before the weights
DECADES = 2.0  # of a weight's factor, either way
PRINCIPAL = ("smallest", "middle", "largest")


class Follower(NamedTuple):
    """A slider for entries of a task's target: they are ``zero + value * slope``."""

    slider: Any
    task: str
    chosen: Array  # indices of the entries
    zero: Array
    slope: Array

    def position(self, target: Array) -> float:
        """Return where the slider stands by a target."""
        return float((target[self.chosen] - self.zero).sum() / self.slope.sum())


class Sliders:
    """The sliders of the present tasks, in a tab of the page.

    ``tab``: context that GUI elements are put into.
    ``send``: called with what the user wants.
    ``size``: the robot's [m].
    """

    def __init__(self, gui: GuiApi, tab: Any, send: Callable[[Request], None], size: float) -> None:
        self._gui, self._tab, self._send, self._size = gui, tab, send, size
        # By task the elements that are shown while it is in use; they are made once.
        self._elements = dict[tuple[str, str, str, tuple[str, ...]], list[Any]]()
        self._followers: list[Follower] = []
        self._touched = dict[str, float]()
        self._targets = dict[str, Array]()
        # By task what its sliders are relative to: moments [kg m^2], or the CoM [m].
        self._base = dict[str, Array]()
        self._weights = dict[str, Any]()
        with tab:
            release = gui.add_button(
                "Give targets and weights back",
                hint="To the problem, or to the program.",
                order=0.0,
            )
            release.on_click(lambda _: self._release())
            self._weights_folder = gui.add_folder("Weights, powers of ten", order=1.0)

    def cast(self, cast: ControllerInfo, shown: ShownFrame) -> None:
        """Make the sliders of tasks that are new, and hide those of tasks that are over."""
        used = {(task.name, task.kind, task.frame, task.rows): task for task in cast.tasks}
        for key, task in used.items():
            if key not in self._elements:
                self._elements[key] = self._made(task, shown)
        for key, elements in self._elements.items():
            for element in elements:
                element.visible = key in used

    def _made(self, task: TaskInfo, shown: ShownFrame) -> list[Any]:
        made = list[Any]()
        with self._tab:
            if task.kind in ("inertia", "principal"):
                made.append(self._add_inertia(task, shown))
            elif task.kind == "com":
                made.append(self._add_com(task, shown))
        with self._weights_folder:
            return [*made, self._add_weight(task)]

    def show(self, shown: ShownFrame) -> None:
        """Let sliders follow targets that the program moves."""
        now = time.monotonic()
        self._targets = {name: target[0] for name, target in shown.frame.targets.items()}
        for one in self._followers:
            target = self._targets.get(one.task)
            held = now - self._touched.get(one.task, -USER_HOLD_TIME) < USER_HOLD_TIME
            if target is not None and not held:
                value = float(np.clip(one.position(target), one.slider.min, one.slider.max))
                one.slider.value = round(value, 3)

    # ------------------------------------------------------------------ kinds of sliders

    def _add_inertia(self, task: TaskInfo, shown: ShownFrame) -> Any:
        rows: tuple[str, ...]
        if task.kind == "principal":
            moments = np.linalg.eigvalsh(shown.snapshot.inertia)
            base, rows = np.asarray(moments, float), PRINCIPAL
            entries = [np.array([k]) for k in range(3)]
        elif task.rows == ("trace",):
            base, rows = vech(shown.snapshot.inertia_in(task.frame)), ("trace",)
            entries = [DIAGONAL]
        else:
            base = vech(shown.snapshot.inertia_in(task.frame))
            rows = tuple(row for row in task.rows if row[0] == row[1])
            entries = [np.array([COMPONENTS.index(row)]) for row in rows]
        base = self._base.setdefault(task.name, base)
        folder = self._gui.add_folder(f"Inertia wanted: {task.name}", order=TAB_ORDER)
        with folder:
            for row, chosen in zip(rows, entries, strict=True):
                slider = self._gui.add_slider(
                    f"{row} times", *FACTORS, 0.01, 1.0, hint="Relative to that at the first frame."
                )
                self._connect(Follower(slider, task.name, chosen, 0.0 * base[chosen], base[chosen]))
        return folder

    def _add_com(self, task: TaskInfo, shown: ShownFrame) -> Any:
        base = self._base.setdefault(task.name, shown.snapshot.com.copy())
        reach = 10 * round(100.0 * OFFSET * self._size)
        folder = self._gui.add_folder(f"CoM wanted: {task.name}", order=TAB_ORDER)
        with folder:
            for row in task.rows:
                slider = self._gui.add_slider(
                    f"{row} [mm]", -float(reach), float(reach), 1.0, 0.0, hint="From that at first."
                )
                chosen = np.array(["xyz".index(row)])
                self._connect(Follower(slider, task.name, chosen, base[chosen], np.array([1e-3])))
        return folder

    def _add_weight(self, task: TaskInfo) -> Any:
        slider = self._gui.add_slider(
            task.name, -DECADES, DECADES, 0.1, 0.0, hint="The weight is multiplied by 10 to this."
        )

        async def changed(event: Any) -> None:  # async: in the order in which it happened
            if event.client_id is not None:
                self._send(SetWeight(task.name, 10.0 ** float(event.target.value)))

        slider.on_update(changed)
        self._weights[task.name] = slider
        return slider

    # ------------------------------------------------------------------

    def _connect(self, one: Follower) -> None:
        """Send a task's target when the user moves a slider, which else follows it."""
        self._followers.append(one)

        async def changed(event: Any) -> None:
            if event.client_id is not None and one.task in self._targets:
                self._touched[one.task] = time.monotonic()
                wanted = self._targets[one.task].copy()
                wanted[one.chosen] = one.zero + float(event.target.value) * one.slope
                self._targets[one.task] = wanted
                self._send(SetTarget(one.task, (wanted,)))

        one.slider.on_update(changed)

    def _release(self) -> None:
        self._touched.clear()
        for slider in self._weights.values():
            slider.value = 0.0
        self._send(Release())
