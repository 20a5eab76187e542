"""The solid pendulum against six point masses, Newton and Euler, and the planar pendulum."""

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import EulerSolidRmp, SolidRmp
from wbc.validate import Array

M, G = 21.5, 9.81
GRAVITY = np.array((0.0, 0.0, -G))
# Rounding of some hundred operations on numbers up to a thousand.
EXACT = {"rtol": 1e-11, "atol": 1e-9}
TINY = 1e-30  # complex step: derivatives exact to rounding


@pytest.fixture(scope="module")
def model() -> SolidRmp:
    return SolidRmp(M, G)


@pytest.fixture(scope="module")
def euler() -> EulerSolidRmp:
    return EulerSolidRmp(M, G)


def hat(w: Array) -> Array:
    x, y, z = w
    return np.array(((0, -z, y), (z, 0, -x), (-y, x, 0)))


def rotation(quaternion: Array) -> Array:
    """Rodrigues' form, R = 1 + 2 s [u]x + 2 [u]x [u]x."""
    u, s = hat(quaternion[:3]), quaternion[3]
    return np.eye(3) + 2 * s * u + 2 * u @ u


def by_angles(angles: Array) -> Array:
    """alpha about -y, then beta about the new x, then gamma about the new z, by Rodrigues."""
    R = np.eye(3)
    for axis, angle in zip(((0, -1, 0), (1, 0, 0), (0, 0, 1)), angles, strict=True):
        K = hat(np.array(axis, dtype=float))
        R = R @ (np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K)
    return R


def leg(theta: complex, phi: complex) -> Array:
    return np.array((np.cos(theta) * np.cos(phi), np.sin(phi), np.sin(theta) * np.cos(phi)))


def leg_slopes(theta: float, phi: float) -> Array:
    """dn/dtheta and dn/dphi as columns (3, 2), by complex steps."""
    steps = (leg(theta + 1j * TINY, phi), leg(theta, phi + 1j * TINY))
    return np.column_stack([np.imag(n) / TINY for n in steps])


def com_rate(x: Array, v: Array) -> Array:
    """c' from the leg's five coordinates and rates; complex numbers welcome."""
    (_, _, th, ph, rl), (px, py, dth, dph, drl) = x[:5], v[:5]
    by_theta = np.array((-np.sin(th) * np.cos(ph), 0 * th, np.cos(th) * np.cos(ph)))
    by_phi = np.array((-np.cos(th) * np.sin(ph), np.cos(ph), -np.sin(th) * np.sin(ph)))
    return np.array((px, py, 0)) + drl * leg(th, ph) + rl * (by_theta * dth + by_phi * dph)


def com_acceleration(q: Array, v: Array, a: Array) -> Array:
    """c'' as the rate of c' along the motion."""
    moved = q[:5] + 1j * TINY * v[:5]
    return np.asarray(np.imag(com_rate(moved, v[:5] + 1j * TINY * a[:5])) / TINY)


def state(seed: int) -> tuple[Array, Array, Array]:
    """Random (q, v, a) of SolidRmp, the CoP moving."""
    rng = np.random.default_rng(seed)
    orientation = rng.normal(size=4)
    q = np.concatenate(
        (
            rng.normal(size=2),
            rng.uniform((-3, -1.3, 0.3), (3, 1.3, 1.2)),
            orientation / np.linalg.norm(orientation),
            rng.uniform(0.1, 0.6, 3),
        )
    )
    return q, 2.0 * rng.normal(size=11), 5.0 * rng.normal(size=11)


def moments(r: Array) -> Array:
    return M / 3 * np.array((r[1] ** 2 + r[2] ** 2, r[0] ** 2 + r[2] ** 2, r[0] ** 2 + r[1] ** 2))


def newton_euler(q: Array, v: Array, a: Array) -> tuple[Array, Array]:
    """Return the generalised forces (9,) and the ground reaction (3,)."""
    reaction = M * (com_acceleration(q, v, a) - GRAVITY)
    along = q[4] * leg_slopes(q[2], q[3]).T @ reaction
    r, w, dr = q[9:], v[5:8], v[8:]
    I = moments(r)  # noqa: E741
    I_rate = np.imag(moments(r + 1j * TINY * dr)) / TINY
    torque = I * a[5:8] + I_rate * w + np.cross(w, I * w)
    slide = M / 3 * (a[8:] - r * (w @ w - w**2))
    return np.concatenate((along, (leg(q[2], q[3]) @ reaction,), torque, slide)), reaction


def six_masses(q: Array, v: Array) -> tuple[Array, Array]:
    """Return places and velocities (6, 3) of the masses M/6."""
    R, r = rotation(q[5:9]), q[9:]
    c = np.array((q[0], q[1], 0.0)) + q[4] * leg(q[2], q[3])
    arms = np.concatenate((R * r, -R * r), axis=1)
    slides = np.concatenate((R * v[8:], -R * v[8:]), axis=1)
    rates = com_rate(q, v)[:, None] + hat(R @ v[5:8]) @ arms + slides
    return (c[:, None] + arms).T, rates.T


