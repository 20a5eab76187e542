"""Contacts and constraints that may give way; conflicts of ticks from wild states, by HiGHS."""

import numpy as np
import pytest
import qpsolvers
from conflict_judge import conflict_error

import wbc
from tests.needs import needs_bench
from wbc.constraints import Bounds, Limits, PositionBox, support
from wbc.constraints.contact import Contact
from wbc.controllers import KinematicController, TorqueController
from wbc.errors import InvalidInputError
from wbc.qp import Status
from wbc.robot import Robot, Snapshot
from wbc.tasks import ComTask, OrientationTask, PositionTask, PostureTask

DT = 0.005


def controller(robot: Robot, here: Snapshot, **settings) -> KinematicController:
    """A CoM task that pulls against what is held."""
    wanted = here.com + (0.02, 0.0, -0.02)
    tasks = [ComTask(robot, wanted, weight=10.0), PostureTask(robot, here.q, weight=0.1)]
    return KinematicController(robot, tasks, limits=Limits(robot), dt=DT, **settings)


def boxed(robot: Robot, here: Snapshot) -> PositionBox:
    """The base is where it may be, and may hardly go forward."""
    return PositionBox(robot, "base", here.q[:3] - 1.0, here.q[:3] + (1e-4, 1.0, 1.0))


def test_a_soft_contact_is_its_rows_as_a_cost(hoap2: Robot, here: Snapshot) -> None:
    contacts = support(here, "double")
    soft = controller(hoap2, here, contacts=contacts, slack={contacts[0].frame: 30.0}).step(here)
    hard = controller(hoap2, here, contacts=contacts[1:]).step(here)
    # The oracle: the QP with one contact, the other one's rows added to its cost by hand.
    J = here.jacobian(contacts[0].frame)
    expected = qpsolvers.solve_qp(
        hard.qp.P + 30.0 * J.T @ J, hard.qp.g, A=hard.qp.A, b=hard.qp.b,
        lb=hard.qp.lower, ub=hard.qp.upper, solver="daqp",
    )  # fmt: skip
    assert soft.ok
    # Damping 1e-6 against rows of 10: a part in 1e7 of the velocity is not determined.
    np.testing.assert_allclose(soft.velocity, expected, atol=1e-5)


class Nothing(PositionBox):
    """A box without a row now, as of pairs none of which is near."""

    def rows(self, snapshot: Snapshot, dt: float) -> Bounds:
        return Bounds((), np.zeros((0, self.robot.nv)), np.zeros(0), np.zeros(0))


def test_a_soft_constraint_without_rows_has_no_slack(hoap2: Robot, here: Snapshot) -> None:
    """The torque level's own rows were taken for its."""
    nothing = Nothing(hoap2, "base", here.q[:3] - 1.0, here.q[:3] + 1.0)
    balance = TorqueController(
        hoap2,
        [PostureTask(hoap2, here.q)],
        contacts=support(here, "double"),
        constraints=[nothing],
        slack={nothing.name: 1.0},
    )
    tick = balance.step(here)
    assert tick.ok and tick.slack == {}


def test_a_soft_contact_counts_by_its_own_weight_too(hoap2: Robot, here: Snapshot) -> None:
    """A cost is 1/2 slack |weight (rate - wanted)|^2: twice the weight is four times the slack."""
    given = {
        weight: controller(
            hoap2,
            here,
            contacts=[PositionTask(hoap2, "left_palm", here.position("left_palm"), weight=weight)],
            slack={"left_palm position": slack},
        ).step(here)
        for weight, slack in ((1.0, 40.0), (2.0, 10.0), (3.0, 40.0))
    }
    np.testing.assert_allclose(given[2.0].qp.P, given[1.0].qp.P, rtol=1e-12, atol=1e-12)
    assert np.abs(given[3.0].qp.P - given[1.0].qp.P).max() > 1.0


@pytest.mark.parametrize("weight", [1.0, 1e3])
def test_a_soft_constraint_gives_way_by_pull_over_weight(hoap2, here, weight) -> None:
    box = boxed(hoap2, here)
    far = PositionBox(hoap2, "left_palm", here.q[:3] - 9.0, here.q[:3] + 9.0)  # does not give way
    held = {"contacts": support(here, "double"), "constraints": [box, far]}
    tick = controller(hoap2, here, **held, slack={box.name: weight}).step(here)
    assert tick.ok
    assert tick.slack, "the CoM task pulls forward, so the box must give way"
    # Stationarity of the slacks: weight s = multiplier of the row, whatever the rest of the QP is.
    rows = list(tick.qp.labels.inequality)
    for name, slack in tick.slack.items():
        assert weight * slack == pytest.approx(tick.solution.z[rows.index(name)], rel=1e-5)
    free = controller(hoap2, here, contacts=support(here, "double")).step(here)
    held = controller(hoap2, here, contacts=support(here, "double"), constraints=[box]).step(here)
    forward = [each.velocity[0] for each in (held, tick, free)]
    assert forward[0] <= forward[1] + 1e-9 <= forward[2] + 2e-9
    assert forward[0] < forward[2] - 1e-3


