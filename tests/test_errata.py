"""The misprints of the paper, one test per row of the errata table (theory, section 9).

Each shows that the corrected form - wbc's own function where there is one - agrees with an oracle
that shares no code with wbc, and that the printed form does not. Here twists are angular first, as
in the paper; ``FIRST`` converts from and to Pinocchio's and wbc's linear first.

Derivatives are complex steps through kinematics written out below, and second derivatives in time
are Cauchy integrals: both are exact to rounding, so 1e-9 needs no allowance for differences.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray

from wbc.constraints import IndependentCoordinates
from wbc.controllers import KinematicController
from wbc.rmp.balance.static_lean import StaticLean
from wbc.rmp.ellipsoid import equimomental, equimomental_at_density, reaction_mass_radii
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.robot import Robot, Snapshot
from wbc.tasks import InertiaTask

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
FIRST = [3, 4, 5, 0, 1, 2]
TINY = 1e-30  # complex step
M, G = 21.5, 9.81
on_both_robots = pytest.mark.parametrize("name", ("hoap2_like", "g1_27"))


def assert_same(actual: Array, oracle: Array) -> None:
    """Within 1e-9 of the oracle's largest entry."""
    np.testing.assert_allclose(actual, oracle, rtol=0, atol=1e-9 * np.abs(oracle).max())


def assert_differs(printed: Array, oracle: Array) -> None:
    """By more than 1% of the oracle, ten million times what :func:`assert_same` lets pass."""
    assert np.linalg.norm(np.subtract(printed, oracle)) > 0.01 * np.linalg.norm(oracle)


# ------------------------------------------------------------------ the paper's operators


def skew(w: Array) -> Array:
    x, y, z = w
    return np.array(((0, -z, y), (z, 0, -x), (-y, x, 0)))


def hat(twist: Array) -> Array:
    """Eq. 1."""
    top = np.column_stack((skew(twist[:3]), twist[3:]))
    return np.vstack((top, np.zeros(4)))


def vee(matrix: Array) -> Array:
    return np.array((matrix[2, 1], matrix[0, 2], matrix[1, 0], *matrix[:3, 3]))


def Ad(T: Array) -> Array:
    """Eq. 3, corrected."""
    R, p = T[:3, :3], T[:3, 3]
    return np.block([[R, np.zeros((3, 3))], [skew(p) @ R, R]])


def ad(twist: Array) -> Array:
    """Eq. 4."""
    w, v = skew(twist[:3]), skew(twist[3:])
    return np.block([[w, np.zeros((3, 3))], [v, w]])


def spatial(P: Array) -> Array:
    """Spatial inertia (6, 6), angular first, of the second moments [[Sigma, h], [h', m]]."""
    h, moment = skew(P[:3, 3]), np.trace(P[:3, :3]) * np.eye(3) - P[:3, :3]
    return np.block([[moment, h], [-h, P[3, 3] * np.eye(3)]])


def dual(T: Array, inertia: Array) -> Array:
    """Eqs. 9 and 10: an inertia (6, 6) seen from the frame in which T is the body's pose."""
    back = Ad(np.linalg.inv(T))
    return back.T @ inertia @ back


def pose(rng: np.random.Generator) -> Array:
    R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R * np.sign(np.linalg.det(R)), rng.normal(size=3)
    return T


# ------------------------------------------------------------------ oracles


def placements(robot: Robot, q: Array, step: Array) -> list[Complex]:
    """T_i of all joints after a step along v, by Rodrigues; complex steps of size ``TINY`` only."""
    model, data = robot.model, robot.model.createData()
    pin.computeJointJacobians(model, data, q)
    found = [np.eye(4, dtype=complex)]
    found.append(data.oMi[1].homogeneous @ (np.eye(4) + hat(step[:6][FIRST])))
    for i in range(2, model.njoints):
        twist = screw(robot, data, i)
        angle = q[model.joints[i].idx_q] + step[model.joints[i].idx_v]
        assert not twist[3:].any()  # these robots have revolute joints alone
        K = skew(twist[:3])
        turn = np.eye(4, dtype=complex)
        turn[:3, :3] += np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
        found.append(found[model.parents[i]] @ model.jointPlacements[i].homogeneous @ turn)
    return found


