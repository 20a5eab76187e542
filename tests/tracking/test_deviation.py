"""Tracking errors of motions with a known distance from the plan."""

import numpy as np
import pytest

from wbc.rmp.plan import Plan
from wbc.robot import Snapshot
from wbc.tracking.deviation import Deviation, evaluate_tracking
from wbc.tracking.reference import PlanReference


def test_deviation_has_rms_largest_error_and_its_time() -> None:
    time = np.array((0.0, 1.0, 2.0, 3.0))
    actual = np.array(((0.0, 0.0), (3.0, 4.0), (np.nan, 0.0), (0.0, 1.0)))
    found = Deviation.of(time, actual, np.zeros((4, 2)), 10.0)
    assert found == Deviation(pytest.approx(np.sqrt(26.0 / 3.0)), 5.0, 1.0, 10.0)
    nothing = Deviation.of(time, np.full((4, 2), np.nan), np.zeros((4, 2)), 10.0)
    assert np.isnan([nothing.rms, nothing.worst, nothing.at]).all()


def test_deviation_of_a_robot_at_rest_is_the_motion_of_the_plan(
    plan: Plan, start: Snapshot
) -> None:
    reference = PlanReference(plan, start, begins=0.1)
    time = np.arange(0.0, 1.2, 0.01)
    n = len(time)
    shift = np.array((0.003, 0.004, 0.0))
    truth = {
        "time": time,
        "q": np.tile(start.q, (n, 1)),
        "v": np.zeros((n, start.robot.nv)),
        "cop": reference.at(time).cop + shift,
    }
    found = evaluate_tracking(reference, start.robot, truth)
    assert found.cop.rms == pytest.approx(0.005) == found.cop.worst
    # The crouch is 1 cm deep halfway.
    assert found.com.worst == pytest.approx(found.com.peak, rel=1e-3)
    assert found.com.at == pytest.approx(0.5, abs=0.011) and 0.01 <= found.com.worst < 0.02
    most = np.linalg.norm(plan.refined(8).momentum, axis=1).max()
    assert found.momentum.peak == pytest.approx(most, rel=1e-2)
    assert found.momentum.worst == pytest.approx(most, rel=1e-2)
    assert found.inertia.worst == pytest.approx(found.inertia.peak, rel=1e-3)
    assert found.whole and (found.begins, found.until) == (0.1, reference.ends)
    np.testing.assert_array_equal(found.arrays["plan_com"], reference.at(time).com)
    early = evaluate_tracking(
        reference, start.robot, {name: rows[:50] for name, rows in truth.items()}
    )
    assert not early.whole and early.until == pytest.approx(0.49)
    assert early.summary()["ends"] == reference.ends