def test_a_heavy_slack_is_as_good_as_hard(hoap2: Robot, here: Snapshot) -> None:
    box = boxed(hoap2, here)
    settings = {"contacts": support(here, "double"), "constraints": [box]}
    hard = controller(hoap2, here, **settings).step(here)
    soft = controller(hoap2, here, slack={box.name: 1e7}, **settings).step(here)
    # The row gives way by its pull, some 100, over the weight; joints move up to ten times as much.
    np.testing.assert_allclose(soft.velocity, hard.velocity, atol=5e-4)


def test_levels_below_do_not_disturb_a_soft_contact(hoap2: Robot, here: Snapshot) -> None:
    contacts = support(here, "double")
    hand = PositionTask(hoap2, "left_hand", here.position("left_hand") + 0.1, priority=1)
    com = ComTask(hoap2, here.com + (0.02, 0.0, 0.0), weight=10.0)
    first = KinematicController(
        hoap2, [com], contacts=contacts, limits=Limits(hoap2), slack={contacts[0].frame: 30.0}
    ).step(here)
    both = KinematicController(
        hoap2, [com, hand], contacts=contacts, limits=Limits(hoap2), slack={contacts[0].frame: 30.0}
    ).step(here)
    assert first.ok and both.ok
    J = np.concatenate((here.com_jacobian, here.jacobian(contacts[0].frame)))
    np.testing.assert_allclose(J @ both.velocity, J @ first.velocity, atol=1e-7)
    assert np.abs(both.velocity - first.velocity).max() > 1e-3


@pytest.mark.parametrize("first", [True, False])
def test_slack_is_what_the_first_level_needs(hoap2: Robot, here: Snapshot, first: bool) -> None:
    """A goal past a soft box gave way to it by its weight on whichever level it was."""
    hand, weights = here.position("left_hand"), {"box of left_hand": 10.0}
    box = PositionBox(hoap2, "left_hand", hand - 1.0, hand + (1e-4, 1.0, 1.0))
    goal = PositionTask(hoap2, "left_hand", hand + (0.1, 0.0, 0.0), weight=10.0)
    rest = PostureTask(hoap2, here.q, weight=0.1, priority=1)
    pull = PositionTask(hoap2, "left_hand", hand + (0.3, 0.0, 0.0), name="pull", priority=1)
    trunk = OrientationTask(hoap2, "torso", here.rotation("torso"))
    levels = [goal, pull, rest] if first else [trunk, pull, rest]
    parts = {"contacts": support(here, "double"), "limits": Limits(hoap2), "dt": DT}
    ticks = [
        KinematicController(hoap2, tasks, **parts, constraints=[box], slack=weights).step(here)
        for tasks in (levels, levels[:1])
    ]
    assert all(tick.ok for tick in ticks)
    speed, alone = (here.jacobian("left_hand")[0] @ tick.velocity for tick in ticks)
    if first:  # strictly convex in the slack: one optimum of it
        assert ticks[0].slack == pytest.approx(ticks[1].slack, rel=1e-6)
        assert speed == pytest.approx(alone, rel=1e-6) and speed > 1e-2
    else:
        assert not ticks[0].slack and speed < 1e-2


def test_slack_of_a_name_that_two_constraints_have_is_refused(hoap2: Robot, here: Snapshot) -> None:
    """Both gave way; with names of their own one does."""
    soft, hard = boxed(hoap2, here), boxed(hoap2, here)
    contacts = support(here, "double")
    given = {"contacts": contacts, "constraints": [soft, hard]}
    with pytest.raises(InvalidInputError, match="2 contacts and constraints are called 'box of b"):
        controller(hoap2, here, slack={"box of base": 1.0}, **given)
    soft.name = "soft"
    apart = controller(hoap2, here, slack={"soft": 1.0}, **given)
    assert apart.slacks.is_hard(hard.name) and not apart.slacks.is_hard(soft.name)


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
