"""Balance on a point: what the hip may do, the chain of integrators, and how far it catches."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.region_of_attraction import lean_grid, rest_error
from wbc.errors import InvalidInputError
from wbc.rmp.balance.law import LawBounds
from wbc.rmp.balance.lqr import Lqr
from wbc.rmp.balance.record import Ending, Simulation
from wbc.rmp.balance.simulate import simulate
from wbc.rmp.balance.stabiliser import PointStabiliser, StabiliserGains
from wbc.rmp.ground import centre_of_pressure
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array

M, G, Z, TORQUE = 35.0, 9.81, 0.7, 50.0
RADII = np.full(3, 0.3)
BOUNDS = LawBounds(wheel_torque=TORQUE, leg_force=(50.0, 600.0))
REST = np.array((0.05, -0.02, np.pi / 2, 0.0, Z, 0.0, 0.0, 0.0, 1.0, *RADII))
# Largest lean at rest that the torque can turn back: sin(lean) Z = tau / (M g).
LIMIT = float(np.arcsin(TORQUE / (M * G) / Z))


@pytest.fixture(scope="module")
def law() -> PointStabiliser:
    return PointStabiliser(SolidRmp(M, G), BOUNDS, Z, RADII)


def random_state(seed: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    q = REST.copy()
    q[2:4] += rng.uniform(-0.6, 0.6, 2)
    q[4] *= rng.uniform(0.7, 1.3)
    q[5:9] = Rotation.random(random_state=seed).as_quat()
    q[9:] = rng.uniform(0.15, 0.4, 3)
    v = np.concatenate((np.zeros(2), rng.uniform(-2.0, 2.0, 9)))
    return q, v


def run(
    law: PointStabiliser | Lqr, q: Array, v: Array | None = None, time: float = 10
) -> Simulation:
    def settled(t: float, q: Array, v: Array, command: object) -> bool:
        return bool(rest_error(np.concatenate((q, v))[None], REST)[0] < 0.02)

    start = np.zeros(11) if v is None else v
    return simulate(law, q, start, time, dt=2e-3, bounds=BOUNDS, stop=settled)


def came_to_rest(simulation: Simulation) -> bool:
    last = np.concatenate((simulation.q[-1], simulation.v[-1]))[None]
    return simulation.ending is Ending.COMPLETE and bool(rest_error(last, REST)[0] < 0.03)


# ------------------------------------------------------------------ one command


@pytest.mark.parametrize("seed", range(15))
def test_only_the_hip_acts_and_the_cop_stays_under_the_leg(law: PointStabiliser, seed: int) -> None:
    q, v = random_state(seed)
    force = law.command(q, v, 0.0).force
    reaction = law.model.hip_torque(q, force[3:6])
    # Rounding of forces of some hundred newtons.
    np.testing.assert_allclose(force[:2], reaction[:2], atol=1e-9)
    a = law.model.forward_dynamics(q, v, force)
    push = law.model.ground_reaction(q, v, a)
    c, _ = law.model.com(q, v)
    if push[2] > 1.0:
        cop = centre_of_pressure(c, push, law.model.momentum_rate(q, force))
        np.testing.assert_allclose(cop[:2], q[:2], atol=1e-9)
    assert np.abs(force[3:6]).max() <= TORQUE * (1 + 1e-12)
    assert 50.0 - 1e-9 <= force[2] <= 600.0 + 1e-9


def test_at_rest_it_holds(law: PointStabiliser) -> None:
    force = law.command(REST, np.zeros(11), 0.0).force
    np.testing.assert_allclose(force, law.model.holding_force(REST), atol=1e-9)


# ------------------------------------------------------------------ the chain


def test_momentum_and_com_are_the_chain_of_integrators_that_the_law_is_built_on(law) -> None:
    (start,) = lean_grid(REST, [0.08], [-0.06])
    motion = simulate(law, start[:12], start[12:], 1.0, dt=1e-3, bounds=BOUNDS)
    k_P = np.array([law.model.momenta(q, v)[1] for q, v in zip(motion.q, motion.v, strict=True)])
    place = motion.com()[0][:, :2] - REST[:2]
    # About the foot only gravity acts; trapezoids of 1 ms are good to 1e-6 of the change.
    for momentum, way, sign in ((k_P[:, 1], place[:, 0], 1.0), (k_P[:, 0], place[:, 1], -1.0)):
        rate = sign * M * G * way
        grown = np.concatenate(((0.0,), np.cumsum((rate[1:] + rate[:-1]) / 2) * 1e-3))
        np.testing.assert_allclose(momentum - momentum[0], grown, atol=1e-4)


# ------------------------------------------------------------------ how far it catches


@pytest.mark.slow
def test_nearly_all_leans_that_any_law_could_catch_are_caught(law: PointStabiliser) -> None:
    for turn in np.radians((0.0, 30.0, 90.0, 200.0)):
        lean = 0.97 * LIMIT * np.array((np.cos(turn), np.sin(turn)))
        (start,) = lean_grid(REST, lean[:1], lean[1:])
        found = run(law, start[:12], start[12:])
        assert came_to_rest(found), f"{np.degrees(turn):.0f} degrees: {found.note}"
        assert found.margins()["wheel_torque"] >= -1e-9


def test_beyond_the_torque_no_law_helps(law: PointStabiliser) -> None:
    (start,) = lean_grid(REST, [1.05 * LIMIT], [0.0])
    assert run(law, start[:12], start[12:]).ending is Ending.FELL
    lqr = Lqr(law.model, REST, bounds=BOUNDS)
    assert run(lqr, start[:12], start[12:]).ending is Ending.FELL


@pytest.mark.parametrize("rate", [15.0, -25.0])
def test_masses_that_spin_fast_are_stopped_where_a_regulator_falls(law, rate: float) -> None:
    v = np.zeros(11)
    v[6] = rate
    assert came_to_rest(run(law, REST, v))
    assert run(Lqr(law.model, REST, bounds=BOUNDS), REST, v).ending is Ending.FELL


def test_masses_come_back_from_any_orientation(law: PointStabiliser) -> None:
    for vector in ((0.0, 2.5, 0.0), (1.0, -1.0, 1.5), (0.0, 0.0, 3.0)):
        q = REST.copy()
        q[5:9] = Rotation.from_rotvec(vector).as_quat()
        assert came_to_rest(run(law, q)), vector


def test_leg_and_radii_come_back_too_and_unlike_radii_do_no_harm() -> None:
    radii = np.array((0.35, 0.25, 0.3))
    law = PointStabiliser(SolidRmp(M, G), BOUNDS, Z, radii)
    (start,) = lean_grid(REST, [0.1], [0.05])
    start[4], start[9:12] = 0.6, (0.25, 0.3, 0.2)
    found = simulate(law, start[:12], start[12:], 8.0, dt=2e-3, bounds=BOUNDS)
    assert found.ending is Ending.COMPLETE
    rest = np.array((*REST[:9], *radii))
    last = np.concatenate((found.q[-1], found.v[-1]))[None]
    assert rest_error(last, rest)[0] < 0.02


# ------------------------------------------------------------------ what is refused


@pytest.mark.parametrize(
    ("bounds", "height", "radii", "message"),
    [
        (LawBounds(), Z, RADII, "wheel_torque"),
        (LawBounds(wheel_torque=1.0, wheel_angle=0.5), Z, RADII, "MomentumQp"),
        (LawBounds(wheel_torque=1.0, wheel_rate=0.5), Z, RADII, "MomentumQp"),
        (BOUNDS, 0.0, RADII, "height"),
        (BOUNDS, Z, (0.3, 0.0, 0.3), "radii"),
    ],
)
def test_unusable_arguments_are_refused(bounds, height, radii, message) -> None:
    with pytest.raises(InvalidInputError, match=message):
        PointStabiliser(SolidRmp(M, G), bounds, height, radii)


def test_without_gravity_there_is_nothing_to_balance() -> None:
    with pytest.raises(InvalidInputError, match="gravity"):
        PointStabiliser(SolidRmp(M, 0.0), BOUNDS, Z, RADII)


@pytest.mark.parametrize("gains", [{"capture": 0.0}, {"lean": 1.0}, {"yaw": np.nan}])
def test_unusable_gains_are_refused(gains: dict[str, float]) -> None:
    with pytest.raises(InvalidInputError):
        StabiliserGains(**gains)


@pytest.mark.parametrize("theta", [0.0, np.pi, -np.pi / 2])
def test_a_leg_on_or_below_the_ground_still_gets_numbers(law, theta: float) -> None:
    q = REST.copy()
    q[2] = theta
    assert np.isfinite(law.command(q, np.ones(11), 0.0).force).all()