@pytest.mark.parametrize("seed", range(20))
def test_energies_and_momenta_are_those_of_six_point_masses(model: SolidRmp, seed: int) -> None:
    q, v, _ = state(seed)
    places, rates = six_masses(q, v)
    T, V = M / 12 * np.sum(rates**2), M / 6 * G * places[:, 2].sum()
    np.testing.assert_allclose(model.energies(q, v), (T, V), **EXACT)
    c = places.mean(axis=0)
    for got, about in zip(model.momenta(q, v), (c, np.array((q[0], q[1], 0.0))), strict=True):
        np.testing.assert_allclose(got, M / 6 * np.cross(places - about, rates).sum(0), **EXACT)
    np.testing.assert_allclose(model.com(q, v)[0], c, **EXACT)
    np.testing.assert_allclose(model.com(q, v)[1], rates.mean(axis=0), **EXACT)
    np.testing.assert_allclose(v @ model.mass_matrix(q) @ v / 2, T, **EXACT)


@pytest.mark.parametrize("seed", range(20))
def test_newton_and_euler(model: SolidRmp, seed: int) -> None:
    q, v, a = state(seed)
    f, reaction = newton_euler(q, v, a)
    np.testing.assert_allclose(model.inverse_dynamics(q, v, a), f, **EXACT)
    np.testing.assert_allclose(model.ground_reaction(q, v, a), reaction, **EXACT)
    got = model.forward_dynamics(q, v, f, cop_acceleration=a[:2])
    # Relative to M: light masses turn rounding of torques into accelerations.
    np.testing.assert_allclose(got, a, rtol=1e-9, atol=1e-9)
    rows = model.mass_matrix(q) @ a + model.bias(q, v)
    np.testing.assert_allclose(rows, np.concatenate((reaction[:2], f)), **EXACT)


@pytest.mark.parametrize("seed", range(10))
def test_angles_and_body_rates_describe_one_motion(model, euler, seed: int) -> None:
    q, v, a = state(seed)
    rng = np.random.default_rng(seed)
    angles, rates, changes = rng.uniform(-1.2, 1.2, 3), rng.normal(size=3), rng.normal(size=3)
    W = body_map(angles)
    W_rate = np.imag(body_map(angles + 1j * TINY * rates)) / TINY
    R_rate = np.imag(by_angles(angles + 1j * TINY * rates)) / TINY
    np.testing.assert_allclose(by_angles(angles).T @ R_rate, hat(W @ rates), atol=1e-12)
    v[5:8] = W @ rates
    a[5:8] = W @ changes + W_rate @ rates
    q[5:9] = quaternion_of(by_angles(angles))
    q_e = np.concatenate((q[:5], angles, q[9:]))
    v_e, a_e = v.copy(), a.copy()
    v_e[5:8], a_e[5:8] = rates, changes
    for mine, theirs in zip(model.momenta(q, v), euler.momenta(q_e, v_e), strict=True):
        np.testing.assert_allclose(mine, theirs, **EXACT)
    np.testing.assert_allclose(model.energies(q, v), euler.energies(q_e, v_e), **EXACT)
    f = model.inverse_dynamics(q, v, a)
    f[3:6] = W.T @ f[3:6]
    np.testing.assert_allclose(euler.inverse_dynamics(q_e, v_e, a_e), f, **EXACT)
    got = euler.forward_dynamics(q_e, v_e, f, a[:2])
    np.testing.assert_allclose(got, a_e, rtol=1e-9, atol=1e-9)


def body_map(angles: Array) -> Array:
    """W (3, 3): the axes of the three turns, seen from the turned frame."""
    second = by_angles(np.array((0 * angles[0], angles[1], angles[2])))
    third = by_angles(np.array((0 * angles[0], 0 * angles[1], angles[2])))
    return np.column_stack((second.T @ (0, -1, 0), third.T @ (1, 0, 0), (0, 0, 1)))


def quaternion_of(R: Array) -> Array:
    s = np.sqrt(1 + np.trace(R)) / 2
    return np.array((R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 4 * s * s)) / (4 * s)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("seed", range(10))
