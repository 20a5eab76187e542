"""The static lean against the closed form of a wheel under constant torque, and its own run."""

import math

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.rmp.balance.law import LawBounds, PendulumCommand
from wbc.rmp.balance.record import Ending
from wbc.rmp.balance.simulate import Blow, Simulation, simulate
from wbc.rmp.balance.static_lean import StaticLean
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array

G, LENGTH, RADIUS = 9.81, 0.9, 0.35
RATE, ANGLE = LawBounds(wheel_rate=30.0), LawBounds(wheel_angle=20.0)
# dq and v: leg, wheel, length and radius all off.
OFF = (np.array((0, 0.02, 0.01, 0.3, 0.003)), np.array((0, 0.1, -0.05, 0.4, 0.02)))


def lean(mass: float, degrees: float, bounds: LawBounds) -> tuple[StaticLean, Array]:
    angle = math.radians(degrees)
    law = StaticLean(PlanarRmp(mass, G), angle, LENGTH, RADIUS, bounds)
    return law, np.array((0.0, angle, LENGTH, 0.0, RADIUS))


def until_saturated(law: StaticLean, q: Array, v: Array, longest: float) -> Simulation:
    def stop(time: float, q: Array, v: Array, command: PendulumCommand) -> bool:
        return command.phase == "saturated"

    return simulate(law, q, v, longest, bounds=law.bounds, fallen=0.0, stop=stop)


@pytest.mark.slow
@pytest.mark.parametrize("mass", [2.0, 80.0])
@pytest.mark.parametrize("degrees", [70.0, 84.0, 100.0])
def test_the_leg_stays_until_the_wheel_is_at_its_limit(mass: float, degrees: float) -> None:
    """Time to the limit, at rest and level: rate / a and sqrt(2 angle / a), a = tau / (M r^2)."""
    a = G * LENGTH * abs(math.cos(math.radians(degrees))) / RADIUS**2
    for bounds, time in ((RATE, 30.0 / a), (ANGLE, math.sqrt(2 * 20.0 / a))):
        law, q = lean(mass, degrees, bounds)
        still = np.zeros(5)
        assert law.time_left(q, still) == pytest.approx(time, rel=1e-12)
        torque = law.command(q, still, 0.0).force[2]
        assert torque == pytest.approx(-mass * G * LENGTH * math.cos(law.angle), rel=1e-12)
        run = until_saturated(law, q, still, 2.0 * time)
        # A step of 1 ms, and the radius that lags behind the growing centrifugal force.
        assert run.ended_at == pytest.approx(time, rel=2e-3, abs=1e-3)
        assert run.ok.all()
        assert np.degrees(np.abs(run.q[:, 1] - law.angle)).max() < 1e-6
        # A point contact: the CoP is where the leg stands, though the CoM is beyond.
        assert run.cop_violation < 1e-12
        assert abs(run.com()[0][:, 0]).min() > 0.09


