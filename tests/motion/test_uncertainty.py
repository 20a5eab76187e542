"""Bands of the pendulum's noise, against Monte Carlo; margins of polygons, measured forces."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import wbc
from tests.motion.test_analysis import waving
from wbc.errors import InvalidInputError
from wbc.motion import Motion, RecordingError, RmpSeries, analyze, read_motion
from wbc.motion.forces import WRENCH, MeasuredForces
from wbc.motion.ground import sole_corners, support_margins, touching_corners
from wbc.motion.table import BASE
from wbc.motion.uncertainty import BAND, beyond_noise
from wbc.polygon import convex_hull, polygon_margin
from wbc.robot import Robot
from wbc.robot.series import sole_series

TIME = np.arange(600) / 200.0
PROBLEMS = Path(__file__).parents[2] / "problems"
INERTIAL = ("momentum", "momentum_rate", "second_moments", "radii", "average_angular_velocity")
MUCH = 1e-3, 5e-4, 1e-3  # rad, m, rad: as encoders and a good motion capture
ON_GROUND = ("cop", "cmp", "cop_margin", "leg_angles")


def noisy(clean: Motion, sizes: tuple[float, float, float], rng: np.random.Generator) -> Motion:
    """The same with noise of these standard deviations on joints, base position and rotation."""
    joint, position, rotation = sizes
    joints = clean.joints + joint * rng.normal(size=clean.joints.shape)
    base = None
    if clean.base is not None:
        place = clean.base[:, :3] + position * rng.normal(size=(len(joints), 3))
        turn = Rotation.from_rotvec(rotation * rng.normal(size=(len(joints), 3)))
        base = np.hstack((place, (Rotation.from_quat(clean.base[:, 3:]) * turn).as_quat()))
    return Motion(clean.robot, clean.time, joints, base)


def values(series: RmpSeries, name: str) -> np.ndarray:
    found = np.array(getattr(series, name))
    if name in ("cop", "cmp"):
        found = found[:, :2]
    return found


def coverages(
    clean: Motion, sizes: tuple[float, float, float], trials: int, names: tuple[str, ...], **options
) -> dict[str, float]:
    """Share of frames, in % over all trials, in which the truth is within the 95 % band."""
    rng = np.random.default_rng(7)
    truth = analyze(clean, noise=None, **options)
    within: dict[str, list[float]] = {name: [] for name in names}
    for _ in range(trials):
        series = analyze(noisy(clean, sizes, rng), **options)
        # Where the planted foot stands, the first frame's joints say: positions are relative to it.
        for name in names:
            error = values(series, name) - values(truth, name)
            if "planted" in options and name in ("cop", "cmp", "com"):
                error = error - stands(series)[:, : error.shape[1]]
                error = error + stands(truth)[:, : error.shape[1]]
            share = np.abs(error) <= BAND * getattr(series.uncertainty, name)
            within[name].append(float(share.mean()))
    return {name: 100.0 * float(np.mean(shares)) for name, shares in within.items()}


def stands(series: RmpSeries) -> np.ndarray:
    return sole_series(series.robot, series.q)["left"][:, :3, 3]


def test_bands_contain_the_truth_in_a_short_recording() -> None:
    # 10 trials of 1 s at 10 Hz are worth 200 independent values and more: within 4.5 % at 3 sigma.
    found = coverages(
        waving(Robot.load("hoap2_like"), 0.1, TIME[:200]),
        (5e-4, 1e-3, 1e-3),
        10,
        ("cop", "radii"),
        feet="left",
    )
    assert all(90.5 < share < 99.5 for share in found.values()), found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "sizes", "options"),
    [
        ("g1", (1e-3, 1e-3, 1e-3), {"feet": "left"}),
        ("hoap2_like", (5e-4, 0.0, 0.0), {"feet": ["left", "right"], "cutoff": 6.0}),
        ("hoap2_like", (5e-4, 1e-3, 5e-4), {"feet": "left", "rate": 70.0}),
        ("hoap2_like", (1e-6, 1e-6, 1e-6), {"feet": "left", "cutoff": None}),
    ],
    ids=["g1", "joints only", "resampled", "no filter"],
)
def test_95_percent_bands_contain_93_to_97(robot: str, sizes: tuple, options: dict) -> None:
    found = coverages(
        waving(Robot.load(robot), 0.1, TIME), sizes, 30, (*INERTIAL, *ON_GROUND), **options
    )
    assert all(93.0 <= share <= 97.0 for share in found.values()), found


@pytest.mark.slow
def test_bands_with_a_planted_foot_contain_93_to_97() -> None:
    recorded = waving(Robot.load("hoap2_like"), 0.1, TIME)
    clean = Motion(recorded.robot, recorded.time, recorded.joints)
    names = (*INERTIAL, *ON_GROUND, "com")
    found = coverages(clean, (3e-4, 0.0, 0.0), 30, names, planted="left")
    assert all(93.0 <= share <= 97.0 for share in found.values()), found


@pytest.mark.slow
def test_bands_with_changing_planted_feet_contain_93_to_97(tmp_path: Path) -> None:
    """Each foot is raised in turn: the base goes through the filter twice."""
    result = wbc.load_problem(PROBLEMS / "shiko_hoap2.yaml").run()
    result.save(tmp_path / "shiko.npz")
    read = wbc.read_motion(tmp_path / "shiko.npz", result.robot)
    clean = Motion(result.robot, read.time, read.joints)
    names = (*INERTIAL, "cop_margin", "leg_angles")
    found = coverages(clean, (2e-4, 0.0, 0.0), 8, names, planted="auto")
    assert all(93.0 <= share <= 97.0 for share in found.values()), found


# ---------------------------------------------------------------------- verdicts


@pytest.fixture(scope="module")
def beside_the_foot(hoap2: Robot) -> Motion:
    """A HOAP-2 at rest with its CoM 8 mm outside the left sole: infeasible on that foot alone."""
    q = np.tile(hoap2.postures["standing"], (600, 1))
    return Motion(hoap2, TIME, q[:, 7:], q[:, :7])


def test_verdict_needs_more_than_noise(beside_the_foot: Motion) -> None:
    rng = np.random.default_rng(3)
    little = analyze(noisy(beside_the_foot, (1e-5, 0.0, 0.0), rng), feet="left")
    assert little.infeasible.all() and not little.surely_inside.any()
    much = noisy(beside_the_foot, MUCH, rng)
    silent = analyze(much, feet="left")
    assert silent.cop_outside.any() and not silent.cop_outside.all() and not silent.infeasible.any()
    # The same recording tells it after a lower low-pass, and to who does not ask for its noise.
    assert analyze(much, feet="left", cutoff=0.7).infeasible.mean() > 0.9
    unasked = analyze(much, feet="left", noise=None)
    assert unasked.uncertainty is None
    assert (unasked.infeasible == unasked.cop_outside).all()


def test_inside_needs_more_than_noise(beside_the_foot: Motion) -> None:
    # The CoM is 27 mm inside both soles' hull.
    rng = np.random.default_rng(3)
    little = analyze(noisy(beside_the_foot, (1e-5, 0.0, 0.0), rng))
    assert little.surely_inside.all()
    much = analyze(noisy(beside_the_foot, MUCH, rng))
    assert not much.surely_inside.all() and not much.infeasible.any()


def test_flight_needs_more_than_noise(beside_the_foot: Motion) -> None:
    rng = np.random.default_rng(3)
    base = np.array(beside_the_foot.base)
    # Every 1.25 s it falls, for a while, as fast as only a ground that pulls could make it.
    base[:, 2] += 0.12 * np.cos(2.0 * np.pi * 1.6 * beside_the_foot.time)
    hopping = Motion(beside_the_foot.robot, beside_the_foot.time, beside_the_foot.joints, base)
    series = analyze(noisy(hopping, (1e-4, 1e-4, 0.0), rng), feet=None)
    assert 0 < series.surely_flying.sum() < series.flight.sum()
    assert (series.flight >= series.surely_flying).all()
    assert np.isnan(series.uncertainty.cop[series.flight]).all()
    assert np.isfinite(series.uncertainty.cop[~series.flight]).all()
    assert np.isfinite(series.uncertainty.momentum_rate).all()


@pytest.mark.slow
def test_noise_alone_gives_a_verdict_in_few_recordings(beside_the_foot: Motion) -> None:
    """With the CoP well inside, no recording of 40; with it on an edge, 5 % of them at most."""
    rng = np.random.default_rng(5)
    alarms = 0
    for _ in range(40):
        motion = noisy(beside_the_foot, MUCH, rng)
        alarms += bool(analyze(motion).infeasible.any())
    assert alarms <= 5  # of 40 at 5 %: more with a probability of 1.4 %


def test_level_beyond_noise_is_passed_in_5_percent_of_recordings() -> None:
    """Against band-limited noise itself, 2000 recordings of 6 s."""
    rng, seconds, band = np.random.default_rng(11), 6.0, 10.0
    spectrum = rng.normal(size=(2000, 601)) + 1j * rng.normal(size=(2000, 601))
    spectrum[:, int(band * seconds) + 1 :] = 0.0
    noise = np.fft.irfft(spectrum, axis=1)
    passed = (noise > beyond_noise(seconds, band) * noise.std()).any(axis=1).mean()
    assert 0.01 < passed < 0.05  # the bound is Rice's, for noise all at the band's edge


# ---------------------------------------------------------------------- what is kept


def test_uncertainty_is_saved(beside_the_foot: Motion, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    series = analyze(noisy(beside_the_foot, (1e-4, 1e-4, 0.0), rng))
    series.save(tmp_path / "s.npz")
    with np.load(tmp_path / "s.npz") as file:
        for name, array in series.uncertainty.arrays().items():
            np.testing.assert_array_equal(file[f"deviation/{name}"], array)
        np.testing.assert_array_equal(file["noise/joints"], series.uncertainty.noise.joints)
        assert float(file["noise/beyond"]) == series.uncertainty.beyond
    again = wbc.read_motion(tmp_path / "s.npz", series.robot)
    np.testing.assert_array_equal(again.joints, series.q[:, 7:])
    series.save(tmp_path / "s.csv")
    header = (tmp_path / "s.csv").read_text().split("\n", 1)[0].split(",")
    rows = np.loadtxt(tmp_path / "s.csv", delimiter=",", skiprows=1)
    margin = rows[:, header.index("cop_margin_deviation [m]")]
    np.testing.assert_allclose(margin, series.uncertainty.cop_margin, rtol=1e-8)


def test_measured_forces_have_no_band_of_the_motions_noise(hoap2: Robot) -> None:
    q = np.tile(hoap2.postures["standing"], (100, 1))
    time = TIME[:100]
    wrench = np.tile([0.0, 0.0, 0.5 * 9.81 * hoap2.mass, 0.0, 0.0, 0.0], (100, 1))
    forces = MeasuredForces(time, {"left": wrench, "right": wrench})
    series = analyze(Motion(hoap2, time, q[:, 7:], q[:, :7], forces=forces))
    assert series.measured
    assert np.isnan(series.uncertainty.cop).all()
    assert np.isfinite(series.uncertainty.momentum_rate).all()


def test_options_of_other_kinds_are_refused(beside_the_foot: Motion) -> None:
    with pytest.raises(InvalidInputError, match="cutoff"):
        analyze(beside_the_foot, cutoff="high")
    motion = noisy(beside_the_foot, MUCH, np.random.default_rng(1))
    chosen = analyze(motion, cutoff="residual")
    assert 1.0 < chosen.cutoff < 5.0  # nothing moves
    given = analyze(motion, cutoff=chosen.cutoff)
    np.testing.assert_array_equal(chosen.cop, given.cop)


ROWS, RATE = 60, 100.0


@pytest.mark.parametrize("size", [3, 5, 8, 16])
def test_margins_are_those_of_each_polygon(size: int, rng: np.random.Generator) -> None:
    corners = rng.normal(size=(200, 1, size, 3))
    corners[:50, :, -1] = corners[:50, :, 0]  # corners that are there twice
    if size > 3:
        corners[50:100, :, 1] = 0.5 * (corners[50:100, :, 2] + corners[50:100, :, 3])  # on an edge
    points = rng.normal(size=(200, 2))
    margins = support_margins(corners, np.ones((200, 1, size), dtype=bool), points).margin
    for k in range(200):
        expected = polygon_margin(convex_hull(corners[k, 0, :, :2]), points[k])
        assert margins[k] == pytest.approx(float(expected), abs=1e-12)
    assert (margins > 0.0).any() and (margins < 0.0).any()


def test_gradients_of_the_margin_are_those_of_differences(rng: np.random.Generator) -> None:
    """The margin is a distance: smooth but at kinks, which none of 200 points is near to."""
    corners, points = rng.normal(size=(200, 2, 4, 3)), rng.normal(size=(200, 2))
    touching = rng.random((200, 2, 4)) < 0.7
    touching[:60] &= rng.random((60, 2, 1)) < 0.6  # feet in the air
    found = support_margins(corners, touching, points)
    standing = touching.any(axis=2)
    some = standing.any(axis=1)

    def quotient(moved_corners: np.ndarray, moved_points: np.ndarray) -> np.ndarray:
        ahead = support_margins(corners + moved_corners, touching, points + moved_points).margin
        behind = support_margins(corners - moved_corners, touching, points - moved_points).margin
        return (ahead - behind) / 2e-7

    for k, step in enumerate(1e-7 * np.eye(2, 3)):
        by_point = quotient(np.zeros((2, 1, 3)), step[:2])
        np.testing.assert_allclose(found.gradient[:, k], by_point, atol=1e-6)
        for foot in range(2):
            moved = np.zeros((2, 1, 3))
            moved[foot] = step
            expected = -found.weights[:, foot] * found.gradient[:, k]
            by_foot = quotient(moved, np.zeros(2))
            np.testing.assert_allclose(expected[some], by_foot[some], atol=1e-6)
    assert np.isnan(found.gradient[~some]).all() and not found.weights[~standing].any()


def test_only_standing_feet_count(rng: np.random.Generator) -> None:
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    corners = np.tile(np.stack((square, square + [3, 0, 0])), (4, 1, 1, 1))
    standing = np.array([[True, False], [False, True], [True, True], [False, False]])
    points = np.tile([2.0, 0.5], (4, 1))
    touching = np.repeat(standing[..., None], 4, axis=2)
    margins = support_margins(corners, touching, points).margin
    np.testing.assert_allclose(margins[:3], [-1.0, -1.0, 0.5])
    assert np.isnan(margins[3])


def test_collinear_corners_have_no_interior() -> None:
    row = np.array([[[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [0.5, 0.5]]])
    corners = np.tile(np.dstack((row, np.zeros((1, 4))))[:, None], (4, 1, 1, 1))
    points = np.array([[1.0, 1.0], [3.0, 2.0], [0.0, -0.5], [1.6, 0.2]])
    margins = support_margins(corners, np.ones((4, 1, 4), bool), points).margin
    np.testing.assert_allclose(margins, [0.0, -1.0, -0.5, -0.7 * np.sqrt(2.0)], atol=1e-15)


def test_coincident_corners_have_no_interior() -> None:
    corners = np.full((1, 1, 4, 3), 0.5)
    margins = support_margins(corners, np.ones((1, 1, 4), bool), np.array([[3.5, 4.5]])).margin
    np.testing.assert_allclose(margins, [-5.0])


def test_a_sole_that_rolls_touches_with_its_edge_and_one_that_swings_does_not() -> None:
    sole = np.array([[0.1, 0.05, 0], [0.1, -0.05, 0], [-0.1, -0.05, 0], [-0.1, 0.05, 0]])
    time = 0.02 * np.arange(5)
    rolling, swinging = np.tile(sole, (5, 1, 1)), np.tile(sole, (5, 1, 1))
    rolling[:, 2:, 2] += 0.05 * np.arange(5)[:, None]  # heels rise, toes stay
    swinging[:, 2:, 2] += 0.05
    swinging[..., 0] += 2.0 * time[:, None]
    corners = np.stack((rolling, swinging), axis=1)
    expected = np.zeros((5, 2, 4), dtype=bool)
    expected[:, 0, :2] = True
    expected[0, 0] = True  # still flat
    np.testing.assert_array_equal(touching_corners(corners, 0.0, time), expected)


def test_feet_near_ground_are_those_within_1_cm(hoap2: Robot) -> None:
    lifted = hoap2.posture("standing", {"left_hip_pitch": -0.9, "left_knee_pitch": 1.2})
    q = np.stack((hoap2.postures["standing"], lifted))
    corners = sole_corners(hoap2, sole_series(hoap2, q))
    standing = [touching_corners(one[None], 0.0, np.zeros(1)).all(axis=2) for one in corners]
    assert np.concatenate(standing).tolist() == [[True, True], [False, True]]
    assert not touching_corners(corners, 0.5, np.array([0.0, 1.0])).any()
    here = hoap2.snapshot(lifted)
    foot = hoap2.feet["left"]
    flat = np.column_stack((foot.polygon, np.zeros(len(foot.polygon))))
    np.testing.assert_allclose(
        corners[1, 0], flat @ here.rotation(foot.frame).T + here.position(foot.frame), atol=1e-12
    )


def standing(robot: wbc.Robot) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Times, configurations, and wrenches at the soles' frames: a third on the left foot."""
    q = np.tile(robot.posture("standing"), (ROWS, 1))
    wrenches = {}
    for frame, share in (("left_sole", 1 / 3), ("right_sole", 2 / 3)):
        force = share * robot.weight
        # At a point 1 cm before the frame's origin: moment (r x f) about that origin.
        wrenches[frame] = np.tile([0.0, 0.0, force, 0.0, -0.01 * force, 0.0], (ROWS, 1))
    return np.arange(ROWS) / RATE, q, wrenches


