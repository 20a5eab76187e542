"""The pendulum of a motion, against `wbc.reduce` frame by frame and motions known by hand."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import wbc
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.motion import Motion, RmpSeries, analyze
from wbc.robot import Robot

RATE = 200.0
TIME = np.arange(400) / RATE
SAME_NAME = (
    *("com", "com_velocity", "momentum", "momentum_rate", "ground_force", "ground_moment"),
    *("cop", "cmp", "cop_margin", "leg_length", "leg_direction", "leg_angles", "radii", "axes"),
    *("axes_defined", "average_angular_velocity", "axes_angular_velocity"),
)


def waving(robot: Robot, amplitude: float, time: np.ndarray = TIME) -> Motion:
    """Every joint swings, and the base with them."""
    limits = robot.limits
    middle = limits.joint_positions(robot.postures["standing"])
    room = np.minimum(np.minimum(limits.upper - middle, middle - limits.lower), 1.0)
    phase = np.arange(len(middle))
    joints = middle + amplitude * room * np.sin(5.0 * time[:, None] + phase)
    angles = 0.3 * amplitude * np.sin(3.0 * time[:, None] + [0.0, 1.0, 2.0])
    angles[:, 2] += 2.5 * time  # turns on, past pi
    sway = 0.1 * amplitude * np.cos(4.0 * time[:, None] + [0, 1, 2])
    place = robot.postures["standing"][:3] + sway
    base = np.hstack((place, Rotation.from_euler("xyz", angles).as_quat()))
    return Motion(robot, time, joints, base)


@pytest.fixture(scope="module", params=["hoap2_like", "g1_27", "mixed_joints"])
def motion(request: pytest.FixtureRequest) -> Motion:
    if request.param == "mixed_joints":
        path = Path(__file__).parents[1] / "models" / "mixed_joints.urdf"
        return waving(Robot.load(path), 0.4)
    return waving(Robot.load(request.param), 0.4)


def test_each_frame_is_that_of_reduce(motion: Motion) -> None:
    robot = motion.robot
    feet = tuple(robot.feet) or None
    series = analyze(motion, feet=feet)
    previous = None
    for k in range(len(series)):
        snapshot = robot.snapshot(series.q[k], series.v[k])
        state = wbc.reduce(snapshot, series.acceleration[k], feet=feet, previous=previous)
        previous = state
        assert state.flight == series.flight[k]
        for name in SAME_NAME:
            of_series = getattr(series, name)
            if of_series is None:
                assert state.cop_margin is None
                continue
            one, many = getattr(state, name), of_series[k]
            if one is None:
                assert np.isnan(many).all(), name
            else:
                size = 1.0 + np.abs(np.asarray(one, dtype=float)).max()
                error = np.abs(np.asarray(one, dtype=float) - many).max()
                # The axes' rate divides by gaps of moments, down to 1e-3 of the largest.
                assert error < (1e-7 if name == "axes_angular_velocity" else 1e-9) * size, name


def test_nan_is_only_in_flight(hoap2: Robot) -> None:
    motion = waving(hoap2, 0.4)
    base = motion.base.copy()
    base[:, 2] = 0.6 + 0.15 * np.cos(2.0 * np.pi * 1.9 * TIME)  # falls faster than g at the top
    series = analyze(Motion(hoap2, TIME, motion.joints, base), feet=("left", "right"))
    assert 20 < series.flight.sum() < 380
    for name in ("cop", "cmp", "ground_moment", "cop_margin", "leg_length", "leg_angles"):
        values = np.isnan(getattr(series, name)).reshape(len(series), -1)
        assert (values.all(axis=1) == series.flight).all(), name
        assert (values.any(axis=1) == series.flight).all(), name
    for name in ("com", "momentum_rate", "ground_force", "inertia", "radii", "axes"):
        assert np.isfinite(getattr(series, name)).all(), name
    # Never clipped: with such arms it is outside now and then, and said so.
    assert (series.cop_outside == (series.cop_margin < 0.0)).all()


def test_feet_are_checked_by_default(hoap2: Robot) -> None:
    motion = waving(hoap2, 0.0)
    base = np.tile(hoap2.postures["standing"][:7], (len(TIME), 1))
    still = Motion(hoap2, TIME, motion.joints, base)
    series = analyze(still)
    assert series.feet == ("left", "right")
    assert series.standing.all() and not series.cop_unknown.any()
    assert (series.cop_margin > 0.02).all()
    assert analyze(still, feet=None).cop_margin is None
    assert analyze(still, feet=np.array(("left", "right"))).feet == ("left", "right")
    with pytest.raises(InvalidInputError, match="'left' is named twice"):
        analyze(still, feet=["left", "left"])
    with pytest.raises(UnknownNameError, match="'auto'"):
        analyze(still, feet=["auto"])
    # No sole is on this ground: nothing is said of the CoP, and that is said.
    lower = analyze(still, ground_height=-0.3)
    assert lower.cop_unknown.all() and np.isnan(lower.cop_margin).all()
    assert not lower.cop_outside.any()


def test_rigid_body_rotating_about_the_vertical_has_its_angular_velocity(hoap2: Robot) -> None:
    # By hand: joints at rest, base turning at 1.2 rad/s about the CoM's vertical.
    stand = hoap2.postures["standing"]
    com = hoap2.snapshot(stand).com
    angle = 1.2 * TIME
    turn = Rotation.from_euler("z", angle[:, None])
    arm = stand[:3] - com
    base = np.hstack((com + turn.apply(arm), turn.as_quat()))
    joints = np.tile(hoap2.limits.joint_positions(stand), (len(TIME), 1))
    series = analyze(Motion(hoap2, TIME, joints, base), cutoff=None)
    inner = slice(20, -20)
    spin = np.tile([0.0, 0.0, 1.2], (400, 1))
    np.testing.assert_allclose(series.average_angular_velocity[inner], spin[inner], atol=1e-7)
    np.testing.assert_allclose(series.axes_angular_velocity[inner], spin[inner], atol=1e-7)
    np.testing.assert_allclose(series.com_acceleration[inner], 0.0, atol=1e-6)
    weight = -hoap2.mass * hoap2.model.gravity.linear
    np.testing.assert_allclose(series.ground_force[inner], np.tile(weight, (360, 1)), atol=1e-5)
    np.testing.assert_allclose(series.radii, np.tile(series.radii[0], (400, 1)), atol=1e-12)
    # Reaction masses M/6 at +-r_k give the inertia back: trace = 2 M/3 sum r_k^2.
    trace = series.inertia[:, [0, 3, 5]].sum(axis=1)
    np.testing.assert_allclose(trace, hoap2.mass * 2 / 3 * (series.radii**2).sum(axis=1))


def test_velocity_and_acceleration_are_those_of_a_known_motion(hoap2: Robot) -> None:
    motion = waving(hoap2, 0.4)
    series = analyze(motion)
    inner = slice(120, -120)
    middle = hoap2.limits.joint_positions(hoap2.postures["standing"])
    amplitude = np.abs(motion.joints - middle).max(axis=0)
    exact = 5.0 * 0.4 * np.cos(5.0 * TIME[:, None] + np.arange(25))
    room = np.minimum(np.minimum(hoap2.limits.upper - middle, middle - hoap2.limits.lower), 1.0)
    # Filter and spline at 0.8 Hz: below 1e-7 of the amplitude; what the ends leave, below 1e-5.
    np.testing.assert_allclose(series.v[inner, 6:], (exact * room)[inner], atol=1e-5)
    second = -25.0 * (motion.joints - middle)
    np.testing.assert_allclose(series.acceleration[inner, 6:], second[inner], atol=2e-4)
    assert amplitude.max() > 0.3
    # The base's linear velocity in its own axes, from the world's by hand.
    R = Rotation.from_quat(motion.base[:, 3:])
    world = -0.4 * 0.1 * 4.0 * np.sin(4.0 * TIME[:, None] + [0, 1, 2])
    np.testing.assert_allclose(series.v[inner, :3], R.inv().apply(world)[inner], atol=1e-5)
    # v's rate is v's derivative, componentwise: central differences of order h^2 w^3 A.
    quotient = (series.v[2:] - series.v[:-2]) * 0.5 * RATE
    np.testing.assert_allclose(series.acceleration[1:-1][inner], quotient[inner], atol=6e-3)


def test_flipped_quaternions_do_not_matter() -> None:
    motion = waving(Robot.load("hoap2_like"), 0.4)
    base = motion.base.copy()
    base[::3, 3:] *= -1.0
    flipped = analyze(Motion(motion.robot, TIME, motion.joints, base))
    straight = analyze(motion)
    np.testing.assert_allclose(flipped.momentum_rate, straight.momentum_rate, atol=1e-9)


def test_rate_of_the_series_may_differ() -> None:
    motion = waving(Robot.load("hoap2_like"), 0.4)
    full, half = analyze(motion), analyze(motion, rate=100.0)
    np.testing.assert_allclose(half.time, full.time[::2])
    np.testing.assert_allclose(half.momentum_rate, full.momentum_rate[::2], atol=1e-9)
    assert len(analyze(motion, rate=1000.0)) == 1996


@pytest.fixture(scope="module")
def series() -> RmpSeries:
    return analyze(waving(Robot.load("hoap2_like"), 0.2), feet="auto")


def test_saved_as_npz(series: RmpSeries, tmp_path: Path) -> None:
    series.save(tmp_path / "s.npz")
    with np.load(tmp_path / "s.npz", allow_pickle=False) as file:
        for name, values in series.arrays().items():
            np.testing.assert_array_equal(file[name], values)
        assert file["joint_names"].tolist() == list(series.robot.joint_names)
        assert file["feet"].tolist() == ["left", "right"]
        summary = json.loads(str(file["summary"]))
    assert summary["mass"] == series.robot.mass
    assert [path.name for path in tmp_path.iterdir()] == ["s.npz"]


def test_saved_as_csv(series: RmpSeries, tmp_path: Path) -> None:
    series.save(tmp_path / "s.csv")
    with (tmp_path / "s.csv").open() as file:
        header, *rows = list(csv.reader(file))
    values = np.array(rows, dtype=float)
    assert len(set(header)) == len(header)
    assert all(name.endswith("]") and " [" in name for name in header)
    expected = {
        "time [s]": series.time,
        "com_velocity_z [m/s]": series.com_velocity[:, 2],
        "momentum_y [kg m/s]": series.momentum[:, 1],
        "momentum_kx [kg m^2/s]": series.momentum[:, 3],
        "momentum_rate_kz [N m]": series.momentum_rate[:, 5],
        "cop_x [m]": series.cop[:, 0],
        "leg_angles_phi [rad]": series.leg_angles[:, 1],
        "inertia_yz [kg m^2]": series.inertia[:, 4],
        "radii_3 [m]": series.radii[:, 2],
        "axes_2x [1]": series.axes[:, 0, 1],
        "right_stands [1]": series.standing[:, 1],
    }
    for name, column in expected.items():
        np.testing.assert_allclose(values[:, header.index(name)], column, rtol=1e-8, atol=1e-12)


def test_other_endings_and_frozen_arrays(series: RmpSeries, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="npz"):
        series.save(tmp_path / "s.json")
    with pytest.raises(ValueError, match="read-only"):
        series.com[0] = 0.0


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"rate": 0.0}, InvalidInputError, "rate"),
        ({"cutoff": 100.0}, InvalidInputError, "half the recording"),
        ({"gap": 0.0}, InvalidInputError, "gap"),
        ({"feet": []}, InvalidInputError, "feet"),
        ({"feet": ["lefft"]}, UnknownNameError, "did you mean 'left'"),
        ({"ground_height": np.nan}, InvalidInputError, "ground_height"),
    ],
)
def test_bad_options_are_refused(options: dict, error: type, words: str) -> None:
    motion = waving(Robot.load("hoap2_like"), 0.2)
    with pytest.raises(error, match=words):
        analyze(motion, **options)


def test_progress_reaches_the_end() -> None:
    calls = list[tuple[int, int]]()
    analyze(
        waving(Robot.load("hoap2_like"), 0.2),
        progress=lambda done, all_: calls.append((done, all_)),
    )
    assert calls == [(400, 400)]
