"""The planar pendulum against the paper's closed forms, corrected, and first principles."""

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.rmp.planar import PlanarRmp
from wbc.validate import Array

M, G = 21.5, 9.81
# Rounding of some hundred operations on numbers up to a thousand.
EXACT = {"rtol": 1e-11, "atol": 1e-9}


@pytest.fixture(scope="module")
def model() -> PlanarRmp:
    return PlanarRmp(M, G)


def state(seed: int, cop: bool = True) -> tuple[Array, Array, Array]:
    """Return random (q, v, a); without ``cop`` the CoP rests."""
    rng = np.random.default_rng(seed)
    q = np.array((rng.normal(), *rng.uniform((-3, 0.3, -3, 0.1), (3, 1.2, 3, 0.6))))
    v, a = 2.0 * rng.normal(size=5), 5.0 * rng.normal(size=5)
    if not cop:
        v[0] = a[0] = 0.0
    return q, v, a


def paper_forces(q: Array, v: Array, a: Array) -> Array:
    """Eqs. 22, 20, 23, 21 for a resting CoP, in the order (tau_theta, f_l, tau, f)."""
    _, th, rl, _, r = q
    _, dth, drl, dal, dr = v
    _, ddth, ddrl, ddal, ddr = a
    tau = M * r**2 * (ddth + ddal) + 2 * M * r * dr * (dth + dal)
    return np.array(
        (
            tau + M * rl**2 * ddth + 2 * M * rl * drl * dth + M * G * rl * np.cos(th),
            M * ddrl - M * rl * dth**2 + M * G * np.sin(th),
            tau,
            M * ddr - M * r * (dth + dal) ** 2,
        )
    )


def masses(q: Array) -> Array:
    """Return the (2, 2) places of the masses M/2, from geometry alone."""
    x, th, rl, al, r = q
    c = np.array((x + rl * np.cos(th), rl * np.sin(th)))
    arm = r * np.array((np.cos(th + al), np.sin(th + al)))
    return np.array((c + arm, c - arm))


def along(q: Array, v: Array, a: Array, t: complex) -> Array:
    return np.asarray(q + v * t + a * t**2 / 2)


def first_rate(function, q: Array, v: Array, a: Array) -> Array:  # type: ignore[no-untyped-def]
    """d/dt of an analytic function of q, by a complex step: exact to rounding."""
    return np.asarray(np.imag(function(along(q, v, a, 1e-30j))) / 1e-30)


@pytest.mark.parametrize("seed", range(20))
def test_closed_forms_20_to_23(model: PlanarRmp, seed: int) -> None:
    q, v, a = state(seed, cop=False)
    np.testing.assert_allclose(model.inverse_dynamics(q, v, a), paper_forces(q, v, a), **EXACT)
    np.testing.assert_allclose(model.forward_dynamics(q, v, paper_forces(q, v, a)), a, **EXACT)


@pytest.mark.parametrize("seed", range(20))
def test_energies_and_momenta_are_those_of_two_point_masses(model: PlanarRmp, seed: int) -> None:
    """With a moving CoP too; velocities of the masses by a complex step."""
    q, v, a = state(seed)

    rates, points = first_rate(masses, q, v, a), masses(q)
    c = points.mean(axis=0)
    T = M / 4 * np.sum(rates**2)
    V = M / 2 * G * points[:, 1].sum()
    np.testing.assert_allclose(model.energies(q, v), (T, V), **EXACT)

    def momentum(about: Array) -> float:
        arms = points - about
        return float(M / 2 * np.sum(arms[:, 0] * rates[:, 1] - arms[:, 1] * rates[:, 0]))

    expected = (momentum(c), momentum(np.array((q[0], 0.0))))
    np.testing.assert_allclose(model.momenta(q, v), expected, **EXACT)
    np.testing.assert_allclose(model.com(q, v)[0], c, **EXACT)
    np.testing.assert_allclose(model.com(q, v)[1], rates.mean(axis=0), **EXACT)