def write(file: Path, robot: wbc.Robot, **changed: np.ndarray) -> Path:
    time, q, wrenches = standing(robot)
    arrays = {"time": time, "q": q, **{f"forces/{k}": w for k, w in wrenches.items()}}
    np.savez(file, **{name: changed.get(name, array) for name, array in arrays.items()})
    return file


def test_measured_cop_is_that_of_the_soles(hoap2: wbc.Robot, tmp_path: Path) -> None:
    series = analyze(read_motion(write(tmp_path / "m.npz", hoap2), hoap2))
    assert series.measured
    here = hoap2.snapshot(hoap2.posture("standing"))
    left, right = here.position("left_sole"), here.position("right_sole")
    wanted = left / 3 + 2 * right / 3 + [0.01, 0.0, 0.0]
    np.testing.assert_allclose(series.cop[:, :2], np.tile(wanted[:2], (ROWS, 1)), atol=1e-9)
    np.testing.assert_allclose(series.ground_force[:, 2], hoap2.weight, rtol=1e-9)
    # A robot at rest needs its weight, which is what was measured.
    np.testing.assert_allclose(series.force_residual, 0.0, atol=1e-6)


def test_forces_of_a_csv_file_are_those_of_the_npz_file(hoap2: wbc.Robot, tmp_path: Path) -> None:
    """Columns as ``wbc sim -o FILE.csv`` names them; without some of them the foot has none."""
    time, q, wrenches = standing(hoap2)
    heads, columns = ["time [s]", *BASE, *hoap2.joint_names], [time[:, None], q]
    for frame, wrench in wrenches.items():
        units = ["N"] * 3 + ["N m"] * 3
        heads += [f"forces/{frame}/{row} [{u}]" for row, u in zip(WRENCH, units, strict=True)]
        columns.append(wrench)
    file = tmp_path / "m.csv"
    np.savetxt(file, np.hstack(columns), delimiter=",", header=",".join(heads), comments="")
    read = read_motion(file, hoap2).forces
    assert read is not None
    for foot, wrench in zip(("left", "right"), wrenches.values(), strict=True):
        np.testing.assert_allclose(read.wrenches[foot], wrench)
    some = read_motion(file, hoap2, ignore=["forces/left_sole/fz*"]).forces
    assert some is not None and list(some.wrenches) == ["right"]


