"""The next footstep: the QP against SLSQP, and what it means against the pendulum."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize

from wbc.gait.adaptation import StepBounds, StepPlan, StepWeights, adapt_step, step_qp
from wbc.gait.dcm import StepTimes, VrpSegment, dcm_offsets

OMEGA, TIMES = 3.9, StepTimes(0.4, 0.05)
STEP = np.array((0.3, -0.2))
BOUNDS = StepBounds(np.array((-0.5, -0.5)), np.array((0.5, -0.1)), 0.1, 0.5, np.array((0.05, 0.02)))


def nominal(left: float) -> StepPlan:
    """Return a plan that a steady walk of steps (0.3, +-0.2) has ``left`` before a landing."""
    steps = [STEP * (1.0, (-1.0) ** k) for k in range(12)]
    return StepPlan(STEP, left, dcm_offsets(steps[1:], TIMES, OMEGA)[0], np.zeros(2))


def steady_dcm(left: float) -> np.ndarray:
    """Return the DCM of that walk, from the standing foot."""
    steps = [STEP * (1.0, (-1.0) ** k) for k in range(12)]
    return dcm_offsets(steps, TIMES, OMEGA)[0] * math.exp(OMEGA * (TIMES.single - left))


@pytest.mark.parametrize("left", [0.4, 0.2, 0.1])
def test_a_steady_walk_is_left_alone(left: float) -> None:
    plan = adapt_step(steady_dcm(left), nominal(left), BOUNDS, OMEGA, TIMES.double)
    np.testing.assert_allclose(plan.place, STEP, atol=1e-5)  # what 11 steps ahead leave open
    assert plan.left == pytest.approx(left, abs=1e-5)
    np.testing.assert_allclose(plan.vrp, 0.0, atol=1e-5)


@pytest.mark.parametrize("seed", range(8))
def test_the_qp_is_solved(seed: int) -> None:
    """SLSQP knows nothing of DAQP; it is good to some 1e-6 here."""
    rng = np.random.default_rng(seed)
    left = float(rng.uniform(0.15, 0.4))
    dcm = steady_dcm(left) + rng.normal(scale=0.08, size=2)
    qp = step_qp(dcm, nominal(left), BOUNDS, OMEGA, TIMES.double, StepWeights())
    found = minimize(
        lambda x: 0.5 * x @ qp.P @ x + qp.g @ x,
        np.clip(np.zeros(7), qp.lower, qp.upper),
        jac=lambda x: qp.P @ x + qp.g,
        bounds=list(zip(qp.lower, qp.upper, strict=True)),
        constraints={"type": "eq", "fun": lambda x: qp.A @ x - qp.b, "jac": lambda x: qp.A},
        method="SLSQP",
        options={"maxiter": 500, "ftol": 1e-14},
    )
    plan = adapt_step(dcm, nominal(left), BOUNDS, OMEGA, TIMES.double)
    np.testing.assert_allclose(plan.place, found.x[:2], atol=2e-5)
    assert math.exp(OMEGA * (plan.left - left)) == pytest.approx(found.x[2], abs=2e-4)


def test_what_is_planned_is_where_the_pendulum_goes() -> None:
    """With the VRP at the foot the DCM arrives at the next foot plus the offset, exactly."""
    still = BOUNDS._replace(sole=np.zeros(2))
    dcm = steady_dcm(0.25) + (0.04, -0.02)
    plan = adapt_step(dcm, nominal(0.25), still, OMEGA, TIMES.double)
    assert plan.place[0] > STEP[0]  # pushed forwards, it steps further
    moving = dcm * math.exp(OMEGA * plan.left)
    shift = VrpSegment(np.zeros(2), plan.place, TIMES.double)
    back = shift.dcm_before(plan.place + plan.offset, TIMES.double, OMEGA)
    np.testing.assert_allclose(moving, back, atol=1e-9)


@pytest.mark.parametrize("push", [(1.0, 0.0), (-1.0, 0.5), (0.0, 1.0), (0.0, -1.0)])
def test_bounds_hold_however_hard_the_push(push: tuple[float, float]) -> None:
    plan = adapt_step(np.array(push), nominal(0.3), BOUNDS, OMEGA, TIMES.double)
    assert (plan.place >= BOUNDS.lower - 1e-7).all() and (plan.place <= BOUNDS.upper + 1e-7).all()
    assert BOUNDS.least <= plan.left <= BOUNDS.most
