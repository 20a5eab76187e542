"""The global search drives mimic joints by their gears, as the arm's own mechanics do."""

import numpy as np
import pytest
from scipy.optimize import minimize

from tests.urdf import geared_arm, limit
from wbc.constraints import Limits, support
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.shaping import GlobalShaping
from wbc.tasks import PositionTask, PostureTask


@pytest.mark.parametrize(
    ("target", "most"),
    [((0.3, 0.0, 0.5), 2.0), ((-0.5, 0.0, 0.1), 2.0), ((2.0, 0.0, 0.3), 2.0)]
    + [((-0.5, 0.0, 0.1), 0.15)],  # as far as c goes
)
def test_the_best_posture_keeps_the_gears(target: tuple[float, ...], most: float) -> None:
    """Oracle: SciPy over the two joints that are driven, from a grid, through Robot.posture."""
    robot = Robot.load(geared_arm(c=limit(most, 9, 2)))
    q = robot.posture()
    # In weights and gains as the search's cost counts them: gain / 2 of squared errors.
    tasks = [
        PositionTask(robot, "link_d", target, gain=1.0),
        PostureTask(robot, q, weight=0.1, gain=1.0),
    ]
    names, rest = robot.joint_names, robot.limits.joint_positions(q)
    # b so that c = -2 b + 0.1 stays in range, which is the tighter.
    box = [(-2.0, 2.0), ((0.1 - most) / 2, (0.1 + most) / 2)]

    def cost(x: np.ndarray) -> float:
        joints = {"a": x[0], "b": x[1], "c": -2 * x[1] + 0.1, "d": -x[1] + 0.05}
        there = np.array([joints[name] for name in names])
        step = np.concatenate((np.zeros(6), there - rest))
        place = robot.snapshot(robot.integrate(q, step, 1.0)).position("link_d")
        off = place - target
        return 0.5 * float(off @ off) + 0.005 * float((there - rest) @ (there - rest))

    starts = [np.array([a, b]) for a in np.linspace(-2, 2, 5) for b in np.linspace(-0.9, 1, 5)]
    found = [minimize(cost, x, bounds=box, method="L-BFGS-B").fun for x in starts]
    contacts = support(robot.snapshot(q), "floating")  # the base is bolted
    outcome = GlobalShaping(robot, tasks, contacts=contacts).solve(q, starts=16, workers=1)
    best = outcome.best
    assert best.cost == pytest.approx(min(found), rel=1e-6)
    now = dict(zip(names, robot.limits.joint_positions(best.q), strict=True))
    assert now["c"] == pytest.approx(-2 * now["b"] + 0.1, abs=1e-12)
    assert now["d"] == pytest.approx(-now["b"] + 0.05, abs=1e-12)
    joints = robot.limits.joint_positions(best.q)
    assert (np.abs(joints) <= 2.0 + 1e-9).all()
    assert abs(now["c"]) <= most + 1e-9
    assert most == 2.0 or abs(now["c"]) == pytest.approx(most, abs=1e-6)


def test_the_way_there_keeps_them_too() -> None:
    robot = Robot.load(geared_arm())
    q = robot.posture()
    tasks = [PositionTask(robot, "link_d", (0.3, 0.0, 0.5))]
    contacts = support(robot.snapshot(q), "floating")
    shaping = GlobalShaping(robot, tasks, contacts=contacts)
    motion = shaping.reach(q, shaping.solve(q, starts=8, workers=1))
    assert motion.arrived, motion.attempts
    for at in motion.q:
        now = dict(zip(robot.joint_names, robot.limits.joint_positions(at), strict=True))
        assert now["c"] == pytest.approx(-2 * now["b"] + 0.1, abs=1e-6)


def test_gears_that_leave_no_range_are_named() -> None:
    robot = Robot.load(geared_arm(c=limit(5).replace('"-5"', '"4"')))  # for b from -2 to -1.95
    q = robot.postures["neutral"]
    tasks = [PositionTask(robot, "link_d", (0.3, 0.0, 0.5))]
    with pytest.raises(InvalidInputError, match="no position of joint 'b' leaves 'c'"):
        shaping = GlobalShaping(robot, tasks, limits=Limits(robot, margin=0.1))
        shaping.solve(q, starts=2, workers=1)
