"""Small studies run, and find what they should."""

from types import SimpleNamespace

import collision
import numpy as np
import pytest
import thrown

from benchmarks import infeasible
from benchmarks.simulation import measure
from wbc.constraints import Limits, SelfCollision
from wbc.qp.solution import Conflict
from wbc.robot import Robot


@pytest.mark.slow
def test_an_episode_begins_outside_all_margins_and_keeps_them(hoap2: Robot) -> None:
    limits = Limits(hoap2)
    margins = SelfCollision(hoap2, margin=collision.MARGIN, pairs=collision.PAIRS, limits=limits)
    assert margins.margins.min() < collision.MARGIN  # what once made it search for ever
    rng, record = np.random.default_rng(0), collision.Record()
    q = collision.clear_posture(hoap2, margins, rng)
    assert (margins.model.nearest(hoap2.snapshot(q)).distance > margins.margins).all()
    collision.episode(hoap2, margins, limits, "double", rng, "daqp", record)
    assert record.ticks == collision.EPISODE and set(record.statuses) == {"solved"}
    assert record.broken < 1e-6


@pytest.mark.slow
def test_rows_for_few_pairs_keep_all_pairs_of_a_fast_robot() -> None:
    """Hundreds were broken, by decimetres, when only the 25 nearest had rows."""
    row = thrown.thrown("g1", "nothing", 25, 150, 0).split()
    broken, worst = int(row[6]), float(row[7])
    assert broken <= 5 and worst < 0.5


@pytest.mark.slow
def test_bodies_on_short_levers_outweigh_tasks() -> None:
    """Where a hand moves 3 cm by a radian, a task pushed it 15 mm into others."""
    row = thrown.thrown("hoap2_like", "nothing", 25, 120, 1).split()
    broken, worst = int(row[6]), float(row[7])
    assert broken <= 5 and worst < 0.5


@pytest.mark.slow
def test_rows_for_few_pairs_keep_fast_arms_off_obstacles() -> None:
    """Hands went 47 mm into balls, and feet slipped, when only the 5 nearest had rows."""
    row = thrown.thrown("g1", "balls", 5, 150, 2).split()
    broken, worst, slipped = int(row[6]), float(row[7]), float(row[-1])
    assert broken == 0 and worst == 0.0 and slipped < 1.0


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


def test_a_line_of_the_table() -> None:
    cells = [cell.strip() for cell in measure("hoap2_like", "daqp", 0.1).strip("|").split("|")]
    assert cells[:2] == ["hoap2_like", "daqp"] and cells[-1] == "stood for 0.100 s"
    times = [float(cell) for cell in cells[2:9]]
    assert all(time > 0.0 for time in times)
    cpu, physics, ticks, rest = times[1:5]
    assert abs(cpu - physics - ticks - rest) < 0.02  # of which it is the sum, rounded
