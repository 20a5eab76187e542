"""What loops determine is taken out of torque QPs: the answer is that of the QP as it stands."""

import numpy as np
import pytest

from tests.loops import ankle
from tests.standing import commanded
from wbc import Limits, PostureTask, TorqueController
from wbc.qp.core import DONE, INFEASIBLE, solve_in_core
from wbc.robot import Robot

robot = ankle.robot


def torque_level(robot: Robot, q: np.ndarray, **given: object) -> TorqueController:
    wanted = q.copy()
    wanted[robot.joint_index("pitch") + 1] += 0.3
    return TorqueController(robot, [PostureTask(robot, wanted)], limits=Limits(robot), **given)  # type: ignore[arg-type]


@pytest.mark.parametrize("solver", ["active_set", "proxqp"])
@pytest.mark.parametrize(("pitch", "roll"), ankle.POSES)
def test_torque_tick_of_loops_answers_the_qp_as_it_stands(
    robot: Robot, pitch: float, roll: float, solver: str
) -> None:
    q = robot.posture("standing", {"pitch": pitch, "roll": roll})
    controller = torque_level(robot, q, solver=solver)
    for tick, _ in commanded(controller, q, 5):  # at speed, rows have ends
        whole = solve_in_core(tick.qp, 1e-9, 1000)  # nothing is known of loops there
        assert whole.status == DONE
        np.testing.assert_allclose(tick.solution.x, whole.x, atol=1e-8)
        kkt = tick.qp.P @ tick.solution.x + tick.qp.g + tick.solution.z_box
        kkt += tick.qp.A.T @ tick.solution.y + tick.qp.C.T @ tick.solution.z
        np.testing.assert_allclose(kkt, 0.0, atol=1e-8)


def test_torque_tick_of_loops_without_a_solution_is_given_a_certificate(robot: Robot) -> None:
    q = robot.posture("standing", {"pitch": 0.1})
    weak = 1e-3  # of the motors: gravity asks for more than that part of their torques
    controller = torque_level(robot, q, torque_limits=weak, solver="active_set")
    assert controller.limits is not None
    controller.limits.speed = np.full(robot.nv - 6, 1e-6)  # and none may fall
    found = controller.core.tick(robot.snapshot(q, np.zeros(robot.nv)))
    assert found is not None
    assert controller.core.memory.status == INFEASIBLE
    qp, at = found.qp_of(0), found.views_of(0)
    np.testing.assert_allclose(at.y @ qp.A + at.z @ qp.C + at.z_box, 0.0, atol=1e-9)
    ends = at.y @ qp.b
    for z, lower, upper in ((at.z, qp.l, qp.u), (at.z_box, qp.lower, qp.upper)):
        ends += sum(one * (upper[k] if one > 0 else lower[k]) for k, one in enumerate(z) if one)
    assert ends < -1e-9
