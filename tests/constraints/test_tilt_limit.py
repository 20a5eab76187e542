"""A tilt limit against the angle that SciPy's rotations give, and in a loop that pulls past it."""

import itertools

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.standing import commanded
from wbc import KinematicController, OrientationTask, PostureTask, support
from wbc.constraints import BrakingParameters, PositionBox, TiltLimit
from wbc.constraints.margin import SKIN
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.robot.symbolic import SymbolicPosture

TRUNK = "base"


def tilted(robot: Robot, vector) -> np.ndarray:
    """Return a configuration whose base is turned by a rotation vector [rad]."""
    q = robot.posture("standing").copy()
    q[3:7] = (Rotation.from_rotvec(vector) * Rotation.from_quat(q[3:7])).as_quat()
    return q


def tilt_of(robot: Robot, q: np.ndarray, axis) -> float:
    """Return the angle [rad] between the vertical and an axis of the base, without wbc."""
    up = Rotation.from_quat(q[3:7]).apply(axis)
    return 2.0 * np.arcsin(0.5 * np.linalg.norm(up - [0.0, 0.0, 1.0]))  # half-angle: exact near 0


@pytest.mark.parametrize("axis", [(0.0, 0.0, 2.0), (0.3, -0.2, 0.9)])
def test_the_clearance_is_what_is_left_of_the_angle_and_its_jacobian_the_derivative(
    hoap2, axis
) -> None:
    limit = TiltLimit(hoap2, TRUNK, 1.0, axis=axis)
    unit, rng = np.array(axis) / np.linalg.norm(axis), np.random.default_rng(3)
    for _ in range(20):
        q = tilted(hoap2, rng.uniform(-1.2, 1.2, 3))
        found = limit.distances(hoap2.snapshot(q))
        assert found.clearance[0] == pytest.approx(1.0 - tilt_of(hoap2, q, unit) - SKIN, abs=1e-12)
        v, h = rng.normal(size=hoap2.nv), 1e-6
        ends = [tilt_of(hoap2, hoap2.integrate(q, side * v, h), unit) for side in (-1.0, 1.0)]
        # Central differences: h^2 of curvature and rounding over h.
        rate = -(ends[1] - ends[0]) / (2.0 * h)
        assert found.jacobian[0] @ v == pytest.approx(rate, abs=1e-7)


def test_linear_rows_are_off_by_no_more_than_the_bound(hoap2) -> None:
    limit, rng = TiltLimit(hoap2, TRUNK, 1.2), np.random.default_rng(5)
    for size in np.logspace(-4, 0, 60):
        q = tilted(hoap2, np.append(rng.uniform(-0.8, 0.8, 2), 0.0))
        here, step = limit.distances(hoap2.snapshot(q)), size * rng.normal(size=hoap2.nv)
        there = limit.distances(hoap2.snapshot(hoap2.integrate(q, step, 1.0)))
        predicted = here.clearance + here.jacobian @ step
        assert there.clearance >= predicted - limit.curvature_bound(here, step) - 1e-12


def test_nearly_upright_any_turn_may_be_a_tilt(hoap2) -> None:
    """Across the tilt, where the linear prediction is none: what comes is nearly the turn."""
    limit = TiltLimit(hoap2, TRUNK, 1.2)
    for tilt, turn in itertools.product(np.logspace(-7, -3, 9), np.logspace(-7, -1, 13)):
        q = tilted(hoap2, (tilt, 0.0, 0.0))
        here, step = limit.distances(hoap2.snapshot(q)), np.zeros(hoap2.nv)
        step[4] = turn
        there = limit.distances(hoap2.snapshot(hoap2.integrate(q, step, 1.0)))
        lost = float((here.clearance + here.jacobian @ step - there.clearance)[0])
        bound = float(limit.curvature_bound(here, step)[0])
        assert lost <= bound + 1e-12 and bound <= turn
        # sqrt(tilt^2 + phi^2) - tilt is lost; min(phi, phi^2 / (2 tilt)) is the golden ratio
        # times that at most, at phi = 2 tilt.
        assert bound <= 1.619 * lost + 1e-12