def screw(robot: Robot, data: pin.Data, i: int) -> Array:
    """s_i in the joint's own frame: a unit vector along an axis, freed of rounding."""
    column = pin.getJointJacobian(robot.model, data, i, pin.LOCAL)[:, robot.model.joints[i].idx_v]
    return np.round(column[FIRST], 12)


def rate(function: Callable[[list[Complex]], Complex], here: Snapshot, v: Array) -> Array:
    """Rate of an analytic function of all T_i along v (linear first), by a complex step."""
    return np.imag(function(placements(here.robot, here.q, 1j * TINY * v))) / TINY


def second_moments(robot: Robot, T: list[Complex]) -> Complex:
    """[[Sigma, h], [h', m]] of the whole robot about the world's origin."""
    links = zip(robot.model.inertias, T, strict=True)
    return sum(A @ pin.PseudoInertia.FromInertia(Y).toMatrix() @ A.T for Y, A in links)


def vech(S: Array) -> Array:
    return S[np.triu_indices(3)]


def vech_crb(robot: Robot, T: list[Complex]) -> Complex:
    """(9,) of eq. 24: centroidal inertia, then mass times CoM."""
    P = second_moments(robot, T)
    S = P[:3, :3] - np.outer(P[:3, 3], P[:3, 3]) / P[3, 3]
    return np.concatenate((vech(np.trace(S) * np.eye(3) - S), P[:3, 3]))


def link_jacobians(here: Snapshot) -> Array:
    """J_ij = T_i^-1 dT_i/dq_j of eq. 14 for all links i, (njoints, 6, n)."""
    back = np.linalg.inv(np.real(placements(here.robot, here.q, np.zeros(here.robot.nv))))
    slopes = [back @ rate(np.array, here, e) for e in np.eye(here.robot.nv)[6:]]
    return np.array([[vee(X) for X in slope] for slope in slopes]).transpose(1, 2, 0)


def six_masses(frame: Array, radii: Array) -> Array:
    """Places (6, 3) of the three pairs of 4.1."""
    arms = (frame * radii).T
    return np.concatenate((arms, -arms))


def inertia_of_points(points: Array, masses: Array) -> Array:
    sizes = zip(points, masses, strict=True)
    return sum(m * (x @ x * np.eye(3) - np.outer(x, x)) for x, m in sizes)


def two_masses(q: Complex) -> Complex:
    """Places (2, 2) of the masses M/2 of 4.2; q = (x_cop, theta, r_l, alpha, r)."""
    x, th, rl, al, r = q
    c = np.array((x + rl * np.cos(th), rl * np.sin(th)))
    arm = r * np.array((np.cos(th + al), np.sin(th + al)))
    return np.array((c + arm, c - arm))


def newton(q: Array, v: Array, a: Array) -> Array:
    """Generalised forces (5,) by d'Alembert: sum of M/2 (x'' - g) . dx/dq over both masses."""
    turns = np.exp(2j * np.pi * np.arange(64) / 64)
    times = 0.5 * turns  # Cauchy: x''(0) = 2! mean(x(t) / t^2) over a circle of times
    path = [two_masses(q + v * t + a * t**2 / 2) / t**2 for t in times]
    push = M / 2 * (2.0 * np.mean(path, axis=0).real + (0.0, G))
    slopes = [np.imag(two_masses(q + 1j * TINY * e)) / TINY for e in np.eye(5)]
    return np.array([(push * slope).sum() for slope in slopes])


def lagrange(kinetic: Callable[[Complex, Complex], complex], q: Array, v: Array, a: Array) -> Array:
    """d/dt dT/dv - dT/dq + dV/dq (5,) of a T quadratic in v, by complex steps."""

    def momentum(q: Complex, v: Complex) -> Complex:
        return np.array([kinetic(q, v + e) - kinetic(q, v) - kinetic(q, e) for e in np.eye(5)])

    t = 1j * TINY
    rates = np.imag(momentum(q + v * t, v + a * t))
    slopes = [np.imag(kinetic(q + t * e, v) - potential(q + t * e)) for e in np.eye(5)]
    return (rates - slopes) / TINY


def potential(q: Complex) -> complex:
    return M * G * q[2] * np.sin(q[1])