@pytest.mark.slow
@pytest.mark.parametrize("bounds", [RATE, ANGLE])
@pytest.mark.parametrize("degrees", [75.0, 85.0, 95.0, 110.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_errors_decay_and_the_time_left_counts_them(bounds, degrees, sign) -> None:
    law, q = lean(20.0, degrees, bounds)
    q, v = q + sign * OFF[0], sign * OFF[1]
    predicted = law.time_left(q, v)
    run = until_saturated(law, q, v, 2.0 * predicted)
    assert run.note.startswith("stopped")
    assert predicted == pytest.approx(run.ended_at, rel=0.01)
    # As (1 + 10 t) e^(-10 t) of some 2 degrees.
    late = run.time > 0.8
    assert np.degrees(np.abs(run.q[late, 1] - law.angle)).max() < 0.1
    # From half-way on there is nothing left to decay, and the same holds.
    half = int(len(run.time) / 2)
    left = law.time_left(run.q[half], run.v[half])
    assert left == pytest.approx(run.ended_at - run.time[half], rel=0.01, abs=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("off", "accuracy"), [(0.035, 1.4e-3), (0.4, 1.4e-2)])
def test_the_time_left_is_known_less_well_from_far_off(off, accuracy, sign) -> None:
    """2 degrees and 23: what is left out is squares of errors. The figures of docs/pendulum.md."""
    worst = 0.0
    for degrees in (75.0, 85.0, 95.0, 110.0):
        for bounds in (RATE, ANGLE):
            law, q = lean(20.0, degrees, bounds)
            q[1] += sign * off
            predicted = law.time_left(q, np.zeros(5))
            run = until_saturated(law, q, np.zeros(5), 2.0 * predicted)
            assert run.note.startswith("stopped")
            worst = max(worst, abs(predicted / run.ended_at - 1.0))
    assert worst < accuracy


def test_the_mean_torque_is_the_static_one() -> None:
    """k_P' = -M g r_l cos: over a run with a push, the wheel takes what gravity gives."""
    law, q = lean(20.0, 80.0, LawBounds())
    run = simulate(law, q, np.zeros(5), 4.0, pushes=[Blow(1.0, (1.5, 0.0))])
    assert np.degrees(np.abs(run.q[-1, 1] - law.angle)) < 1e-3
    late = run.time[:-1] > 3.0
    np.testing.assert_allclose(run.force[late, 2], law.static_torque, rtol=1e-6)


def test_after_saturation_it_says_so_and_carries_the_wheel_along() -> None:
    law, q = lean(20.0, 85.0, RATE)
    run = simulate(law, q, np.zeros(5), 6.0, bounds=law.bounds)
    assert run.ending is Ending.FELL
    at = run.phase.index("saturated")
    assert run.time[at] == pytest.approx(law.time_left(q, np.zeros(5)), rel=0.01)
    assert run.ok[:at].all()
    assert not run.ok[at]
    note = law.command(run.q[at], run.v[at], 0.0).note
    assert "greatest rate, 30 rad/s" in note
    # For the first half second of the fall the rate stays where it is, within a thousandth.
    assert np.abs(run.v[: at + 500, 3]).max() < 30.0 * 1.002
    assert law.time_left(run.q[at], run.v[at]) == 0.0
    law, q = lean(20.0, 85.0, ANGLE)
    q[3] = 20.0
    # Carrying the wheel along takes 17.9 N m here: more than there is.
    bounds = LawBounds(wheel_rate=30.0, wheel_torque=16.0)
    falling = q + np.array((0, -0.8, 0, -20.0, 0))
    spinning = np.array((0, -1.0, 0, -30.0, 0))
    weak = StaticLean(law.model, law.angle, LENGTH, RADIUS, bounds).command(falling, spinning, 0.0)
    assert weak.phase == "saturated"
    assert weak.force[2] == -16.0
    assert "greatest angle, 20 rad" in law.command(q, np.zeros(5), 0.0).note
    assert law.time_left(q, np.zeros(5)) == 0.0


def test_a_balanced_leg_lasts_for_ever_or_as_long_as_the_wheel_turns() -> None:
    law, q = lean(20.0, 90.0, ANGLE)
    # The cosine of a rounded right angle is 6e-17.
    assert law.time_left(q, np.zeros(5)) > 1e6
    v = np.array((0.0, 0.0, 0.0, -4.0, 0.0))
    assert law.time_left(q, v) == pytest.approx(20.0 / 4.0, rel=1e-6)
    law, q = lean(20.0, 80.0, LawBounds())
    assert law.time_left(q, v) == math.inf


def test_limits_are_kept_and_told() -> None:
    """Static torque 20 * 9.81 * 0.9 * cos(80 degrees) = 30.7 N m."""
    bounds = LawBounds(wheel_torque=35.0, leg_force=(0.0, 200.0))
    law, q = lean(20.0, 80.0, bounds)
    off = q - np.array((0, 0.03, 0, 0, 0))
    clipped = law.command(off, np.zeros(5), 0.0)
    assert abs(clipped.force[2]) == 35.0
    assert not clipped.ok
    assert "the wheel would have to give" in clipped.note
    short = law.command(q - np.array((0, 0, 0.05, 0, 0)), np.zeros(5), 0.0)
    assert short.force[1] == 200.0
    assert "the leg would have to push" in short.note


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"angle": 0.0}, "must stand"),
        ({"angle": 3.2}, "must stand"),
        ({"length": -1.0}, "length"),
        ({"radius": 0.0}, "radius"),
        ({"rate": 0.0}, "rate"),
        ({"model": SolidRmp(20.0)}, "needs a PlanarRmp"),
        # 20 * 9.81 * 0.9 * cos(1) = 95.41
        ({"bounds": LawBounds(wheel_torque=50.0)}, "takes 95.41 N m of the wheel, 45.41 more"),
    ],
)
def test_nonsense_is_refused(change: dict[str, object], words: str) -> None:
    given: dict[str, object] = {
        "model": PlanarRmp(20.0, G),
        "angle": 1.0,
        "length": LENGTH,
        "radius": RADIUS,
    }
    with pytest.raises(InvalidInputError, match=words):
        StaticLean(**(given | change))  # type: ignore[arg-type]
