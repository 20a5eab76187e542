"""Ticks whose QP has no solution, whatever it is: for what comes after them."""

import pytest

from wbc.controllers.core_plan import CorePlan
from wbc.controllers.first_level import FirstLevel
from wbc.qp import Status
from wbc.qp.active_set import ActiveSet


def let_ticks_fail(monkeypatch: pytest.MonkeyPatch, status: Status = Status.FAILED) -> None:
    """Let the core find no command in any tick, and who is asked then say ``status``."""

    def refuse(self, found, *_):  # type: ignore[no-untyped-def]
        return ActiveSet().solve(found.qp_of(0))._replace(status=status)

    tick = CorePlan.tick

    def unsolved(self, *given, **named):  # type: ignore[no-untyped-def]
        found = tick(self, *given, **named)
        if found is not None:
            found.solved = False
        return found

    monkeypatch.setattr(CorePlan, "tick", unsolved)
    monkeypatch.setattr(FirstLevel, "solve", refuse)
