"""The regulator against finite differences of its own closed loop, and under wrong plants."""

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov
from scipy.spatial.transform import Rotation

from wbc.errors import InvalidInputError
from wbc.rmp.balance.law import LawBounds, PendulumCommand
from wbc.rmp.balance.lqr import Lqr
from wbc.rmp.balance.record import Ending
from wbc.rmp.balance.simulate import simulate
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array

M, G = 20.0, 9.81
PLANAR, SOLID = PlanarRmp(M, G), SolidRmp(M, G)
UP_PLANAR = np.array((0.05, np.pi / 2, 0.9, 0.4, 0.35))
TURNED = Rotation.from_rotvec((0.3, -0.2, 0.5)).as_quat()
UP_SOLID = np.array((0.05, -0.02, np.pi / 2, 0, 0.9, *TURNED, 0.42, 0.38, 0.35))
SQUARE = ((-0.1, -0.1), (0.15, -0.1), (0.15, 0.1), (-0.1, 0.1))
# The CoM is 3 and 2 cm from the foot: the foot's own torque holds it, within the polygon.
LEANING_PLANAR = np.array((0.05, np.pi / 2 - 0.03, 0.9, 0.4, 0.35))
LEANING_SOLID = UP_SOLID + np.array((0, 0, -0.03, 0.02, *np.zeros(8)))
HANGING = UP_PLANAR * np.array((1, -1, 1, 1, 1))
CASES = {
    "planar point": lambda: Lqr(PLANAR, UP_PLANAR),
    "planar foot": lambda: Lqr(PLANAR, LEANING_PLANAR, True, LawBounds(polygon=(-0.1, 0.15))),
    "planar hanging": lambda: Lqr(PLANAR, HANGING, bounds=LawBounds(leg_force=(0.0, 1e9))),
    "solid point": lambda: Lqr(SOLID, UP_SOLID),
    "solid foot": lambda: Lqr(SOLID, LEANING_SOLID, True, LawBounds(polygon=SQUARE)),
}


def rate(law: Lqr, y: Array) -> Array:
    """Return dy/dt of the closed loop, y = (small dq, v) about rest without the CoP."""
    n, size = len(y) // 2, len(law.model.V)
    dq, v = np.zeros(size), np.zeros(size)
    dq[-n:], v[-n:] = y[:n], y[n:]
    if isinstance(law.model, SolidRmp):
        q = np.concatenate((law.q0[:5] + dq[:5], np.zeros(4), law.q0[9:] + dq[8:]))
        q[5:9] = (Rotation.from_quat(law.q0[5:9]) * Rotation.from_rotvec(dq[5:8])).as_quat()
    else:
        q = law.q0 + dq
    a = law.model.forward_dynamics(q, v, law.command(q, v, 0.0).force)
    return np.concatenate((v[-n:], a[-n:]))


@pytest.mark.parametrize("case", ["planar point", "planar foot", "solid point", "solid foot"])
def test_the_loop_is_what_the_riccati_equation_promises(case: str) -> None:
    """Jacobian of the closed loop by central differences of the full dynamics."""
    law = CASES[case]()
    A, B = law.open_loop
    n, h = len(A), 1e-5
    jacobian = np.column_stack(
        [(rate(law, h * e) - rate(law, -h * e)) / (2 * h) for e in np.eye(n)]
    )
    closed = A - B @ law.gain
    # Third derivatives times h^2 / 6, on entries up to some thousand.
    np.testing.assert_allclose(jacobian, closed, rtol=0, atol=1e-6 * np.abs(closed).max())
    # The slowest mode is due to the lengths' weights, sqrt(g / r_l) = 3.3 1/s.
    assert np.linalg.eigvals(jacobian).real.max() < -1.5