def test_foot_in_the_air_has_no_force(hoap2: wbc.Robot, tmp_path: Path) -> None:
    file = write(tmp_path / "m.npz", hoap2, **{"forces/left_sole": np.zeros((ROWS, 6))})
    series = analyze(read_motion(file, hoap2), cutoff=None)
    right = hoap2.snapshot(hoap2.posture("standing")).position("right_sole")
    np.testing.assert_allclose(series.cop[:, :2], np.tile(right[:2] + [0.01, 0.0], (ROWS, 1)))
    np.testing.assert_allclose(series.force_residual[:, 2], -hoap2.weight / 3, rtol=1e-9)


@pytest.mark.parametrize("wrong", [np.zeros((ROWS, 3)), np.full((ROWS, 6), np.nan)])
def test_impossible_forces_are_refused(hoap2: wbc.Robot, tmp_path: Path, wrong: np.ndarray) -> None:
    file = write(tmp_path / "m.npz", hoap2, **{"forces/left_sole": wrong})
    with pytest.raises(RecordingError, match=r"m\.npz: measured forces, left"):
        read_motion(file, hoap2)


def test_force_times_and_rows_must_agree() -> None:
    with pytest.raises(wbc.WbcError, match="left"):
        MeasuredForces(np.arange(3.0), {"left": np.zeros((4, 6))})
