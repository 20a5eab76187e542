"""Bounds on pushes against motions integrated step by step, and against a linear program."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import linprog

from wbc.errors import InvalidInputError
from wbc.polygon import half_planes, polygon_margin
from wbc.rmp.balance.push_limits import Wheel, compass, push_limits
from wbc.validate import Array

M, Z, G = 35.0, 0.7, 9.81
OMEGA = np.sqrt(G / Z)
SOLE = np.array(((-0.08, -0.1), (0.12, -0.1), (0.12, 0.1), (-0.08, 0.1)))
INERTIA, TORQUE, ANGLE = 2.1, 50.0, 0.6


def falls(impulse: float, edge: float, times: tuple[float, float, float]) -> bool:
    """Integrate LIP and flywheel, CoP at the edge; torque +, 0, - until the given times."""
    state = np.array((0.0, impulse / M))
    begin = 0.0
    for end, torque in zip(times, (TORQUE, 0.0, -TORQUE), strict=True):
        if end > begin:
            span = (begin, end)
            push = edge + torque / (M * G)
            step = solve_ivp(lift(push), span, state, rtol=1e-10, atol=1e-12)
            state, begin = step.y[:, -1], end
    # The wheel has stopped: the CoM diverges if its capture point is beyond the CoP.
    return bool(state[0] + state[1] / OMEGA > edge)


def lift(cmp: float):  # type: ignore[no-untyped-def]
    return lambda t, x: (x[1], OMEGA**2 * (x[0] - cmp))


@pytest.mark.parametrize("rate", [np.inf, 2.0])
def test_bound_is_where_a_bang_bang_wheel_just_fails_to_catch_the_fall(rate: float) -> None:
    wheel = Wheel(INERTIA, TORQUE, ANGLE, rate)
    limits = push_limits([(1.0, 0.0)], SOLE, wheel, mass=M, height=Z)
    # Speed up until the rate's limit or half the angle, coast, brake to rest at the angle's limit.
    up = min(np.sqrt(ANGLE * INERTIA / TORQUE), rate * INERTIA / TORQUE)
    coast = ANGLE / (TORQUE * up / INERTIA) - up
    low, high = 0.0, 10.0 * float(limits.wheel[0])
    while high - low > 1e-6:
        middle = (low + high) / 2
        if falls(middle, 0.12, (up, up + coast, 2 * up + coast)):
            high = middle
        else:
            low = middle
    # Integrated to 1e-10; the exponential fall turns that into 1e-7 of the impulse.
    assert low == pytest.approx(float(limits.wheel[0]), rel=1e-6)
    assert float(limits.ankle[0]) == pytest.approx(M * OMEGA * 0.12, rel=1e-12)


def best_by_linear_program(direction: Array, wheel: Wheel) -> float:
    """Largest impulse over all CoP and wheel motions on a grid of time; no bang-bang assumed."""
    steps, dt = 240, 0.01
    t = dt * np.arange(steps)
    # Exact weights of omega e^(-omega s) over each step, the last one's tail without end.
    weight = np.exp(-OMEGA * t) - np.exp(-OMEGA * (t + dt))
    weight[-1] = np.exp(-OMEGA * t[-1])
    # Rate and angle at the end of each step, from torques held over the steps before.
    rate = dt * np.tril(np.ones((steps, steps)))
    angle = dt**2 * np.tril(np.arange(steps)[:, None] - np.arange(steps)[None] + 0.5)
    normals, offsets = half_planes(SOLE)
    # Unknowns: one mean CoP (2), as the polygon is convex; torques about y and x; the impulse.
    cost = np.zeros(2 + 2 * steps + 1)
    cost[-1] = -1.0
    inequalities, limits = (
        [np.hstack((normals, np.zeros((len(normals), 2 * steps + 1))))],
        [offsets],
    )
    moments = np.asarray(wheel.inertia)[::-1]
    for k, moment in enumerate(moments):
        columns = slice(2 + k * steps, 2 + (k + 1) * steps)
        for matrix, limit in ((angle, wheel.angle), (rate, wheel.rate)):
            for sign in (1.0, -1.0):
                if np.isfinite(limit):
                    rows = np.zeros((steps, cost.size))
                    rows[:, columns] = sign * matrix / moment
                    inequalities.append(rows)
                    limits.append(np.full(steps, limit))
    equal = np.zeros((4, cost.size))
    for k, moment in enumerate(moments):
        equal[k, k] = 1.0
        equal[k, 2 + k * steps : 2 + (k + 1) * steps] = weight / (M * G)
        equal[k, -1] = -direction[k] / (M * OMEGA)
        # Stopped in the end.
        equal[2 + k, 2 + k * steps : 2 + (k + 1) * steps] = rate[-1] / moment
    found = linprog(
        cost,
        A_ub=np.vstack(inequalities),
        b_ub=np.concatenate(limits),
        A_eq=equal,
        b_eq=np.zeros(4),
        bounds=[(None, None)] * 2 + [(-wheel.torque, wheel.torque)] * (2 * steps) + [(0, None)],
    )
    assert found.status == 0
    return float(-found.fun)


@pytest.mark.parametrize("rate", [np.inf, 2.0])
def test_no_motion_of_cop_and_wheel_does_better_than_the_bound(rate: float) -> None:
    wheel = Wheel((2.1, 1.2), TORQUE, ANGLE, rate)
    for angle in np.radians((0.0, 40.0, 130.0, 270.0)):
        e = np.array((np.cos(angle), np.sin(angle)))
        limits = push_limits([e], SOLE, wheel, mass=M, height=Z)
        # Switching between steps of 10 ms costs the grid up to 0.5 %.
        assert best_by_linear_program(e, wheel) == pytest.approx(float(limits.wheel[0]), rel=5e-3)


def test_along_the_axes_one_motor_works_and_at_corners_both() -> None:
    wheel = Wheel(INERTIA, TORQUE, ANGLE)
    limits = push_limits(compass(8), SOLE, wheel, mass=M, height=Z)
    gained = (limits.wheel - limits.ankle) / (M * OMEGA)
    np.testing.assert_allclose(gained[::2], wheel.reach(M * G, OMEGA)[0], rtol=1e-12)
    square = 0.1 * np.array(((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)))
    limits = push_limits(compass(8), square, wheel, mass=M, height=Z)
    np.testing.assert_allclose(limits.wheel[1::2], np.sqrt(2.0) * limits.wheel[::2], rtol=1e-12)
    limits = push_limits(compass(8), SOLE, wheel, mass=M, height=Z)
    # The ankle's bound puts the capture point on the edge.
    edge = limits.ankle[:, None] * limits.directions / (M * limits.omega)
    np.testing.assert_allclose(polygon_margin(SOLE, edge), 0.0, atol=1e-12)


def test_directions_may_have_any_length_and_the_com_any_place() -> None:
    wheel = Wheel(INERTIA, TORQUE, ANGLE)
    here = push_limits([(3.0, 0.0)], SOLE, wheel, mass=M, height=Z, com=(0.02, 0.0))
    shifted = push_limits([(1.0, 0.0)], SOLE - (0.02, 0.0), wheel, mass=M, height=Z)
    for name in ("ankle", "wheel"):
        np.testing.assert_allclose(getattr(here, name), getattr(shifted, name), rtol=1e-12)


def test_a_wheel_without_limits_of_motion_holds_as_far_as_its_torque() -> None:
    free = Wheel(INERTIA, TORQUE).reach(M * G, OMEGA)
    assert free == pytest.approx(np.full(2, TORQUE / (M * G)), rel=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"com": (0.2, 0.0)}, "falls by itself"),
        ({"mass": 0.0}, "mass"),
        ({"height": -1.0}, "height"),
        ({"polygon": [(0.0, 0.0), (1.0, 0.0)]}, "three corners"),
        ({"polygon": [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0)]}, "on one line"),
        ({"directions": [(0.0, 0.0)]}, "no length"),
        ({"directions": [(np.nan, 0.0)]}, "NaN"),
    ],
)
def test_unusable_numbers_are_refused(change: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {"directions": [(1.0, 0.0)], "polygon": SOLE, "mass": M}
    arguments |= {"height": Z, "wheel": Wheel(INERTIA, TORQUE, ANGLE)} | change
    with pytest.raises(InvalidInputError, match=message):
        push_limits(**arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "wheel", [(0.0, 1.0), (1.0, np.inf), (1.0, 1.0, -1.0), (1.0, 1.0, 1.0, 0.0)]
)
def test_unusable_wheels_are_refused(wheel: tuple[float, ...]) -> None:
    with pytest.raises(InvalidInputError):
        Wheel(*wheel)
