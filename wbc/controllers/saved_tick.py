"""Saved ticks: a controller's inputs and outputs in a file, to replay them elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from wbc.controllers.controller import Controller
from wbc.controllers.tick import TICK_FILE, Tick
from wbc.errors import ControllerFailure, InvalidInputError
from wbc.safe_pickle import made_with, read_pickled
from wbc.validate import Array


class Replay(NamedTuple):
    """A saved tick that was computed again.

    Attributes
    ----------
    tick:
        The controller's result now.
    differences:
        Descriptions of what differs by even one bit; empty if nothing does.
    """

    tick: Tick
    differences: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether the result is the same to the last bit."""
        return not self.differences


class SavedTick(NamedTuple):
    """A tick that :meth:`wbc.Tick.save` has written.

    Attributes
    ----------
    controller:
        As it was before the tick, except for its solver's warm start.
    q, v:
        (nq,), (nv,) the state at the tick.
    answer:
        The saved results: ``velocity``, ``torque`` at the torque level, ``status``, ``policy``,
        ``slack``, ``solver``, ``report``.
    versions:
        Versions of the packages that computed it.
    """

    controller: Controller
    q: Array
    v: Array
    answer: Mapping[str, object]
    versions: Mapping[str, str]

    @classmethod
    def load(cls, path: str | Path, code: str | Path | None = None) -> Self:
        """Read a tick's file.

        Parameters
        ----------
        code:
            The Python file that defines your own tasks or constraints; it is executed. Without it a
            file can refer only to this package's classes.

        Raises
        ------
        InvalidInputError
            The file is of another kind, damaged, or refers to code that was not given.
        OSError
            The file cannot be read.
        """
        own = None if code is None else Path(code)
        content, versions = read_pickled(path, TICK_FILE, own)
        try:
            controller, before, measured, answer = content
            controller._restore(before)
            numbers = np.frombuffer(measured)
            robot = controller.robot
            q, v = numbers[: robot.nq], numbers[robot.nq :]
            return cls(controller, q, v, dict(answer), versions)
        except (TypeError, ValueError, AttributeError) as error:
            raise InvalidInputError(f"{path}: is damaged: {error}") from error

    def replay(self) -> Replay:
        """Run the controller again, and compare the results.

        Ticks that failed, that were relaxed, or whose QP the core solved alone are reproduced to
        the last bit; one that ProxQP solved from a warm start, which is not saved, to its accuracy.
        Replay a loaded tick once only: the controller's state changes.
        """
        try:
            tick = self.controller._replay_step(self.controller.robot.snapshot(self.q, self.v))
        except ControllerFailure as failure:
            if not isinstance(failure.tick, Tick):
                raise
            tick = failure.tick
        return Replay(tick, tuple(self._differences(tick.answer())))

    def _differences(self, now: Mapping[str, object]) -> list[str]:
        found = []
        for name, before in self.answer.items():
            after = now.get(name)
            if isinstance(before, np.ndarray) and isinstance(after, np.ndarray):
                if before.tobytes() != after.tobytes():
                    by = float(np.abs(before - after).max())
                    found.append(f"{name} by at most {by:.3g}")
            elif before != after and name != "report":
                found.append(f"{name} was {before}, is {after}")
        # The answer is the last level's: those above may be ProxQP's.
        cascade = len(self.controller.plan.levels) > 1
        solver = self.controller.backend.name if cascade else self.answer.get("solver")
        if found and solver == "proxqp":
            found.append("ProxQP began from a warm start, which is not in the file")
        here = made_with()
        others = [
            f"{k} {v}, here {here.get(k)}" for k, v in self.versions.items() if v != here.get(k)
        ]
        return [*found, *(f"it was answered by {one}" for one in others)] if found else []
