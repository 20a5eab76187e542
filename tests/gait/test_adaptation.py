"""The DCM against its equation; the next footstep against SLSQP, and the pendulum."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from wbc.gait import adaptation
from wbc.gait.adaptation import StepBounds, StepPlan, held_back_by
from wbc.gait.dcm import StepTimes, VrpSegment, dcm_offsets, shift_gain
from wbc.native import lib

OMEGA, TIMES = 3.9, StepTimes(0.4, 0.05)
STEP = np.array((0.3, -0.2))
BOUNDS = StepBounds(
    np.array((-0.5, -0.5)),
    np.array((0.5, -0.1)),
    0.1,
    0.5,
    np.array((0.05, 0.02)),
    foot=STEP,
    rate=np.zeros(2),
    acceleration=1e3,
    about=0.2,
)


def nominal(left: float) -> StepPlan:
    """Return a plan that a steady walk of steps (0.3, +-0.2) has ``left`` before a landing."""
    steps = [STEP * (1.0, (-1.0) ** k) for k in range(12)]
    return StepPlan(STEP, left, dcm_offsets(steps[1:], TIMES, OMEGA)[0], np.zeros(2))


def adapt_step(
    dcm: np.ndarray, nominal: StepPlan, bounds: StepBounds, *pendulum: float
) -> StepPlan:
    """Return the plan, points as arrays; they are given as such."""

    def plain(*parts: object) -> list[object]:
        return [tuple(part) if isinstance(part, np.ndarray) else part for part in parts]

    given = StepPlan(*plain(*nominal)), StepBounds(*plain(*bounds))
    plan = adaptation.adapt_step(tuple(dcm), *given, *pendulum)
    points = {name: np.array(getattr(plan, name)) for name in ("place", "offset", "vrp")}
    return plan._replace(**points)


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


def test_the_sole_does_less_the_less_time_is_left() -> None:
    """The pendulum, with the VRP where it is planned, is where the next step begins: exactly."""
    dcm = steady_dcm(0.25) + (0.06, -0.02)
    plan = adapt_step(dcm, nominal(0.25), BOUNDS, OMEGA, TIMES.double)
    assert plan.vrp[0] == pytest.approx(BOUNDS.sole[0])  # all that the sole can do
    assert plan.left < 0.24  # though a linearisation at 0.25 s would have it do more
    ahead = plan.vrp + math.exp(OMEGA * plan.left) * (dcm - plan.vrp)
    shift = VrpSegment(np.zeros(2), plan.place, TIMES.double)
    back = shift.dcm_before(plan.place + plan.offset, TIMES.double, OMEGA)
    np.testing.assert_allclose(ahead, back, atol=1e-9)


def least_jerk(way: float, rate: float, T: float) -> np.ndarray:
    """Return the accelerations on the quintic from a rate to rest, by its six conditions."""
    powers = np.arange(6)
    rows = np.zeros((6, 6))
    for k, t in enumerate((0.0, T)):
        rows[k] = t**powers
        rows[2 + k, 1:] = powers[1:] * t ** powers[:-1]
        rows[4 + k, 2:] = powers[2:] * powers[1:-1] * t ** powers[:-2]
    curve = np.polynomial.Polynomial(np.linalg.solve(rows, (0.0, way, rate, 0.0, 0.0, 0.0)))
    return np.asarray(curve.deriv(2)(np.linspace(0.0, T, 2001)))


@pytest.mark.parametrize(("time", "rate"), [(0.1, 0.0), (0.3, 0.0), (0.2, 1.7)])
def test_the_reach_is_where_least_jerk_takes_the_acceleration_given(time, rate) -> None:
    a = 40.0
    lower, upper = (lib.wbc_rest_range * a * time**2 * sign for sign in (-1.0, 1.0))
    assert np.abs(least_jerk(upper, 0.0, time)).max() == pytest.approx(a, rel=1e-5)
    middle = 0.5 * time * rate
    stopping = np.abs(least_jerk(middle, rate, time)).max()
    assert stopping == pytest.approx(1.5 * rate / time, rel=1e-5, abs=1e-9)
    box = (middle + lower, -1.0), (middle + lower, 1.0)
    least = lib.wbc_rest_time(a, (0.0, 0.0), (rate, 0.0), *box)
    assert rate > 0.0 or least == pytest.approx(time)


def ways(bounds: StepBounds, time: float) -> np.ndarray:
    """Return how far x, y, -x, -y can be where the foot rests within a time."""
    middle = bounds.foot + 0.5 * time * bounds.rate
    spread = lib.wbc_rest_range * bounds.acceleration * time**2
    return np.concatenate((middle, -middle)) + spread


@pytest.mark.parametrize("seed", range(6))
def test_a_foot_is_between_its_bounds_from_the_least_time_on(seed: int) -> None:
    rng = np.random.default_rng(seed)
    foot = BOUNDS._replace(
        foot=rng.normal(scale=0.3, size=2), rate=rng.normal(size=2), acceleration=30.0
    )
    start = tuple(foot.foot), tuple(foot.rate)
    least = lib.wbc_rest_time(30.0, *start, tuple(foot.lower), tuple(foot.upper))
    stop = 1.5 * np.abs(foot.rate).max() / 30.0

    def can(time: float) -> bool:
        most = ways(foot, time)
        return bool((most[:2] >= BOUNDS.lower).all() and (-most[2:] <= BOUNDS.upper).all())

    assert all(can(time) for time in np.linspace(least + 1e-6, least + 1.0, 50))
    assert least == pytest.approx(stop) or not can(least - 1e-6)
    plan = adapt_step(steady_dcm(0.01), nominal(0.01), foot, OMEGA, TIMES.double)
    assert plan.left >= least


def test_a_foot_that_is_far_off_takes_its_time() -> None:
    """Though it should land at once, it may not: a swing that fails is worse than a late one."""
    bounds = BOUNDS._replace(foot=STEP - (0.6, 0.0), acceleration=40.0, about=0.3)
    dcm = steady_dcm(0.3) + (0.05, -0.1)
    hasty = adapt_step(dcm, nominal(0.3), BOUNDS, OMEGA, TIMES.double)
    plan = adapt_step(dcm, nominal(0.3), bounds, OMEGA, TIMES.double)
    assert plan.left > hasty.left + 0.02
    slope = (ways(bounds, 0.4) - ways(bounds, 0.2)) / 0.2  # at 0.3 s
    later = math.expm1(OMEGA * (plan.left - 0.3)) / OMEGA
    planned = np.concatenate((plan.place, -plan.place))
    assert (planned <= ways(bounds, 0.3) + slope * later + 1e-7).all()


def test_what_has_no_solution_is_finite_within_its_bounds_and_said() -> None:
    """Where a foot is in reach of one place only, at one time, no solver can do more."""
    rng = np.random.default_rng(0)
    unsolved = 0
    for _ in range(200):
        left = float(rng.uniform(0.1, 0.4))
        foot, rate, most = rng.normal(size=2), 3.0 * rng.normal(size=2), rng.uniform(5.0, 60.0)
        bounds = BOUNDS._replace(foot=foot, rate=rate, acceleration=most, about=left)
        box = tuple(bounds.lower), tuple(bounds.upper)
        least = max(0.1, lib.wbc_rest_time(most, tuple(foot), tuple(rate), *box))
        plan = adapt_step(3.0 * rng.normal(size=2), nominal(left), bounds, OMEGA, TIMES.double)
        unsolved += not plan.adapted
        assert np.isfinite(np.concatenate((plan.place, plan.offset, plan.vrp))).all()
        assert (plan.place >= bounds.lower - 1e-6).all()
        assert (plan.place <= bounds.upper + 1e-6).all()
        assert least <= plan.left <= max(least, bounds.max_time)
    assert unsolved < 20


@pytest.mark.parametrize(
    ("push", "names"),
    [
        ((0.0, 0.0), ()),
        ((0.3, 0.0), ("reach of the legs ahead",)),
        ((-0.6, 0.0), ("reach of the legs behind",)),
        ((0.0, -0.3), ("reach of the legs aside",)),
        ((0.0, 0.3), ("the other foot",)),
    ],
)
def test_what_holds_a_step_back_is_named(push: tuple[float, float], names: tuple[str, ...]) -> None:
    """What is named is where the plan is: at that bound of its place, on either side."""
    dcm = steady_dcm(0.3) + push
    plan = adapt_step(dcm, nominal(0.3), BOUNDS, OMEGA, TIMES.double)
    found = held_back_by(plan.multipliers, -1.0)
    assert set(names) <= set(found) and bool(names) == bool(found)
    at = {
        "reach of the legs ahead": plan.place[0] - BOUNDS.upper[0],
        "reach of the legs behind": plan.place[0] - BOUNDS.lower[0],
        "reach of the legs aside": plan.place[1] - BOUNDS.lower[1],
        "the other foot": plan.place[1] - BOUNDS.upper[1],
        "least time in the air": plan.left - BOUNDS.min_time,
    }
    for name in set(found) & at.keys():
        assert abs(at[name]) < 1e-6
    mirror = np.array((1.0, -1.0))
    turned = BOUNDS._replace(
        lower=np.array((-0.5, 0.1)), upper=np.array((0.5, 0.5)), foot=STEP * mirror
    )
    wanted = nominal(0.3)
    wanted = wanted._replace(place=wanted.place * mirror, offset=wanted.offset * mirror)
    other = adapt_step(dcm * mirror, wanted, turned, OMEGA, TIMES.double)
    assert held_back_by(other.multipliers, 1.0) == found
    assert held_back_by(None, 1.0) == ()


def integrated(dcm: np.ndarray, segments: list[VrpSegment]) -> np.ndarray:
    """Return the DCM after segments, by Runge-Kutta of xi' = omega (xi - vrp)."""
    for segment in segments:

        def rate(t: float, xi: np.ndarray, segment: VrpSegment = segment) -> np.ndarray:
            done = t / segment.duration
            return OMEGA * (xi - (1.0 - done) * segment.start - done * segment.end)

        found = solve_ivp(rate, (0.0, segment.duration), dcm, rtol=1e-11, atol=1e-13)
        dcm = found.y[:, -1]
    return dcm


