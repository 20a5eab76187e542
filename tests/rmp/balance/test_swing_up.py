"""The swing-up: its equations against the full dynamics, its region, and whole runs."""

import math

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.rmp.balance.law import LawBounds, PendulumCommand
from wbc.rmp.balance.record import Ending, Simulation
from wbc.rmp.balance.simulate import simulate
from wbc.rmp.balance.swing_up import SwingUp
from wbc.rmp.planar import Held, PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array

G = 9.81
# Mass, leg, wheel: inertias of the wheel from a hundredth to half of the leg's.
BODIES = {
    "humanoid": (20.0, 0.9, 0.35),
    "desk": (1.0, 0.125, 0.04),
    "small wheel": (5.0, 0.5, 0.05),
    "large wheel": (50.0, 1.0, 0.7),
}


def make(
    body: str, ratio: float, rate: float = math.inf, dt: float = 2e-3
) -> tuple[SwingUp, Array]:
    """Return the law for a torque as a part of M g r_l, and the hanging rest."""
    mass, length, radius = BODIES[body]
    bounds = LawBounds(wheel_torque=ratio * mass * G * length, wheel_rate=rate)
    law = SwingUp(PlanarRmp(mass, G), length, radius, bounds, dt)
    return law, np.array((0.0, -np.pi / 2, length, 0.0, radius))


def swing(law: SwingUp, q: Array, duration: float) -> Simulation:
    return simulate(law, q, np.zeros(5), duration, dt=law.dt, bounds=law.bounds, pivot=True)


