"""The least squares of a whole motion, by differences."""

import numpy as np
import pytest

import wbc
from tests.retargeting.humans import stepping
from wbc.retargeting import RetargetWeights
from wbc.retargeting.normal_equations import NormalEquations
from wbc.retargeting.prepared import prepared
from wbc.retargeting.smoothing import WholeMotion
from wbc.retargeting.tasks import FrameTasks
from wbc.robot import Robot
from wbc.validate import Array


def test_slope_of_the_momentum_is_that_of_its_squares(rng: np.random.Generator) -> None:
    """In configurations and rates of all frames, bases that turn at 1 rad/s among them.

    Central differences at 1e-6; of a base's displacement terms of order (v dt)^2/12 are left out.
    """
    step = wbc.retarget(stepping(), Robot.load("hoap2_like"))
    known = prepared(step.robot, None, 0.01)
    tasks = FrameTasks(step.robot, known.body, step.targets, RetargetWeights(), known.legs)
    motion = WholeMotion(tasks, None)
    turned = np.zeros((len(step.q), step.robot.nv))
    turned[:, 3:6] = np.sin(np.arange(len(step.q)) * step.targets.dt)[:, None]
    q = motion.further(step.q, 0.3 * turned)
    normal = NormalEquations(*turned.shape)
    motion.momentum(motion.states(q), normal)

    def cost(d: Array) -> float:
        return motion.momentum(motion.states(motion.further(q, d)), NormalEquations(*d.shape))

    for _ in range(3):
        d = 1e-6 * rng.standard_normal(turned.shape)
        change = 0.5 * (cost(d) - cost(-d))
        assert 2.0 * float((normal.slope * d).sum()) == pytest.approx(change, rel=1e-3)
