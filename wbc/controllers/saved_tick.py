"""A tick in a file: all that its controller was asked with, answered again wherever it is read."""

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
    """A saved tick that was asked for again.

    Attributes
    ----------
    tick:
        What the controller answers now.
    differences:
        What is not the same to the last bit, in words; empty if all is.
    """

    tick: Tick
    differences: tuple[str, ...]

    @property
    def same(self) -> bool:
        """Whether the answer is the same to the last bit."""
        return not self.differences


class SavedTick(NamedTuple):
    """A tick that :meth:`wbc.Tick.save` has written.

    Attributes
    ----------
    controller:
        As it was before the tick, but for its solver's warm start.
    q, v:
        (nq,), (nv,) the state that it was asked with.
    answer:
        What it answered: ``velocity``, ``torque`` at the torque level, ``status``, ``policy``,
        ``slack``, ``solver``, ``report``.
    versions:
        That it was answered with.
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
            The Python file that defines tasks or constraints of yours; it is run. Without it a
            file can name nothing but this package's classes.

        Raises
        ------
        InvalidInputError
            Another file, a damaged one, or one that names code that was not given.
        OSError
            It cannot be read.
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
        """Ask the controller again, and compare.

        Ticks that failed, that gave way, or whose QP the core solved alone are answered to the
        last bit; one that ProxQP solved from a warm start, which no file holds, to its accuracy.
        One read is for one replay: the controller goes on from there.
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
        if found and self.answer.get("solver") == "proxqp":
            found.append("ProxQP began from a warm start, which is not in the file")
        here = made_with()
        others = [f"{k} {v}, here {here.get(k)}" for k, v in self.versions.items() if v != here[k]]
        return [*found, *(f"it was answered by {one}" for one in others)] if found else []