def pendulum_state(rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Random (q, v, a) of the planar pendulum on a CoP at rest."""
    q = rng.uniform((-1, 0.3, 0.6, -3, 0.2), (1, 2.8, 1.2, 3, 0.6))
    v, a = rng.normal(size=5), 3.0 * rng.normal(size=5)
    v[0] = a[0] = 0.0
    return q, v, a


@on_both_robots
def test_the_kinematics_written_here_are_pinocchios(name: str, robot_named, rng, random_snapshot):
    robot = robot_named(name)
    here = random_snapshot(robot, rng)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, here.q)
    T = placements(robot, here.q, np.zeros(robot.nv))
    np.testing.assert_allclose(T, [place.homogeneous for place in data.oMi], rtol=0, atol=1e-12)
    pin.computeJointJacobians(robot.model, data, here.q)
    for i, J in enumerate(link_jacobians(here)):
        expected = pin.getJointJacobian(robot.model, data, i, pin.LOCAL)[FIRST, 6:]
        np.testing.assert_allclose(J, expected, rtol=0, atol=1e-12)


# ------------------------------------------------------------------ section 2: one rigid body


def test_eq_3_the_arm_of_the_adjoint_is_the_position(rng: np.random.Generator) -> None:
    """Printed [[R, 0], [S(rho) R, R]] with rho the twist's angular part; right S(p) R."""
    oracle, right, printed = [], [], []
    for _ in range(5):
        T, g = pose(rng), rng.normal(size=6)
        oracle.append(vee(T @ hat(g) @ np.linalg.inv(T)))
        right.append(Ad(T) @ g)
        turned = T.copy()
        turned[:3, 3] = g[:3]
        printed.append(Ad(turned) @ g)
        assert_same(Ad(T), pin.SE3(T).action[FIRST][:, FIRST])
    assert_same(right, oracle)
    assert_differs(printed, oracle)


@on_both_robots
def test_text_by_eq_8_the_twist_at_the_com(name: str, robot_named, rng, random_snapshot) -> None:
    """Printed v = Ad_T v_CoM, T the body's pose in space; right Ad_G, G from body frame to CoM.

    The body is the robot with its joints locked; the oracle the sum of its links' energies.
    """
    robot = robot_named(name)
    here = random_snapshot(robot, rng)
    twists, data = rng.normal(size=(8, 6)), robot.model.createData()
    locked = np.column_stack((twists, np.zeros((8, robot.nv - 6))))
    energies = [pin.computeKineticEnergy(robot.model, data, here.q, v) for v in locked]
    pin.ccrba(robot.model, data, here.q, here.v)
    I_com = np.zeros((6, 6))
    I_com[:3, :3], I_com[3:, 3:] = data.Ig.inertia, robot.mass * np.eye(3)
    T = data.oMi[1].homogeneous
    G = np.linalg.inv(T) @ pin.SE3(np.eye(3), data.com[0]).homogeneous

    def energies_by(transform: Array) -> list[float]:
        at_com = np.linalg.solve(Ad(transform), twists[:, FIRST].T).T
        return [v @ I_com @ v / 2 for v in at_com]

    assert_same(energies_by(G), energies)
    about_base = here.inertia_about("base")
    assert_same([v @ about_base @ v / 2 for v in twists], energies)
    assert_same(about_base[FIRST][:, FIRST], dual(G, I_com))
    assert_differs(energies_by(T), energies)
    assert_differs(dual(T, I_com), dual(G, I_com))


# ------------------------------------------------------------------ section 3: links


@on_both_robots
def test_eq_15_link_jacobians_are_carried_back(name: str, robot_named, rng, random_snapshot):
    """Printed J_ij = Ad(H e^(s q)) J_p(i)j + s_i delta_ij; right Ad of the inverse."""
    robot = robot_named(name)
    here, model = random_snapshot(robot, rng), robot.model
    data = model.createData()
    pin.computeJointJacobians(model, data, here.q)
    foot = robot.feet["left"].frame
    frame = model.frames[robot.frame_id(foot)]

    def recursion(sign: int) -> Array:
        J = np.zeros((model.njoints, 6, model.nv))
        for i in range(2, model.njoints):
            step = data.liMi[i].homogeneous  # H e^(s q)
            J[i] = Ad(np.linalg.inv(step) if sign < 0 else step) @ J[model.parents[i]]
            J[i][:, model.joints[i].idx_v] += screw(robot, data, i)
        return J[:, :, 6:]

    oracle = link_jacobians(here)
    assert_same(recursion(-1), oracle)
    assert_differs(recursion(+1), oracle)
    # wbc: the same at the foot, world axes.
    axes = np.kron(np.eye(2), here.rotation(foot))
    back = Ad(frame.placement.inverse().homogeneous)
    assert_same(here.jacobian(foot)[FIRST][:, 6:], axes @ back @ oracle[frame.parentJoint])


@on_both_robots
def test_eq_18_has_a_mass_of_its_own(name: str, robot_named, rng, random_snapshot) -> None:
    """Printed right; but its ellipsoid weighs what rho says, and not what the robot does.

    The oracle fills the ellipsoid with point masses: a quadrature exact for second moments.
    """
    robot, rho = robot_named(name), 1000.0
    inertia = random_snapshot(robot, rng).inertia
    sigma = np.linalg.eigvalsh(inertia)
    s = sigma.sum() - 2 * sigma  # -sigma_i + sigma_j + sigma_k
    printed = (15 / (8 * np.pi * rho)) ** 0.2 * s**0.4 / (np.roll(s, 1) * np.roll(s, 2)) ** 0.1
    found = equimomental_at_density(inertia, rho)
    assert_same(found.semi_axes, printed)

    def filled(semi_axes: Array, density: float) -> tuple[Array, Array]:
        u, wu = np.polynomial.legendre.leggauss(4)  # of radius and height
        turns = 2 * np.pi * np.arange(8) / 8
        r, z, phi = (x.ravel() for x in np.meshgrid((u + 1) / 2, u, turns, indexing="ij"))
        weights = np.einsum("i,j,k", wu / 2, wu, np.full(8, 2 * np.pi / 8)).ravel() * r**2
        rim = np.sqrt(1 - z**2)
        ball = np.column_stack((r * rim * np.cos(phi), r * rim * np.sin(phi), r * z))
        return ball * semi_axes @ found.axes.T, density * np.prod(semi_axes) * weights

    points, masses = filled(found.semi_axes, rho)
    assert_same(inertia_of_points(points, masses), inertia)
    assert_same(masses.sum(), found.mass)
    # Taken for the robot's ellipsoid it weighs too much or too little, and with the robot's mass
    # its inertia is not the robot's; the ellipsoid of that mass has both.
    assert_differs(found.mass, robot.mass)
    assert_differs(inertia_of_points(points, masses * robot.mass / masses.sum()), inertia)
    true = equimomental(inertia, robot.mass)
    points, masses = filled(true.semi_axes, robot.mass / true.volume)
    assert_same(inertia_of_points(points, masses), inertia)
    assert_same(masses.sum(), robot.mass)


# ------------------------------------------------------------------ section 4: the pendulum


@on_both_robots
def test_text_4_1_what_a_pair_of_masses_adds(name: str, robot_named, rng, random_snapshot) -> None:
    """Printed: each axis generates m r_k^2. Right: 2 m r_k^2 of second moment along axis k, so the
    moment of inertia about axis i is 2 m (r_j^2 + r_k^2)."""
    m, r = M / 6, rng.uniform(0.2, 0.6, 3)
    oracle = inertia_of_points(six_masses(np.eye(3), r), np.full(6, m))
    q = np.concatenate(((0, 0, 1.5, 0, 0.8, 0, 0, 0, 1), r))
    others = np.array([r[1] ** 2 + r[2] ** 2, r[0] ** 2 + r[2] ** 2, r[0] ** 2 + r[1] ** 2])
    assert_same(np.diag(2 * m * others), oracle)
    assert_same(np.diag(SolidRmp(M, G).inertia(q)), oracle)
    # As printed: of one pair for the moment about axis k, or about the two axes across it.
    assert_differs(np.diag(m * r**2), oracle)
    assert_differs(np.diag(m * others), oracle)

    robot = robot_named(name)
    here = random_snapshot(robot, rng)
    data = robot.model.createData()
    pin.ccrba(robot.model, data, here.q, here.v)
    axes = equimomental(here.inertia, robot.mass).axes
    points = six_masses(axes, reaction_mass_radii(here.inertia, robot.mass))
    assert_same(inertia_of_points(points, np.full(6, robot.mass / 6)), np.array(data.Ig.inertia))


def test_eq_19_the_wheel_turns_with_the_leg(rng: np.random.Generator) -> None:
    """Printed M r^2 (th'^2 + al'^2) / 2; right M r^2 (th' + al')^2 / 2, and (20)-(23) follow so.

    Oracles: the energy of two point masses, and Newton's law for each of them.
    """

    def kinetic(q: Complex, v: Complex, printed: bool) -> complex:
        _, _, rl, _, r = q
        _, th, drl, al, dr = v
        turning = th**2 + al**2 if printed else (th + al) ** 2
        return M / 2 * (drl**2 + dr**2 + rl**2 * th**2 + r**2 * turning)

    def eqs_20_to_23(q: Array, v: Array, a: Array) -> Array:
        """As printed, in wbc's order (tau_theta, f_l, tau, f)."""
        _, th, rl, _, r = q
        (_, dth, drl, dal, dr), (_, ddth, ddrl, ddal, ddr) = v, a
        tau = M * r**2 * (ddth + ddal) + 2 * M * r * dr * (dth + dal)
        tau_theta = M * rl**2 * ddth + 2 * M * rl * drl * dth + M * G * rl * np.cos(th) + tau
        f_l = M * ddrl - M * rl * dth**2 + M * G * np.sin(th)
        return np.array((tau_theta, f_l, tau, M * ddr - M * r * (dth + dal) ** 2))

    model = PlanarRmp(M, G)
    states = [pendulum_state(rng) for _ in range(10)]
    speeds = [np.imag(two_masses(q + 1j * TINY * v)) / TINY for q, v, _ in states]
    energies = M / 4 * np.sum(np.square(speeds), axis=(1, 2))
    assert_same([model.energies(q, v)[0] for q, v, _ in states], energies)
    assert_same([kinetic(q, v, printed=False) for q, v, _ in states], energies)
    assert_differs([kinetic(q, v, printed=True) for q, v, _ in states], energies)

    forces = np.array([newton(*state)[1:] for state in states])
    assert_same([model.inverse_dynamics(*state) for state in states], forces)
    assert_same([eqs_20_to_23(*state) for state in states], forces)
    right, printed = (
        np.array([lagrange(partial(kinetic, printed=p), *state)[1:] for state in states])
        for p in (False, True)
    )
    assert_same(right, forces)
    assert_same(printed[:, 1], forces[:, 1])  # the leg's length is not concerned
    for k in (0, 2, 3):
        assert_differs(printed[:, k], forces[:, k])


@pytest.mark.parametrize("degrees", (60.0, 80.0, 110.0))
def test_text_4_2_the_static_lean_takes_the_legs_length(degrees: float, rng) -> None:
    """Printed tau = -M g r cos(theta_c), r the wheel's radius; right r_l, the leg's length.

    Newton's law for both masses, with the wheel's acceleration such that tau_theta = 0.
    """
    angle, length, radius = np.radians(degrees), 0.9, 0.35
    q = np.array((0.0, angle, length, rng.uniform(-3, 3), radius))
    v = np.array((0.0, 0.0, 0.0, rng.normal(), 0.0))
    wheel = np.eye(5)[3]
    rest, unit = newton(q, v, np.zeros(5)), newton(q, v, wheel)
    a = -rest[1] / (unit[1] - rest[1]) * wheel
    oracle = newton(q, v, a)
    assert abs(oracle[1]) < 1e-9
    model = PlanarRmp(M, G)
    assert_same(-M * G * length * np.cos(angle), oracle[3])
    assert_same(StaticLean(model, angle, length, radius).static_torque, oracle[3])
    assert_same(model.forward_dynamics(q, v, oracle[1:]), a)
    assert_differs(-M * G * radius * np.cos(angle), oracle[3])


# ------------------------------------------------------------------ section 5: inertia Jacobian


@on_both_robots
def test_eq_26_both_inertias_are_in_the_spatial_frame(name, robot_named, rng, random_snapshot):
    """Printed -ad* I - 0I ad, with 0I of the base frame in the second term; right I in both."""
    robot = robot_named(name)
    here = random_snapshot(robot, rng)
    v = np.concatenate((rng.normal(size=6), np.zeros(robot.nv - 6)))
    total = partial(second_moments, robot)
    oracle = spatial(rate(total, here, v))
    still = placements(robot, here.q, np.zeros(robot.nv))
    inertia = spatial(total(still).real)
    T_0 = still[1].real
    turn = ad(Ad(T_0) @ v[:6][FIRST])
    assert_same(-turn.T @ inertia - inertia @ turn, oracle)
    at_base = dual(np.linalg.inv(T_0), inertia)
    assert_same(here.inertia_about("base")[FIRST][:, FIRST], at_base)
    assert_differs(-turn.T @ inertia - at_base @ turn, oracle)
    centroidal = rate(partial(vech_crb, robot), here, v)
    assert_same(here.inertia_jacobian @ v, centroidal[:6])
    assert_same(robot.mass * here.com_jacobian @ v, centroidal[6:])


@on_both_robots
def test_eq_27_carried_links_in_the_spatial_frame(name: str, robot_named, rng, random_snapshot):
    """Printed -sum over i = 1 .. n of ad*(sJ_ij) I_i + I_i ad(sJ_ij), where I_i is a link's own and
    sJ_ij, by the relation above it, Ad_{G_i} J_ij in base axes. Right: the links that joint j
    carries, whose sJ_ij are one and the same twist, and all of it in the spatial frame.

    With J_ij = 0 for other links, as eq. 15 has it, the sum over all links does no harm, and with
    I_i taken for spatial, as 5.1 announces, the base axes of sJ_ij are what is left to correct.
    """
    robot = robot_named(name)
    here, model = random_snapshot(robot, rng), robot.model
    T = np.real(placements(robot, here.q, np.zeros(robot.nv)))
    own = np.array([Y.matrix()[FIRST][:, FIRST] for Y in model.inertias])
    seen = np.array([dual(place, inertia) for place, inertia in zip(T, own, strict=True)])
    total = partial(second_moments, robot)

    def summed(twist: Array, inertias: Array) -> Array:
        turn, inertia = ad(twist), inertias.sum(axis=0)
        return -turn.T @ inertia - inertia @ turn

    for j in range(2, model.njoints):
        e = np.eye(robot.nv)[model.joints[j].idx_v]
        oracle = spatial(rate(total, here, e))
        unit = np.linalg.inv(T[j]) @ rate(lambda T, j=j: T[j], here, e)  # s_j, a 4x4 twist
        space, base = (Ad(A) @ vee(unit) for A in (T[j], np.linalg.inv(T[1]) @ T[j]))
        carried = list(model.subtrees[j])
        assert_same(summed(space, seen[carried]), oracle)
        for printed in (
            summed(space, own[carried]),
            summed(base, own[carried]),
            summed(base, seen[carried]),
            summed(space, seen[2:]),
        ):
            assert_differs(printed, oracle)
        centroidal = rate(partial(vech_crb, robot), here, e)
        assert_same(here.inertia_jacobian @ e, centroidal[:6])
        assert_same(robot.mass * here.com_jacobian @ e, centroidal[6:])


@on_both_robots
def test_eq_33_the_held_foots_own_adjoint(name: str, robot_named, rng, random_snapshot) -> None:
    """Printed T_0^-1 dT_0 = -Ad_{G_r} J_l dq for the left foot held; right Ad_{G_l}.

    The oracle moves base and joints so and looks whether the foot stays.
    """
    robot = robot_named(name)
    here = random_snapshot(robot, rng)

    def foot(side: str, T: list[Complex]) -> Complex:
        frame = robot.model.frames[robot.frame_id(robot.feet[side].frame)]
        return T[frame.parentJoint] @ frame.placement.homogeneous

    left = partial(foot, "left")
    still = placements(robot, here.q, np.zeros(robot.nv))
    to_base = np.linalg.inv(still[1].real)
    G = {side: to_base @ foot(side, still).real for side in ("left", "right")}
    joints = np.concatenate((np.zeros(6), rng.normal(size=robot.nv - 6)))
    swing = vee(np.linalg.inv(left(still).real) @ rate(left, here, joints))  # J_l dq

    def motion(side: str) -> Array:
        return np.concatenate((-(Ad(G[side]) @ swing)[FIRST], joints[6:]))

    alone = np.abs(rate(left, here, joints)).max()
    assert np.abs(rate(left, here, motion("left"))).max() < 1e-9 * alone
    assert np.abs(rate(left, here, motion("right"))).max() > 0.05 * alone
    # wbc's independent coordinates lead to the same motion of the base.
    own = IndependentCoordinates.of(here, "left")
    assert_same(own.basis @ motion("left")[own.independent], motion("left"))


# ------------------------------------------------------------------ section 5.3: inertia shaping


def measured(here: Snapshot) -> Array:
    """Pinocchio's centroidal inertia and mass times CoM, vech (9,)."""
    data = here.robot.model.createData()
    pin.ccrba(here.robot.model, data, here.q, here.v)
    return np.concatenate((vech(np.array(data.Ig.inertia)), here.robot.mass * data.com[0]))


def nine_rows(here: Snapshot) -> Array:
    """wbc's J_I (9, nv) of eq. 24."""
    return np.vstack((here.inertia_jacobian, here.robot.mass * here.com_jacobian))


def a_goal(robot: Robot, rng: np.random.Generator) -> Snapshot:
    step = 0.2 * rng.normal(size=robot.nv)
    return robot.snapshot(robot.integrate(robot.posture("standing"), step, 1.0))


@on_both_robots
def test_eq_38_steps_by_the_error_not_by_its_change(name: str, robot_named, rng) -> None:
    """Printed dtheta = J^+ delta(I_d - I); right a step on I_d - I itself.

    I_d is constant: delta(I_d - I) of any motion is -delta I, and the right-hand side takes back
    the very motion it is to define. Only dtheta = 0 solves the equation, however far the target.
    """
    robot = robot_named(name)
    here = robot.snapshot(robot.posture("standing"))
    goal = measured(a_goal(robot, rng))
    J = nine_rows(here)
    inverse = J.T @ np.linalg.inv(J @ J.T)
    changes = partial(rate, partial(vech_crb, robot), here)
    error = goal - measured(here)
    assert_same(changes(inverse @ error), error)
    motion = inverse @ rng.normal(size=9)
    printed = inverse @ -changes(motion)
    assert_same(-printed, motion)
    assert_differs(printed, motion)


@on_both_robots
def test_eq_38_needs_damping(name: str, robot_named, rng) -> None:
    """J_I's nine rows mix kg m^2 and kg m and nearly lose rank: J^+ (I_d - I) turns joints by a
    radian and more, and leaves the small robot's inertia further off than it was. Damped by the
    square of an error without units both robots arrive, as they do by wbc's controller of eq. 38.
    """
    robot = robot_named(name)
    start, there = robot.snapshot(robot.posture("neutral")), a_goal(robot, rng)
    goal, mass = measured(there), robot.mass
    length = np.sqrt(np.trace(start.inertia) / (2 * mass))
    units = np.repeat((1 / (mass * length**2), 1 / (mass * length)), (6, 3))

    def step(here: Snapshot, damped: bool) -> Array:
        J = units[:, None] * nine_rows(here)
        error = units * (goal - measured(here))
        damping = error @ error if damped else 0.0
        return J.T @ np.linalg.solve(J @ J.T + damping * np.eye(9), error)

    def after(steps: int, move: Callable[[Snapshot], Array]) -> Array:
        here = start
        for _ in range(steps):
            here = robot.snapshot(robot.integrate(here.q, move(here), 1.0))
        return measured(here)

    assert_same(after(25, partial(step, damped=True)), goal)
    task = InertiaTask(robot, there.inertia, gain=1.0)
    controller = KinematicController(robot, [task], dt=1.0, damping=1e-9, solver="pseudo_inverse")
    assert_same(after(80, lambda here: controller.step(here).velocity)[:6], goal[:6])

    undamped, damped = (np.abs(step(start, d)[6:]).max() for d in (False, True))
    assert undamped > 0.7 and damped < 0.2
    if name == "hoap2_like":
        assert np.linalg.cond(nine_rows(start)) > 1e4
        before, then = measured(start)[:6], after(1, partial(step, damped=False))[:6]
        assert np.linalg.norm(then - goal[:6]) > np.linalg.norm(before - goal[:6])
