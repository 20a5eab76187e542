"""Contacts and constraints that may give way, and the closest command where none is left."""

import numpy as np
import pytest
import qpsolvers

from wbc.constraints import Bounds, Limits, PositionBox, support
from wbc.controllers import KinematicController, TorqueController
from wbc.errors import InvalidInputError
from wbc.robot import Robot, Snapshot
from wbc.tasks import ComTask, PositionTask, PostureTask

DT = 0.005


@pytest.fixture(scope="module")
def here(hoap2: Robot) -> Snapshot:
    return hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))


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
def test_a_soft_constraint_gives_way_by_pull_over_weight(
    hoap2: Robot, here: Snapshot, weight: float
) -> None:
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
