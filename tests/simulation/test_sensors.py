"""What is measured: nothing changed without faults; noise as asked for; late and lost frames."""

import numpy as np
import pytest

from tests.conftest import load
from tests.simulation.idle import idle, in_the_air
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.simulation import Plant, Sensors
from wbc.validate import Array

QUIET = {"shapes": False}


def fallen(robot: Robot, count: int, **options: object) -> list[tuple[Array, Array] | None]:
    """Measurements before each of ``count`` steps from the standing posture, in free fall."""
    plant, found = in_the_air(robot, **options), []
    for _ in range(count):
        found.append(plant.measure())
        idle(plant)
    return found


def measured(plant: Plant) -> tuple[Array, Array]:
    found = plant.measure()
    assert found is not None
    return found


def test_without_faults_the_state_is_measured() -> None:
    plant = Plant(load("g1"))
    for seen, true in zip(measured(plant), plant.state(), strict=True):
        assert seen.tobytes() == true.tobytes()


def test_noise_has_the_spread_asked_for_and_no_bias() -> None:
    robot = load("g1")
    base = {"base_position_noise": 2e-3, "base_rotation_noise": 3e-3}
    base |= {"base_velocity_noise": 0.02, "base_rate_noise": 0.03}
    sensors = Sensors(position_noise=1e-3, velocity_noise=0.05, **base, seed=3)
    plant, errors_q, errors_v = in_the_air(robot, sensors=sensors), [], []
    for _ in range(400):
        (seen_q, seen_v), (true_q, true_v) = measured(plant), plant.state()
        errors_q.append(robot.difference(true_q, seen_q))
        errors_v.append(seen_v - true_v)
        idle(plant)
    for errors, spreads in (
        (np.array(errors_q), (2e-3, 3e-3, 1e-3)),
        (np.array(errors_v), (0.02, 0.03, 0.05)),
    ):
        for part, spread in zip((slice(0, 3), slice(3, 6), slice(6, None)), spreads, strict=True):
            sample = errors[:, part]
            # four standard errors of a mean and of a standard deviation over n samples
            assert np.abs(sample.mean()) < 4.0 * spread / np.sqrt(sample.size)
            assert sample.std() == pytest.approx(spread, rel=4.0 / np.sqrt(2 * sample.size))
        for k in (0, 4, 10):  # white: one period says nothing of the next
            correlation = np.corrcoef(errors[1:, k], errors[:-1, k])[0, 1]
            assert abs(correlation) < 4.0 / np.sqrt(len(errors))


def test_a_bias_stays_until_the_seed_changes() -> None:
    robot = load("g1")
    offsets = []
    for seed in (1, 1, 2):
        plant = Plant(robot, sensors=Sensors(position_bias=0.01, seed=seed), **QUIET)
        for _ in range(2):
            idle(plant)
            offsets.append(robot.difference(plant.state()[0], measured(plant)[0]))
    offsets = np.array(offsets)
    np.testing.assert_allclose(offsets[0], offsets[1], atol=1e-12)
    np.testing.assert_allclose(offsets[0], offsets[2], atol=1e-12)
    # The base has no bias; what its quaternion rounds differs by processor.
    np.testing.assert_allclose(offsets[0, :6], 0.0, atol=1e-12)
    assert offsets[0, 6:].std() == pytest.approx(0.01, rel=0.5)
    assert np.abs(offsets[4] - offsets[0])[6:].max() > 1e-3


def test_a_delay_shows_the_state_of_then() -> None:
    robot = load("hoap2_like")
    now, late = fallen(robot, 12), fallen(robot, 12, sensors=Sensors(delay=0.004))
    for k in range(12):
        seen, then = late[k], now[max(0, k - 2)]
        assert seen is not None and then is not None
        np.testing.assert_allclose(seen[0], then[0], atol=1e-12)
        np.testing.assert_allclose(seen[1], then[1], atol=1e-12)


def test_a_latency_applies_the_torques_of_then(rng: np.random.Generator) -> None:
    """Torques shifted by hand against torques that the plant holds back."""
    robot = load("hoap2_like")
    torques = 0.1 * rng.normal(size=(10, robot.nv - 6))
    by_hand = Plant(robot, dt=0.001, **QUIET)
    late = Plant(robot, sensors=Sensors(latency=0.003), **QUIET)
    for torque in torques:
        late.step(torque, 0.002)
    substeps = np.repeat(torques, 2, axis=0)
    shifted = np.concatenate((np.repeat(torques[:1], 3, axis=0), substeps))[: len(substeps)]
    for torque in shifted:
        by_hand.step(torque)
    np.testing.assert_allclose(late.state()[1], by_hand.state()[1], atol=1e-9)
    assert late.time == pytest.approx(by_hand.time)


def test_frames_are_lost_as_often_as_asked_for() -> None:
    sensors = Sensors(dropout=0.3, seed=5)
    once, again = (
        [frame is None for frame in fallen(load("hoap2_like"), 400, sensors=sensors)]
        for _ in range(2)
    )
    assert np.mean(once) == pytest.approx(0.3, abs=4.0 * np.sqrt(0.3 * 0.7 / 400))
    assert once == again


def test_asking_twice_changes_nothing() -> None:
    robot, sensors = load("hoap2_like"), Sensors(position_noise=0.01, velocity_noise=0.1, seed=9)
    plant = in_the_air(robot, sensors=sensors)
    for frame in fallen(robot, 5, sensors=sensors):
        first, second = measured(plant), measured(plant)
        assert frame is not None
        assert first[0].tobytes() == second[0].tobytes() == frame[0].tobytes()
        first[0][:] = np.nan  # ours to spoil
        idle(plant)


def test_a_fixed_base_is_known() -> None:
    robot = Robot.load("hoap2_like", base="fixed", feet={})
    plant = Plant(robot, sensors=Sensors(base_position_noise=1.0, base_rate_noise=1.0), **QUIET)
    for seen, true in zip(measured(plant), plant.state(), strict=True):
        np.testing.assert_array_equal(seen, true)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"position_noise": -1.0}, "position_noise"),
        ({"dropout": 1.5}, "probability"),
        ({"dropout": 1.0}, "no frame comes"),  # a run without a tick, in silence
        ({"delay": np.nan}, "delay"),
        ({"seed": -1}, "seed"),
        ({"seed": 1.5}, "seed"),
    ],
)
def test_mistakes_are_typed(options: dict[str, float], words: str) -> None:
    with pytest.raises(InvalidInputError, match=words):
        Sensors(**options)


def test_a_delay_is_a_multiple_of_the_physics_step() -> None:
    with pytest.raises(InvalidInputError, match=r"delay.* multiple"):
        Plant(load("hoap2_like"), sensors=Sensors(delay=0.0015))


def test_a_delay_in_ms_is_doubted(caplog: pytest.LogCaptureFixture) -> None:
    Plant(load("hoap2_like"), sensors=Sensors(delay=2.0, latency=0.1))
    assert caplog.messages == ["sensors: a delay of 2 s; is it in s?"]
    # No note of a result says it: command lines print warnings that are not marked as such.
    assert not any(hasattr(one, "noted") for one in caplog.records)
