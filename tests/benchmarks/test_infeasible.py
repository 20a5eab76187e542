"""Every row that a tick names is to blame, and the benchmark of that sees what is wrong."""

from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks import infeasible
from wbc.qp.solution import Conflict


@pytest.mark.parametrize("family", infeasible.FAMILIES)
def test_every_row_that_a_tick_names_is_to_blame(hoap2, family) -> None:
    rng, robot = np.random.default_rng(0), hoap2
    controller, here, limits = infeasible.contradictory(robot, family, rng)
    tick, box = controller.step(here), limits.emergency_braking_box(here, controller.dt)
    assert not tick.ok
    assert infeasible.check_answer(tick, box) == []
    fewer = Conflict(tick.conflict.rows[1:])
    other = SimpleNamespace(velocity=tick.velocity, qp=tick.qp, ok=False, conflict=fewer)
    found = infeasible.check_answer(other, box)
    assert found == ["no row named"] or "they can all hold" in found[0]