@pytest.mark.parametrize("seed", range(10))
def test_ground_reaction(model: PlanarRmp, seed: int) -> None:
    """M (c'' - g) by hand in polar coordinates; its horizontal part is the CoP's row of M a + b."""
    q, v, a = state(seed)
    _, th, rl, _, _ = q
    n, t = np.array((np.cos(th), np.sin(th))), np.array((-np.sin(th), np.cos(th)))
    radial, across = a[2] - rl * v[1] ** 2, rl * a[1] + 2 * v[2] * v[1]
    expected = M * (radial * n + across * t + (a[0], 0.0) + (0.0, G))
    np.testing.assert_allclose(model.ground_reaction(q, v, a), expected, **EXACT)
    row = model.mass_matrix(q)[0] @ a + model.bias(q, v)[0]
    np.testing.assert_allclose(row, expected[0], **EXACT)


@pytest.mark.parametrize("seed", range(10))
def test_newton_and_euler_with_a_moving_cop(model: PlanarRmp, seed: int) -> None:
    """k_G' = (p - c) x f_r + m, with the torque m of the foot = tau_theta: the CoP's own motion
    enters the accelerations only."""
    q, v, a = state(seed)
    f = model.inverse_dynamics(q, v, a)
    reaction = model.ground_reaction(q, v, a)
    lever = np.array((q[0], 0.0)) - model.com(q, v)[0]
    moment = lever[0] * reaction[1] - lever[1] * reaction[0] + f[0]
    np.testing.assert_allclose(f[2], moment, **EXACT)
    np.testing.assert_allclose(model.forward_dynamics(q, v, f, cop_acceleration=a[0]), a, **EXACT)


def test_mass_matrix_is_singular_for_the_cop_alone(model: PlanarRmp) -> None:
    """Four inertias for five velocities; the rest is positive definite."""
    q, v, _ = state(1)
    full = model.mass_matrix(q)
    np.testing.assert_array_equal(full, full.T)
    np.testing.assert_allclose(v @ full @ v / 2, model.energies(q, v)[0], **EXACT)
    assert np.linalg.matrix_rank(full, tol=1e-9) == 4
    assert np.linalg.eigvalsh(full[1:, 1:]).min() > 0.1


def test_without_radius_it_is_an_inverted_pendulum(model: PlanarRmp) -> None:
    """At any r the leg moves as a pendulum with the torque tau_theta - tau; at r = 0, tau = 0."""
    q, v, a = state(8, cop=False)
    f = np.array((1.5, 200.0, -0.7, 3.0))
    _, th, rl, _, _ = q
    ddth = ((f[0] - f[2]) / M - 2 * rl * v[2] * v[1] - G * rl * np.cos(th)) / rl**2
    ddrl = f[1] / M + rl * v[1] ** 2 - G * np.sin(th)
    for r in (0.4, 1e-3, 1e-6):
        q[4] = r
        # Relative: the wheel's acceleration grows as 1 / r^2, and rounding with it.
        got = model.forward_dynamics(q, v, f)[1:3]
        np.testing.assert_allclose(got, (ddth, ddrl), rtol=1e-9)
    q[4] = v[4] = a[4] = 0.0
    forces = model.inverse_dynamics(q, v, a)
    pendulum = M * rl**2 * a[1] + 2 * M * rl * v[2] * v[1] + M * G * rl * np.cos(th)
    np.testing.assert_allclose(forces, (pendulum, paper_forces(q, v, a)[1], 0, 0), **EXACT)
    with pytest.raises(InvalidInputError, match="at r = 0 the wheel has no inertia"):
        model.forward_dynamics(q, v, f)


def test_other_mistakes(model: PlanarRmp) -> None:
    with pytest.raises(InvalidInputError, match="PlanarRmp: mass: must be greater than 0"):
        PlanarRmp(0.0)
    with pytest.raises(InvalidInputError, match="PlanarRmp: gravity: must be at least 0"):
        PlanarRmp(1.0, -9.81)
    q = np.array((0.0, 1.2, 0.8, 0.0, 0.3))
    with pytest.raises(InvalidInputError, match=r"no equilibrium; f0 lacks tau_theta \+61\.1"):
        model.linearisation(q, model.holding_force(q) * (0, 1, 1, 1))
    with pytest.raises(InvalidInputError, match=r"v: expected shape \(5,\)"):
        model.bias(q, np.zeros(4))
    with pytest.raises(InvalidInputError, match=r"f: expected shape \(4,\)"):
        model.forward_dynamics(q, np.zeros(5), np.zeros(5))
