"""Rank and condition of a tick, against singular values of the stacked rows."""

import numpy as np
import pytest
from scipy.linalg import null_space

from wbc.constraints import PositionBox, support
from wbc.controllers import KinematicController, TorqueController
from wbc.controllers.singular import conditioning
from wbc.qp import QP
from wbc.robot import Robot
from wbc.tasks import ComTask, PositionTask, PostureTask


def test_rank_and_condition_are_those_of_the_rows(hoap2: Robot) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    hand = here.position("left_hand")
    tasks = [ComTask(hoap2, here.com, weight=3.0), PositionTask(hoap2, "left_hand", hand)]
    controller = KinematicController(hoap2, tasks, contacts=support(here, "double"), damping=1e-9)
    found = controller.conditioning(controller.step(here))
    J = np.concatenate((3.0 * here.com_jacobian, here.jacobian("left_hand")[:3]))
    held = np.concatenate([here.jacobian(f"{side}_sole") for side in ("left", "right")])
    free = null_space(held)
    values = np.linalg.svd(J @ free, compute_uv=False)
    assert found.free == free.shape[1]
    assert found.rank == np.linalg.matrix_rank(J @ free) == 6
    # The squares of 1e-9 of rounding and damping, relative to the least curvature.
    assert found.condition == pytest.approx((values[0] / values[-1]) ** 2, rel=1e-5)


def test_redundant_tasks_have_less_rank_than_rows(hoap2: Robot) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    hand = here.position("left_hand")
    same = [
        PositionTask(hoap2, "left_hand", hand),
        PositionTask(hoap2, "left_hand", hand, name="again"),
    ]
    controller = KinematicController(hoap2, same)
    tick = controller.step(here)
    assert tick.ok
    assert controller.conditioning(tick).rank == 3
    assert controller.conditioning(tick).free == hoap2.nv


def test_slacks_are_no_motions(hoap2: Robot) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    room = PositionBox.height(hoap2, here.position("base")[2] - 0.1, frame="base")
    found = []
    for slack in ({}, {room.name: 10.0}):
        controller = KinematicController(
            hoap2,
            [ComTask(hoap2, here.com, weight=3.0)],
            contacts=support(here, "double"),
            constraints=[room],
            slack=slack,
            damping=1e-9,
        )
        tick = controller.step(here)
        found.append(controller.conditioning(tick))
    np.testing.assert_array_equal(tick._evidence.slack_weights, [10.0])
    assert found[1] == found[0]


def test_forces_leave_the_motions_that_contacts_leave(hoap2: Robot) -> None:
    """Feet bear any motion that they allow; in the air the momentum is given."""
    here = hoap2.snapshot(hoap2.posture("standing"))
    task, posture = ComTask(hoap2, here.com, weight=3.0), PostureTask(hoap2, here.q)
    standing = TorqueController(hoap2, [task], contacts=support(here, "double"), damping=1e-9)
    falling = TorqueController(hoap2, [task, posture], contacts=())
    borne, thrown = (one.conditioning(one.step(here)) for one in (standing, falling))
    held = np.concatenate([here.jacobian(f"{side}_sole") for side in ("left", "right")])
    values = np.linalg.svd(here.com_jacobian @ null_space(held), compute_uv=False)
    assert borne.free == hoap2.nv - 12 and borne.rank == 3
    assert borne.condition == pytest.approx((values[0] / values[-1]) ** 2, rel=1e-5)
    assert thrown.free == thrown.rank == hoap2.nv - 6


def test_where_only_the_damping_decides_the_condition_is_one() -> None:
    """Curvatures of 9, 11 and 44 times the damping: that of tasks begins at ten times."""
    damping, weights = 0.5, np.array([1.0, 2.0, 4.0])

    def of(*curvatures: float) -> tuple[int, int, float]:
        P = np.diag(weights * (np.array(curvatures) + 1.0) * damping)
        return tuple(conditioning(QP.build(P, np.zeros(3)), damping, weights))

    assert of(0.0, 0.0, 9.0) == (3, 0, 1.0)
    assert of(9.0, 11.0, 0.0) == (3, 1, 1.0)
    assert of(44.0, 9.0, 11.0) == (3, 2, pytest.approx(4.0))