@pytest.mark.parametrize("case", CASES)
def test_riccati_residual_and_optimality(case: str) -> None:
    law = CASES[case]()
    A, B = law.open_loop
    rng = np.random.default_rng(0)
    errors, efforts = rng.uniform(0.1, 2.0, len(A)), rng.uniform(1.0, 50.0, B.shape[1])
    chosen = Lqr(law.model, law.q0, law.foot, law.bounds, errors, efforts)
    K, P = chosen.gain, chosen.cost
    Q, R = np.diag(errors**-2.0), np.diag(efforts**-2.0)
    np.testing.assert_allclose(R @ K, B.T @ P, rtol=0, atol=1e-8 * np.abs(B.T @ P).max())
    residual = A.T @ P + P @ A - K.T @ R @ K + Q
    np.testing.assert_allclose(residual, 0.0, atol=1e-7 * np.abs(A.T @ P).max())
    # The cost of any gain nearby, by the Lyapunov equation of its closed loop, is greater.
    for _ in range(5):
        other = K * (1.0 + 0.02 * rng.normal(size=K.shape))
        closed = A - B @ other
        if np.linalg.eigvals(closed).real.max() >= 0.0:
            continue
        cost = solve_continuous_lyapunov(closed.T, -(Q + other.T @ R @ other))
        assert np.trace(cost) > np.trace(P)


def with_inertia(law: Lqr, offset: Array) -> object:
    """Return the law, told radii that are ``offset`` too small: the plant's inertia is greater."""

    class Deceived:
        model = law.model

        def command(self, q: Array, v: Array, time: float) -> PendulumCommand:
            q = q.copy()
            q[-len(offset) :] -= offset
            return law.command(q, v, time)

    return Deceived()


@pytest.mark.slow
@pytest.mark.parametrize(("mass", "inertia"), [*itertools.product((0.8, 1.2), (0.8, 1.2))])
@pytest.mark.parametrize(
    ("kind", "foot"), [*itertools.product(("planar", "solid"), (False, True))], ids=str
)
def test_it_holds_with_wrong_mass_and_inertia(kind, foot, mass, inertia) -> None:
    """From 0.1 rad of the leg with both 20 percent off; on a foot the leg may stray by less."""
    model, q0 = (PLANAR, UP_PLANAR) if kind == "planar" else (SOLID, UP_SOLID)
    polygon = None if not foot else ((-0.05, 0.2) if kind == "planar" else SQUARE)
    bounds = LawBounds(polygon=polygon)
    law = Lqr(model, q0, foot, bounds)
    radii = 1 if kind == "planar" else 3
    offset = (np.sqrt(inertia / mass) - 1.0) * q0[-radii:]
    q = q0.copy()
    q[-radii:] += offset
    leg = slice(1, 2) if kind == "planar" else slice(2, 4)
    q[leg] += (0.1,) if kind == "planar" else (0.08, -0.06)
    plant = type(model)(mass * M, G)
    true = plant.inertia(q) / model.inertia(q0)
    np.testing.assert_allclose(true, inertia, rtol=1e-12)
    still = np.zeros(len(model.V))
    run = simulate(with_inertia(law, offset), q, still, 6.0, dt=4e-3, plant=plant, bounds=bounds)  # type: ignore[arg-type]
    assert run.ending is Ending.COMPLETE, run.note
    end = run.q[-1]
    assert np.abs(end[leg] - q0[leg]).max() < 2e-3
    assert np.abs(run.v[-1]).max() < 0.03
    # Without an integral term the leg settles where the missing fifth of the weight puts it.
    assert abs(end[leg.stop] - q0[leg.stop]) < 0.012
    # Rounding of the CoP when at its edge.
    assert run.cop_violation < (1e-9 if foot else 1e-12)


def test_state_is_the_rotation_and_the_rates_in_the_axes_at_rest() -> None:
    law = Lqr(SOLID, UP_SOLID)
    vector, w = np.array((0.7, -1.1, 0.4)), np.array((1.0, 2.0, -3.0))
    q, v = UP_SOLID.copy(), np.zeros(11)
    turn = Rotation.from_rotvec(vector)
    for sign in (1.0, -1.0):
        q[5:9] = sign * (Rotation.from_quat(TURNED) * turn).as_quat()
        v[5:8] = w
        x = law.state(q, v)
        np.testing.assert_allclose(x[3:6], vector, atol=1e-12)
        np.testing.assert_allclose(x[12:15], turn.apply(w), atol=1e-12)
        assert np.count_nonzero(np.abs(x) > 1e-12) == 6
    assert len(law.states) == 18
    assert law.inputs == ("f_l", "tau_1", "tau_2", "tau_3", "f_1", "f_2", "f_3")
    # Masses turned right over push on the leg as before: the torque in space stays.
    q[2] += 0.01
    leaning = law.command(q, np.zeros(11), 0.0).force
    torque = Rotation.from_quat(q[5:9]).apply(leaning[3:6])
    x = law.state(q, np.zeros(11))
    wanted = Rotation.from_quat(TURNED).apply(-(law.gain @ x)[1:4])
    np.testing.assert_allclose(torque, wanted, atol=1e-9)