def lean_of(run: Simulation) -> Array:
    """Return how far from upright [rad] (n + 1,)."""
    return np.abs((run.q[:, 1] + np.pi / 2) % (2 * np.pi) - np.pi)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "ratio"), [*((body, 0.14) for body in BODIES), ("humanoid", 0.05)]
)
def test_from_rest_hanging_to_rest_upright(body: str, ratio: float) -> None:
    """0.14 is Block, Astrom and Spong's wheel: 10.8 of 78.4 1/s^2. It stays within 1 degree."""
    law, q = make(body, ratio)
    period = 2 * math.pi / law.held.frequency
    # The pump takes some 0.55 / ratio periods; then the wheel is slowed down at the lean's pace.
    run = swing(law, q, (0.6 / ratio + 4.0) * period + 14.0)
    assert run.ending is Ending.COMPLETE
    assert run.ok.all()
    begin = run.phase.index("hold")
    assert run.phase[0] == "pump"
    assert "catch" in run.phase[:begin]
    assert set(run.phase[begin:]) == {"hold"}
    # A catch that begins is never lost.
    assert "pump" not in run.phase[run.phase.index("catch") :]
    held = run.time >= run.time[begin]
    assert run.ended_at - run.time[begin] > 5.0
    assert np.degrees(lean_of(run)[held]).max() < 1.0
    # Momentum leaves the wheel all the time, and is gone at the end but for what a lean of
    # 0.7 degrees has not got rid of yet.
    momentum = np.abs(run.momentum()[held, 0])
    assert momentum[-1] < 0.5 * momentum[0]
    assert (np.diff(momentum[:: len(momentum) // 8]) <= 1e-9).all()
    assert run.margins()["wheel_torque"] >= 0.0


# The weakest torques for commands every 4 and 10 ms: 0.005, and 3 (w dt)^2.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "ratio", "dt"),
    [
        *(("humanoid", 0.005, 4e-3), ("desk", 0.005, 4e-3), ("small wheel", 0.005, 4e-3)),
        *(("desk", 0.0236, 1e-2), ("large wheel", 0.003, 1e-2)),
    ],
)
def test_weak_torques_suffice_in_discrete_time(body: str, ratio: float, dt: float) -> None:
    """Forces right at the beginning of a step only cost more energy than these torques bring."""
    law, q = make(body, ratio, dt=dt)
    period = 2 * math.pi / law.held.frequency
    run = swing(law, q, (0.6 / ratio + 10.0) * period)
    assert run.ending is Ending.COMPLETE
    assert run.phase[-1] == "hold"
    assert "pump" not in run.phase[run.phase.index("catch") :]
    # What the forces lag is made up for: to second order the length stays.
    off = np.abs(run.q[:, 2] / law.length - 1.0).max()
    assert off < 0.4 * (law.held.frequency * dt) ** 2


@pytest.mark.slow
def test_rate_of_the_wheel_goes_to_zero() -> None:
    law, q = make("humanoid", 0.14)
    run = swing(law, q, 45.0)
    assert abs(run.v[-1, 3]) < 1e-4
    assert lean_of(run)[-1] < 1e-6


@pytest.mark.slow
def test_the_rate_of_the_wheel_is_bounded() -> None:
    """7 rad/s, where the leg alone swings through with 6.6; without a bound it reaches 11."""
    law, q = make("humanoid", 0.14, rate=7.0, dt=1e-3)
    run = swing(law, q, 25.0)
    assert run.margins()["wheel_rate"] > 0.0
    assert run.phase[-1] == "hold"
    assert np.degrees(lean_of(run)[-5000:]).max() < 1.0
    free, q = make("humanoid", 0.14)
    assert np.abs(swing(free, q, 8.0).v[:, 3]).max() > 10.0


def test_the_unstable_part_moves_as_derived() -> None:
    """s' = w (cos(x/2) s - u) and e' = -u x', by differences along the full equations' motion."""
    law, _ = make("humanoid", 0.3)
    rng = np.random.default_rng(3)
    held = Held(law.model, law.length, law.radius)  # in continuous time
    w, h = held.frequency, 1e-6
    for _ in range(20):
        q = np.array((0, rng.uniform(-np.pi, np.pi) + np.pi / 2, 0.9, 0.0, 0.35))
        v = np.array((0, rng.normal() * 4, 0, rng.normal() * 4, 0))
        x = (q[1] + np.pi / 2) % (2 * np.pi) - np.pi
        torque = rng.uniform(-1, 1) * held.weight_torque
        a = law.model.forward_dynamics(q, v, held.forces(q, v, torque))
        np.testing.assert_allclose(a[[2, 4]], 0.0, atol=1e-9)
        u = torque / held.weight_torque
        ends = [(q + t * v + t * t / 2 * a, v + t * a) for t in (h, -h)]
        s_rate = (law.unstable_part(*ends[0]) - law.unstable_part(*ends[1])) / (2 * h)
        e_rate = (law.energy(*ends[0]) - law.energy(*ends[1])) / (2 * h)
        s = law.unstable_part(q, v)
        # Cancellation in differences of 1e-6 s.
        assert s_rate == pytest.approx(w * (math.cos(x / 2) * s - u), abs=1e-7)
        assert e_rate == pytest.approx(-u * v[1], abs=1e-7)
        assert law.energy(q, v) == pytest.approx(s * (s - 4 * math.sin(x / 2)) / 2, abs=1e-12)


@pytest.mark.slow
def test_region_of_attraction() -> None:
    """From anywhere with |s| below half the torque ratio the catch succeeds, with any momentum;
    above the ratio, leaning, full torque is not enough: the leg falls through."""
    law, _ = make("humanoid", 0.1)
    w = law.held.frequency
    rng = np.random.default_rng(5)
    for _ in range(12):
        x, s = rng.uniform(-2.8, 2.8), rng.uniform(-0.0499, 0.0499)
        leg_rate = w * (s - 2 * math.sin(x / 2))
        v = np.array((0, leg_rate, 0, rng.uniform(-30, 30) - leg_rate, 0))
        q = np.array((0, np.pi / 2 + x, 0.9, 0.0, 0.35))
        run = simulate(law, q, v, 4.0, dt=2e-3, pivot=True)
        assert "pump" not in run.phase
        assert np.degrees(lean_of(run)[-1]) < 1.0

    class Full:
        model = law.model

        def command(self, q: Array, v: Array, time: float) -> PendulumCommand:
            return PendulumCommand(law.held.forces(q, v, law.bounds.wheel_torque), np.zeros(1))

    for s, holds in ((0.099, True), (0.101, False)):
        q = np.array((0, np.pi / 2 + s, 0.9, 0.0, 0.35))
        run = simulate(Full(), q, np.zeros(5), 2.0, pivot=True)
        assert bool(run.v[-1, 1] < 0.0) is holds


@pytest.mark.slow
def test_other_plants_and_starts() -> None:
    """Mass 20 percent off, and starts that already swing or spin round."""
    law, q = make("humanoid", 0.14)
    for mass in (16.0, 24.0):
        run = simulate(law, q, np.zeros(5), 20.0, dt=2e-3, plant=PlanarRmp(mass), pivot=True)
        assert run.phase[-1] == "hold"
        assert np.degrees(lean_of(run)[-1]) < 1.0
    rng = np.random.default_rng(7)
    for _ in range(4):
        start = q + np.array((0, rng.uniform(-3, 3), 0.02, 1.0, -0.02))
        v = np.array((0, 4 * rng.normal(), 0.1, 10 * rng.normal(), -0.1))
        run = simulate(law, start, v, 14.0, dt=2e-3, pivot=True)
        assert run.phase[-1] == "hold"
        assert np.degrees(lean_of(run)[-1]) < 1.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"bounds": LawBounds()}, "wheel_torque must be finite"),
        ({"bounds": LawBounds(wheel_torque=20.0, wheel_angle=1.0)}, "without end"),
        # 2 sqrt(9.81 / 0.9) = 6.603
        ({"bounds": LawBounds(wheel_torque=20.0, wheel_rate=6.0)},
         "6.603 rad/s.* 0.603 too little"),
        ({"model": PlanarRmp(20.0, 0.0)}, "gravity"),
        ({"model": SolidRmp(20.0)}, "needs a PlanarRmp"),
        ({"length": 0.0}, "length"),
        ({"radius": np.nan}, "radius"),
        ({"dt": -1.0}, "dt"),
        ({"dt": 0.02}, r"too long to hold the masses' radius; at most 0\.0167 s"),
        # 3 (w dt)^2 = 0.00327, and M g r_l = 176.6 N m.
        ({"dt": 0.01, "bounds": LawBounds(wheel_torque=0.5)}, r"at most 0\.00931 s, or 0\.577 N m"),
    ],
)  # fmt: skip
def test_nonsense_is_refused(change: dict[str, object], words: str) -> None:
    given: dict[str, object] = {
        "model": PlanarRmp(20.0, G),
        "length": 0.9,
        "radius": 0.35,
        "bounds": LawBounds(wheel_torque=20.0),
    }
    with pytest.raises(InvalidInputError, match=words):
        SwingUp(**(given | change))  # type: ignore[arg-type]