def test_a_hip_leaves_the_ground_only_a_vertical_moment(model, seed: int, side: float) -> None:
    """k_G' = (p - c) x f_r + m n, n vertical (theory of the CoP); k_G' is the hip's torque.

    Also where the leg points down (side -1), as on a ceiling.
    """
    q, v, _ = state(seed)
    q[2] = side * np.clip(q[2], 0.5, 2.5)
    assert side * leg(q[2], q[3])[2] > 0.0
    torque = np.array((3.0, -5.0, 2.0))
    f = model.hip_torque(q, torque)
    f[2] = 150.0
    a = model.forward_dynamics(q, v, f, (0.4, -0.3))
    reaction = model.ground_reaction(q, v, a)
    arm = -q[4] * leg(q[2], q[3])
    moment = rotation(q[5:9]) @ torque - np.cross(arm, reaction)
    np.testing.assert_allclose(moment[:2], 0.0, atol=1e-9)


@pytest.mark.parametrize("kind", (PlanarRmp, SolidRmp, EulerSolidRmp))
@pytest.mark.parametrize("theta", (np.pi / 2, 1.2, -np.pi / 2))
def test_linearisation_is_the_slope_of_the_dynamics(kind: type[PlanarRmp], theta: float) -> None:
    model = kind(M, G)
    turned = {PlanarRmp: (0.3,), SolidRmp: (0, 0, 0, 1), EulerSolidRmp: (0.3, -0.2, 0.5)}[kind]
    place, radii = ((0.2,), (0.3,)) if kind is PlanarRmp else ((0.1, -0.2), (0.2, 0.3, 0.4))
    leg = (theta, 0.8) if kind is PlanarRmp else (theta, 0.2, 0.8)
    q = np.array((*place, *leg, *turned, *radii))
    f, n, nv = model.holding_force(q), len(place), len(model.V)
    if kind is PlanarRmp:
        expected = (M * G * 0.8 * np.cos(theta), M * G * np.sin(theta), 0, 0)
        np.testing.assert_allclose(f, expected, **EXACT)
    A, B = model.linearisation(q, f)

    def rate(x: Array, u: Array) -> Array:
        at, turn = q.copy(), x[5:8]
        if kind is SolidRmp:
            half = np.linalg.norm(turn) / 2
            at[:5] += x[:5]
            at[5:8], at[8] = np.sin(half) * turn / max(2 * half, TINY), np.cos(half)
            at[9:] += x[8:nv]
        else:
            at += x[:nv]
        return np.concatenate((x[nv:], model.forward_dynamics(at, x[nv:], f + u[n:], u[:n])))

    h = 1e-5  # central: error h^2 and 1e-14 / h
    for k, e in enumerate(np.eye(2 * nv) * h):
        slope = (rate(e, np.zeros(nv)) - rate(-e, np.zeros(nv))) / (2 * h)
        np.testing.assert_allclose(A[:, k], slope, rtol=1e-6, atol=1e-7)
    for k, e in enumerate(np.eye(nv) * h):
        slope = (rate(np.zeros(2 * nv), e) - rate(np.zeros(2 * nv), -e)) / (2 * h)
        np.testing.assert_allclose(B[:, k], slope, rtol=1e-6, atol=1e-7)


def change(**entries: float) -> Array:
    q = np.array((0, 0, 1.5, 0, 0.8, 0, 0, 0, 1, 0.2, 0.3, 0.4))
    for name, value in entries.items():
        q[SolidRmp.Q.index(name)] = value
    return q


@pytest.mark.parametrize(
    ("q", "message"),
    [
        (change(r_l=0.0), "r_l, the leg's length, must be positive"),
        (change(phi=np.pi / 2), "the leg lies along the horizontal y axis"),
        (change(r_2=-0.1), "r_1, r_2, r_3 must not be negative"),
        (change(quat_w=0.9), r"the quaternion's norm is 0\.9"),
        (change(theta=np.inf), r"q: NaN or infinite at \(2,\)"),
        (change(r_1=0.0, r_3=0.0), "no inertia about some axis"),
    ],
)
def test_impossible_configurations(model: SolidRmp, q: Array, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        model.forward_dynamics(q, np.zeros(11), np.zeros(9))


def test_other_mistakes(model: SolidRmp, euler: EulerSolidRmp) -> None:
    with pytest.raises(InvalidInputError, match="SolidRmp: mass: must be greater than 0"):
        SolidRmp(-1.0)
    with pytest.raises(InvalidInputError, match=r"no equilibrium; f0 lacks tau_theta .* f_l"):
        model.linearisation(change(), np.zeros(9))
    with pytest.raises(InvalidInputError, match=r"cop_acceleration: expected shape \(2,\)"):
        model.forward_dynamics(change(), np.zeros(11), np.zeros(9), 0.0)
    with pytest.raises(InvalidInputError, match="the leg is horizontal"):
        model.hip_torque(change(theta=0.0), np.ones(3))
    q = np.array((0, 0, 1.5, 0, 0.8, 0.1, np.pi / 2, 0, 0.2, 0.3, 0.4))
    with pytest.raises(InvalidInputError, match="beta = 90 degrees is singular; SolidRmp has no"):
        euler.forward_dynamics(q, np.zeros(11), np.zeros(9))
