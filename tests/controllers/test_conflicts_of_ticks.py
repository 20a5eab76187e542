"""Conflicts of ticks from wild states: true, and without a needless row, by HiGHS."""

import numpy as np
import pytest
from conflict_judge import conflict_error

import wbc
from tests.needs import needs_bench
from wbc.constraints.contact import Contact
from wbc.errors import InvalidInputError
from wbc.qp import Status

LEAST = 5  # of so many wild states in a row, that have none


def conflicts_of(robot, solver: str, count: int) -> int:
    """Check the conflicts of wild ticks; return how many there were."""
    rng, found = np.random.default_rng(3), 0
    start = robot.snapshot(robot.posture("standing"))
    for k in range(count):
        turn = np.concatenate((np.zeros(6), 0.3 * rng.normal(size=robot.nv - 6)))
        q = robot.integrate(start.q, turn, 1.0)
        here = robot.snapshot(q, rng.normal(size=robot.nv))
        feet = list(wbc.support(start if k % 2 else here, "double"))
        if k % 3 == 0:  # a second anchor for one foot
            away = here.position("left_foot") + 0.05 * rng.normal(size=3)
            feet.append(Contact(robot, "left_foot", away, here.rotation("left_foot")))
        one = wbc.KinematicController(
            robot, [wbc.ComTask(robot, here.com + 0.05)], contacts=feet, solver=solver,
            limits=wbc.Limits(robot),
            constraints=[wbc.SelfCollision(robot, margin=0.03)],
        )  # fmt: skip
        tick = one.step(here)
        if tick.status is Status.INFEASIBLE:
            assert conflict_error(tick.qp, tick.solution.conflict) == [], tick.report()
            found += 1
    return found


@pytest.mark.slow
@needs_bench
@pytest.mark.parametrize("solver", ["proxqp", "active_set", "clarabel", "daqp", "osqp", "piqp"])
def test_conflicts_of_wild_ticks_are_true_with_every_backend(hoap2, solver: str) -> None:
    assert conflicts_of(hoap2, solver, 40) >= LEAST


class Lift(wbc.Constraint):
    """A user's constraint that forbids rest: a foot rises at no less than ``speed`` [m/s]."""

    def __init__(self, robot: wbc.Robot, speed: float) -> None:
        self.robot, self.name, self.speed = robot, "lift", speed

    def rows(self, snapshot, dt):
        rise = snapshot.jacobian("left_sole")[2:3]
        return wbc.Bounds(("left foot up",), rise, np.full(1, self.speed), np.full(1, np.inf))


@pytest.mark.parametrize(("support", "against"), [("double", "left_sole z"), ("right", "")])
def test_constraint_of_ones_own_that_forbids_rest_is_met_or_in_the_conflict(
    hoap2, support: str, against: str
) -> None:
    """Margins give way to contacts that correct their drift; it was left out as they may be."""
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    one = wbc.KinematicController(
        hoap2, [wbc.PostureTask(hoap2, here.q)], contacts=wbc.support(here, support),
        limits=wbc.Limits(hoap2), constraints=[Lift(hoap2, 0.02)],
    )  # fmt: skip
    tick = one.step(here)
    assert tick.ok is not bool(against)
    if against:
        assert "'left foot up'" in tick.report() and f"'{against}'" in tick.report()
    else:
        assert (here.jacobian("left_sole") @ tick.velocity)[2] >= 0.02 - 1e-7


@pytest.mark.parametrize("kind", [wbc.KinematicController, wbc.TorqueController])
def test_bounds_that_no_number_meets_are_refused_at_both_levels(hoap2, kind) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    tasks, lift = [wbc.PostureTask(hoap2, here.q)], [Lift(hoap2, np.inf)]
    one = kind(hoap2, tasks, contacts=wbc.support(here, "double"), constraints=lift)
    with pytest.raises(InvalidInputError, match=r"'lift': .* 'left foot up' must lie between"):
        one.step(here)


def test_every_relaxed_tick_names_rows_that_contradict_and_are_all_needed(hoap2) -> None:
    """Of the QP in which all is hard, which the core sets up again: feet that drag, weak motors."""
    robot, rng = hoap2, np.random.default_rng(3)
    start = robot.snapshot(robot.posture("standing"))
    proved = 0
    for k in range(14):
        turn = np.concatenate((np.zeros(6), 0.2 * rng.normal(size=robot.nv - 6)))
        here = robot.snapshot(robot.integrate(start.q, turn, 1.0), rng.normal(size=robot.nv))
        one = wbc.TorqueController(
            robot, [wbc.PostureTask(robot, start.q)], contacts=wbc.support(start, "double"),
            limits=wbc.Limits(robot), torque_limits=(1.0, 0.1)[k % 2],
        )  # fmt: skip
        tick = one.step(here)
        if tick.policy != "relax":
            assert tick.conflict is None and tick.refuted is None
            continue
        proved += 1
        assert tick.refuted.status is Status.INFEASIBLE
        assert tick.conflict.describe() in tick.report()
        hard = one.core.tick(here, solve=False).qp_of(0)
        assert conflict_error(hard, tick.conflict) == [], tick.report()
    assert proved >= LEAST