@pytest.mark.parametrize("kind", ["planar", "solid"])
def test_torques_are_clipped_to_bounds(kind: str) -> None:
    """A lean that the foot alone cannot hold; the wheel's and the leg's limits are low."""
    polygon = (-0.05, 0.1) if kind == "planar" else SQUARE
    bounds = LawBounds(polygon=polygon, wheel_torque=5.0, leg_force=(0.0, 1.1 * M * G))
    model, q0 = (PLANAR, UP_PLANAR) if kind == "planar" else (SOLID, UP_SOLID)
    law = Lqr(model, q0, True, bounds)
    q = q0.copy()
    q[1 if kind == "planar" else 2] -= 0.08
    q[model.Q.index("r_l")] -= 0.2
    command = law.command(q, np.zeros(len(model.V)), 0.0)
    assert command.phase == "clipped"
    assert command.ok
    run = simulate(law, q, np.zeros(len(model.V)), 0.2, bounds=bounds)
    margins = run.margins()
    assert margins["wheel_torque"] == 0.0
    assert margins["leg_force"] == 0.0
    # The CoP is a margin inside the edge, but for what it moves while a command is held.
    assert margins["cop"] == pytest.approx(bounds.cop_margin, abs=2e-6)
    within = float(np.abs(np.array(polygon)).max()) - bounds.cop_margin
    assert np.abs(run.cop[0]).max() == pytest.approx(within, abs=1e-9)


def test_a_foot_beyond_its_edge_is_told() -> None:
    law = Lqr(PLANAR, UP_PLANAR, True, LawBounds(polygon=(-0.1, 0.2)))
    # The foot stands 0.15 m out; torque of the foot is wanted that takes the CoP farther.
    q = UP_PLANAR + np.array((0.3, 0, 0, 0, 0))
    command = law.command(q, np.array((0, -0.1, 0, 0, 0)), 0.0)
    assert command.force[0] == 0.0
    assert not command.ok
    assert "CoP would leave the support by 0.15 m" in command.note


def test_a_ground_that_would_have_to_pull_is_told() -> None:
    law = Lqr(PLANAR, UP_PLANAR, True, LawBounds(polygon=(-0.1, 0.2)))
    command = law.command(UP_PLANAR + np.array((0, 0, 0.5, 0, 0)), np.zeros(5), 0.0)
    assert not command.ok
    assert "pull" in command.note


@pytest.mark.parametrize(
    ("make", "words"),
    [
        # 20 * 9.81 * 0.9 * sin(0.03) = 5.2966
        (lambda: Lqr(PLANAR, LEANING_PLANAR), "would have to give 5.297 N m"),
        (lambda: Lqr(SOLID, LEANING_SOLID), "point contact"),
        (lambda: Lqr(PLANAR, UP_PLANAR, True), "without extent"),
        (lambda: Lqr(PLANAR, UP_PLANAR, True, LawBounds(polygon=SQUARE)), "least x"),
        (lambda: Lqr(SOLID, UP_SOLID, True, LawBounds(polygon=(0, 1))), "corners"),
        (
            # The CoM is at 0.05 + 0.9 sin(0.03) = 0.077.
            lambda: Lqr(PLANAR, LEANING_PLANAR, True, LawBounds(polygon=(0.0, 0.06))),
            "0.017 m out of the support",
        ),
        (lambda: Lqr(PlanarRmp(M, 0.0), UP_PLANAR), "no input reaches"),
        (lambda: Lqr(PLANAR, UP_PLANAR, errors=np.zeros(8)), "positive"),
        (lambda: Lqr(PLANAR, UP_PLANAR, errors=np.ones(10)), "errors: expected shape"),
        (lambda: Lqr(PLANAR, UP_PLANAR, efforts=np.ones(4)), "efforts: expected shape"),
        (lambda: Lqr(PLANAR, UP_PLANAR[:4]), "q0: expected shape"),
        (lambda: Lqr(PLANAR, UP_PLANAR * (1, 1, 1, 1, 0)), "no inertia"),
    ],
)
def test_nonsense_is_refused(make: Callable[[], Lqr], words: str) -> None:
    with pytest.raises(InvalidInputError, match=words):
        make()