def test_backwards_is_what_forwards_undoes(rng: np.random.Generator) -> None:
    for _ in range(20):
        segment = VrpSegment(*rng.normal(size=(2, 2)), duration=float(rng.uniform(0.05, 1.0)))
        last = rng.normal(size=2)
        left = float(rng.uniform(0.0, segment.duration))
        here = segment.dcm_before(last, left, OMEGA)
        rest = VrpSegment(segment.at(segment.duration - left), segment.end, left)
        np.testing.assert_allclose(integrated(here, [rest]), last, atol=1e-9)


def test_offsets_lead_from_foot_to_foot(rng: np.random.Generator) -> None:
    times = StepTimes(0.4, 0.07)
    steps = rng.normal(size=(5, 2))
    offsets = dcm_offsets(steps, times, OMEGA, last=rng.normal(size=2))
    foot = rng.normal(size=2)
    dcm = foot + offsets[0]
    for k, step in enumerate(steps):
        on_one = VrpSegment(foot, foot, times.single)
        shifting = VrpSegment(foot, foot + step, times.double)
        foot = foot + step
        dcm = integrated(dcm, [on_one, shifting])
        np.testing.assert_allclose(dcm, foot + offsets[k + 1], atol=1e-8)


def test_without_a_last_offset_the_walk_ends_over_the_last_foot() -> None:
    offsets = dcm_offsets([np.ones(2)], StepTimes(0.4, 0.1), OMEGA)
    assert offsets[-1] == 0.0


@pytest.mark.parametrize("double", [0.0, 1e-12, 1e-6])
def test_a_shift_in_no_time_pushes_nothing_back(double: float) -> None:
    assert shift_gain(OMEGA, double) == pytest.approx(1.0, abs=3e-6)