def test_a_trunk_that_is_upright_may_tilt_any_way(hoap2) -> None:
    start = hoap2.snapshot(hoap2.posture("standing"))
    limit = TiltLimit.upright(start, TRUNK, 0.5)
    rows = limit.rows(start, 0.005)
    assert rows.labels == ("base tilt",)
    np.testing.assert_array_equal(rows.matrix, 0.0)
    assert rows.lower[0] < -1.0


def test_upright_is_what_points_up_at_the_start(hoap2) -> None:
    start = hoap2.snapshot(tilted(hoap2, (0.2, -0.4, 0.1)))
    assert TiltLimit.upright(start, TRUNK, 0.5).distances(start).clearance[0] == pytest.approx(
        0.5 - SKIN, abs=1e-7
    )


def test_a_trunk_pulled_past_its_limit_stops_there_and_brakes_before(hoap2) -> None:
    start, dt, braking = hoap2.snapshot(hoap2.posture("standing")), 0.005, 2.0
    limit = TiltLimit.upright(start, TRUNK, 0.25, braking=BrakingParameters(braking))
    pulled = OrientationTask(hoap2, TRUNK, Rotation.from_rotvec([0, 0.6, 0]).as_matrix(), gain=0.2)
    controller = KinematicController(
        hoap2,
        [pulled, PostureTask(hoap2, start.q, weight=0.01)],
        contacts=support(start, "double"),
        constraints=[limit],
        dt=dt,
    )
    ticks = commanded(controller, start.q, 200)
    angles = [tilt_of(hoap2, q, (0.0, 0.0, 1.0)) for _, q in ticks]
    rates, left = np.diff(angles) / dt, 0.25 - np.array(angles[:-1])
    assert max(angles) <= 0.25
    assert angles[-1] == pytest.approx(0.25, abs=2e-3)
    assert (rates <= np.sqrt(2.0 * braking * left) + 1e-6).all()
    assert rates.max() > 0.5  # it came fast enough to have to brake


def test_a_search_knows_the_cosine_of_the_tilt(hoap2) -> None:
    limit = TiltLimit(hoap2, TRUNK, 0.7, axis=(0.1, 0.2, 1.0))
    symbol = ca.SX.sym("q", hoap2.nq)
    rows = limit.symbolic_rows(SymbolicPosture.at(hoap2, symbol))
    q = tilted(hoap2, (0.3, 0.1, -0.8))
    value = float(ca.Function("tilt", [symbol], [rows.value])(q))
    assert value == pytest.approx(np.cos(tilt_of(hoap2, q, limit.axis.copy())), abs=1e-12)
    assert rows.lower == pytest.approx(np.cos(0.7 - SKIN))
    # And of a box the axes with one bound or two.
    box = PositionBox(hoap2, TRUNK, (-np.inf, -0.3, -np.inf), (np.inf, np.inf, 0.5))
    rows = box.symbolic_rows(SymbolicPosture.at(hoap2, symbol))
    value = np.asarray(ca.Function("box", [symbol], [rows.value])(q)).ravel()
    np.testing.assert_allclose(value, hoap2.snapshot(q).position(TRUNK)[1:], atol=1e-12)
    np.testing.assert_allclose(rows.lower, (-0.3 + SKIN, -np.inf))
    np.testing.assert_allclose(rows.upper, (np.inf, 0.5 - SKIN))


def test_an_assigned_angle_is_checked_and_counts(hoap2) -> None:
    limit = TiltLimit(hoap2, TRUNK, 1.0)
    for bad in (0.0, -1.0, 4.0, np.nan, "30 degrees"):
        with pytest.raises(InvalidInputError, match="tilt of base, angle: "):
            limit.angle = bad
    limit.angle = 0.5
    here = hoap2.snapshot(tilted(hoap2, (0.2, 0.0, 0.0)))
    assert limit.distances(here).clearance[0] == pytest.approx(0.3 - SKIN)
    with pytest.raises(InvalidInputError, match="axis cannot be assigned"):
        limit.axis = (1.0, 0.0, 0.0)
