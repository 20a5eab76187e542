"""Plans against oracles that share no code with the planner: closed forms, pendulums."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from benchmarks.plan_examples import EXAMPLES, HEIGHT, LIMITS, RADII
from wbc.errors import InvalidInputError
from wbc.rmp.plan import (
    Limits,
    Phase,
    Plan,
    PlanProblem,
    State,
    Weights,
    at_rest,
    check,
    generalised,
    rectangle,
    solve,
)
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp

FLIGHTS = [name for name in EXAMPLES if name.startswith("hop")]
STILL = (0.0, 0.0, 0.0)
SQUARE = rectangle(0.0, 0.0, 0.22, 0.3)


@cache
def planned(name: str) -> Plan:
    return solve(EXAMPLES[name]())


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_are_in_order_between_knots(name: str) -> None:
    # Finer than any point the programme looks at: four times, not at halves alone.
    seen = check(planned(name), factor=4)
    assert seen.defect < 1e-6
    assert seen.excess < 1e-6
    assert seen.drift < 1e-8
    assert seen.ok, seen.report()


@pytest.mark.parametrize("name", FLIGHTS)
def test_flight_is_a_parabola_with_constant_momentum_and_energy(name: str) -> None:
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


@pytest.mark.parametrize("name", ["push", "push and step", "hop", "walk"])
def test_solid_pendulum_confirms_the_forces(name: str) -> None:
    plan = planned(name)
    pendulum = plan.problem.pendulum
    m = plan.at(np.linspace(0.0, plan.starts[1] - 1e-6, 25))
    moved = generalised(plan, m)
    for q, v, a, f, i in zip(moved.q, moved.v, moved.a, moved.forces, range(25), strict=True):
        # Forces reach 500 N: a relative 1e-11.
        np.testing.assert_allclose(pendulum.inverse_dynamics(q, v, a), f, atol=1e-8)
        np.testing.assert_allclose(pendulum.ground_reaction(q, v, a), m.force[i], atol=1e-8)
        c, rate = pendulum.com(q, v)
        np.testing.assert_allclose((c, rate), (m.com[i], m.com_velocity[i]), atol=1e-12)
        np.testing.assert_allclose(pendulum.momenta(q, v)[0], m.momentum[i], atol=1e-11)
        np.testing.assert_allclose(pendulum.momentum_rate(q, f), m.momentum_rate[i], atol=1e-10)


def test_a_whole_plan_follows_from_its_forces() -> None:
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


def test_turns_in_flight_are_as_wanted() -> None:
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
        # With the masses drawn in, for the momentum is the same throughout.
        assert m.inertia[:, axis].min() < 0.6 * m.inertia[0, axis]


def test_linear_inverted_pendulum_in_closed_form() -> None:
    """At constant height, without spin, c'' = omega^2 (c - p): for CoPs linear in time."""
    flat = Limits(leg_length=(0.5, 1.0), radius=(0.05, 0.4))
    start = replace(at_rest((0.0, 0.0, HEIGHT), RADII), com_velocity=(0.2, 0.1, 0.0))
    plan = solve(
        PlanProblem(
            SolidRmp(30.0),
            (Phase("stand", 1.0, SQUARE, 20),),
            start=start,
            goal=State(com=(0.0, 0.0, None), com_velocity=STILL),
            nominal=State(com=(None, None, HEIGHT)),
            limits=flat,
            weights=Weights(torque=1e4, momentum=1e4, com=1e5, acceleration=0.01),
        )
    )
    omega = np.sqrt(9.81 / HEIGHT)
    k = plan.knots
    c, v = np.array(k.com[0, :2]), np.array(k.com_velocity[0, :2])
    h = 0.05
    for p0, p1 in zip(k.cop[:-1], k.cop[1:], strict=True):
        slope = (p1 - p0) / h
        cosh, sinh = np.cosh(omega * h), np.sinh(omega * h)
        c, v = (
            p1 + cosh * (c - p0) + sinh * (v - slope) / omega,
            slope + omega * sinh * (c - p0) + cosh * (v - slope),
        )
    # The plan's force is linear in each interval, the pendulum's hyperbolic: 1e-4 of 0.3 m seen.
    assert np.abs(c - k.com[-1, :2]).max() < 5e-4
    assert np.abs(v - k.com_velocity[-1, :2]).max() < 2e-3


def _flat(pendulum: PlanarRmp | SolidRmp) -> PlanProblem:
    radii = (0.2, 0.2, 0.2)
    start = replace(at_rest((0.0, 0.0, HEIGHT), radii), com_velocity=(0.3, 0.0, 0.0))
    return PlanProblem(
        pendulum,
        (Phase("stand", 1.5, SQUARE, 20),),
        start=start,
        goal=at_rest((0.0, 0.0, HEIGHT), radii),
        nominal=State(com=(None, None, HEIGHT), rotation=STILL, radii=radii),
        limits=LIMITS,
        # r_2 has no part in the plane: without cost, r_1 and r_3 are alike in the solid too.
        weights=Weights(),
    )


def test_planar_plan_is_the_solid_one_in_its_plane() -> None:
    solid, planar = solve(_flat(SolidRmp(30.0))), solve(_flat(PlanarRmp(30.0)))
    assert planar.stats.variables < solid.stats.variables
    for name, within in (("com", 1e-9), ("momentum", 1e-7), ("force", 1e-6), ("radii", 1e-6)):
        one, other = getattr(solid.knots, name), getattr(planar.knots, name)
        np.testing.assert_allclose(one, other, atol=within)  # IPOPT's tolerance
    pendulum, moved = planar.problem.pendulum, generalised(planar, planar.knots)
    for q, v, a, f in zip(moved.q, moved.v, moved.a, moved.forces, strict=True):
        np.testing.assert_allclose(pendulum.inverse_dynamics(q, v, a), f, atol=1e-9)
        assert f[0] == 0.0
    assert check(planar, 4).ok


def test_walk_repeats_itself() -> None:
    k = planned("walk").knots
    np.testing.assert_allclose(k.com[-1] - k.com[0], (1.0, 0.0, 0.0), atol=1e-8)
    np.testing.assert_allclose(k.com_velocity[-1], k.com_velocity[0], atol=1e-7)
    np.testing.assert_allclose(k.force[-1], k.force[0], atol=1e-5)
    assert np.abs(k.momentum).max() <= 3.0 + 1e-9


def test_duration_is_chosen_within_its_bounds() -> None:
    swift = replace(EXAMPLES["hop"](), weights=Weights(time=100.0))
    plan, calm = solve(swift), planned("hop")
    assert plan.duration < calm.duration - 0.1
    for T, phase in zip(plan.durations, swift.schedule, strict=True):
        assert phase.durations[0] - 1e-7 <= T <= phase.durations[1] + 1e-7


def test_at_meets_the_knots_and_refuses_what_lies_outside() -> None:
    plan = planned("hop")
    k = plan.knots
    inside = np.flatnonzero(np.append(np.diff(k.phase) == 0, True))  # the later of two at a time
    inside = inside[k.time[inside] < plan.duration]
    m = plan.at(k.time[inside])
    np.testing.assert_allclose(m.com, k.com[inside], atol=1e-8)
    np.testing.assert_allclose(m.force, k.force[inside], atol=1e-6)
    with pytest.raises(InvalidInputError, match="within the plan"):
        plan.at(plan.duration + 0.1)
    with pytest.raises(InvalidInputError, match="in flight"):
        generalised(plan, plan.at(plan.starts[1] + 0.01))
