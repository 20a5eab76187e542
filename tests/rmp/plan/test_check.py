"""Plans looked at anew: by the check, by closed forms, by integration of their forces."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from benchmarks.planner import EXAMPLES, example
from wbc.rmp.plan import Check, Plan, check, solve

FLIGHTS = [name for name in EXAMPLES if name.startswith("hop")]
Planned = Callable[[str], Plan]


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_are_in_order_between_knots(name: str, planned: Planned) -> None:
    # Finer than any point the programme looks at: four times, not at halves alone.
    seen = check(planned(name), factor=4)
    assert seen.defect < 1e-6
    assert seen.excess < 1e-6
    assert seen.drift < 1e-8
    assert seen.ok, seen.report()


@pytest.mark.slow
@pytest.mark.parametrize("name", FLIGHTS)
def test_flight_is_a_parabola_with_constant_momentum_and_energy(name: str, planned) -> None:
    plan = planned(name)
    start, end = plan.starts[1:3]
    m = plan.at(np.linspace(start, end - 1e-9, 50))
    t = (m.time - start)[:, None]
    g = np.array((0.0, 0.0, -9.81))
    parabola = m.com[0] + m.com_velocity[0] * t + g * t**2 / 2
    # Rounding, and rows met to 1e-9 in scaled units, over ten intervals.
    np.testing.assert_allclose(m.com, parabola, atol=1e-7)
    energy = 30.0 * ((m.com_velocity**2).sum(axis=1) / 2 + 9.81 * m.com[:, 2])
    np.testing.assert_allclose(energy, energy[0], atol=1e-5)
    np.testing.assert_allclose(m.momentum, m.momentum[:1].repeat(50, axis=0), atol=1e-8)
    assert not m.force.any() and np.isnan(m.cop).all()


@pytest.mark.slow
def test_a_whole_plan_follows_from_its_forces(planned: Planned) -> None:
    """From the first knot to the last of a somersault; integrated anew where forces bend."""
    plan = planned("hop with somersault")
    k0 = plan.knots
    x = np.concatenate((k0.com[0], k0.com_velocity[0], k0.momentum[0], k0.orientation[0]))
    for first, last in zip(k0.time[:-1], k0.time[1:], strict=True):
        if first == last:
            continue  # a phase ends and the next one begins

        def rate(t: float, x: np.ndarray, last: float = last) -> np.ndarray:
            m = plan.at(min(t, last - 1e-12))
            lever = np.append(np.nan_to_num(m.cop[0]), 0.0) - x[:3]
            k_rate = np.cross(lever, m.force[0]) + (0.0, 0.0, m.moment[0])
            R = Rotation.from_quat(x[9:])
            inertia = 10.0 * ((m.radii[0] ** 2).sum() - m.radii[0] ** 2)
            w = R.inv().apply(x[6:9]) / inertia
            vector = (x[12] * w + np.cross(x[9:12], w)) / 2
            c_rate = m.force[0] / 30.0 - (0.0, 0.0, 9.81)
            return np.concatenate((x[3:6], c_rate, k_rate, vector, [-x[9:12] @ w / 2]))

        x = solve_ivp(rate, (first, last), x, rtol=1e-8, atol=1e-10).y[:, -1]
    assert np.abs(x[:3] - k0.com[-1]).max() < 1e-9
    assert np.abs(x[6:9] - k0.momentum[-1]).max() < 1e-9
    away = Rotation.from_quat(x[9:]).inv() * Rotation.from_quat(k0.orientation[-1])
    assert away.magnitude() < 1e-6


@pytest.mark.slow
def test_turns_in_flight_are_as_wanted(planned: Planned) -> None:
    for name, turn, axis in (
        ("hop with half turn", np.pi, 2),
        ("hop with whole turn", 2 * np.pi, 2),
        ("hop with somersault", 2 * np.pi, 1),
    ):
        plan = planned(name)
        times = np.linspace(plan.starts[1], plan.starts[2] - 1e-9, 2001)
        m = plan.at(times)
        turned = np.trapezoid(m.angular_velocity[:, axis], times)
        assert abs(turned - turn) < 1e-4  # trapezia
        # With the masses drawn in, from where they are at rest.
        assert m.inertia[:, axis].min() < 0.6 * plan.knots.inertia[0, axis]


def test_check_sees_what_was_tampered_with(planned: Planned) -> None:
    plan = planned("lean")
    assert check(plan).ok
    places = plan.layout.phases[0]

    def tampered(where: object, value: float) -> Check:
        solution = plan.solution.copy()
        solution[where] = value
        return check(replace(plan, solution=solution))

    lost = tampered(places.named["force"][10, 2], 0.0)
    assert lost.lost_contact == ("lean",) and not lost.ok
    assert "hardly pushed" in lost.report()
    # The force was 294 N, for half of two intervals of 50 ms: M g h / 2 / M a time.
    assert lost.defects["com_velocity"] == pytest.approx(9.81 * 0.05 / 2, rel=0.02)
    away = tampered(places.named["cop"][10, 0], 2.0)
    assert away.violations[0].quantity == "cop" or away.violations[1].quantity == "cop"
    assert away.defects["momentum"] > 1.0
    turned = tampered(places.named["orientation"][10, 0], 0.1)
    # sigma of 0.1 is 4 atan(0.1) rad; the plan's own lean is small.
    assert turned.defects["orientation"] == pytest.approx(4 * np.arctan(0.1), rel=0.05)


def test_a_goal_whose_turn_is_free_about_every_axis_is_reached_with_any() -> None:
    lean = example("lean")
    plan = solve(replace(lean, goal=replace(lean.goal, rotation=(None, None, None))))
    assert check(plan).ok
