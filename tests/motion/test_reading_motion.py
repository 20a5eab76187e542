"""Recordings as files: what is read, and how each mistake is refused."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.motion import Motion, RecordingError, analyze, read_motion
from wbc.problem import load_problem
from wbc.robot import Robot

COUNT, RATE = 60, 100.0
TIME = np.arange(COUNT) / RATE
TRACKED = {
    "fps": np.array([50.0]),
    "joint_pos": np.zeros((COUNT, 1)),
    "joint_names": np.array(["head_yaw"]),
    "body_pos_w": np.zeros((COUNT, 2, 3)),
    "body_quat_w": np.ones((COUNT, 2, 4)),
}
MIXED = Path(__file__).parents[1] / "models" / "mixed_joints.urdf"


@pytest.fixture
def joints(hoap2: Robot) -> np.ndarray:
    """Every joint moves by a tenth of its range about its middle (COUNT, nv-6)."""
    limits = hoap2.limits
    middle, half = 0.5 * (limits.upper + limits.lower), 0.05 * (limits.upper - limits.lower)
    return middle + half * np.sin(5.0 * TIME[:, None] + np.arange(len(half)))


Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write(columns: dict[str, np.ndarray], name: str = "walk.csv", delimiter: str = ",") -> Path:
        path = tmp_path / name
        rows = np.column_stack(list(columns.values()))
        np.savetxt(path, rows, delimiter=delimiter, header=delimiter.join(columns), comments="")
        return path

    return write


def columns_of(robot: Robot, joints: np.ndarray) -> dict[str, np.ndarray]:
    return {"time": TIME} | {name: joints[:, k] for k, name in enumerate(robot.joint_names)}


@pytest.fixture
def columns(hoap2: Robot, joints: np.ndarray) -> dict[str, np.ndarray]:
    """Views of the joints, by name, and the time."""
    return columns_of(hoap2, joints)


def base_columns(rng: np.random.Generator) -> dict[str, np.ndarray]:
    place = rng.normal(size=3) + 0.1 * np.sin(TIME[:, None] + np.arange(3))
    turn = Rotation.from_euler("xyz", 0.2 * np.cos(TIME[:, None] + np.arange(3))).as_quat()
    names = ("x", "y", "z", "qx", "qy", "qz", "qw")
    return {f"base_{a}": part for a, part in zip(names, np.hstack((place, turn)).T, strict=True)}


# ---------------------------------------------------------------------- what is read


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_joints_may_be_in_any_order(hoap2, joints, columns, write: Write, delimiter: str) -> None:
    columns = dict(reversed(columns.items()))
    motion = read_motion(write(columns, delimiter=delimiter), hoap2)
    np.testing.assert_allclose(motion.joints, joints, rtol=1e-12)
    np.testing.assert_allclose(motion.time, TIME, atol=1e-12)
    assert motion.base is None and motion.dropouts == ()
    assert motion.rate == pytest.approx(RATE)


def test_units_in_names_are_converted(hoap2, joints, columns, write: Write) -> None:
    in_names = {"Time (ms)": 1e3 * columns.pop("time")}
    for k, (name, values) in enumerate(columns.items()):
        marked = (f"{name} (deg)", f"{name}_deg", f"{name} [rad]", f"{name}_rad", name)[k % 5]
        in_names[marked] = np.rad2deg(values) if "deg" in marked else values
    motion = read_motion(write(in_names), hoap2)
    np.testing.assert_allclose(motion.joints, joints, rtol=1e-12)
    np.testing.assert_allclose(motion.time, TIME, atol=1e-12)


def test_degrees_are_for_angles_only(write: Write) -> None:
    robot = Robot.load(MIXED)
    columns = {"time": TIME}
    for k, name in enumerate(robot.joint_names):
        low, high = np.clip([robot.limits.lower[k], robot.limits.upper[k]], -1.0, 1.0)
        columns[name] = np.full(COUNT, 0.5 * (low + high) + 0.1 * (high - low))
    plain = read_motion(write(columns), robot).joints
    from wbc.robot.series import revolute_joints

    turned = revolute_joints(robot)
    for k, name in enumerate(robot.joint_names):
        columns[name] = np.rad2deg(columns[name]) if turned[k] else columns[name]
    np.testing.assert_allclose(read_motion(write(columns), robot, degrees=True).joints, plain)


def test_base_by_quaternion_and_by_angles_is_the_same(hoap2, columns, write: Write, rng) -> None:
    base = base_columns(rng)
    motion = read_motion(write(columns | base), hoap2)
    np.testing.assert_allclose(motion.base, np.column_stack(list(base.values())), atol=1e-12)
    quaternions = np.column_stack([base.pop(f"base_q{a}") for a in "xyzw"])
    angles = Rotation.from_quat(quaternions).as_euler("ZYX", degrees=True)[:, ::-1]
    base |= {f"base_{a} [deg]": x for a, x in zip(("roll", "pitch", "yaw"), angles.T, strict=True)}
    by_angles = read_motion(write(columns | base), hoap2).base
    np.testing.assert_allclose(by_angles, motion.base, atol=1e-12)


def test_rate_replaces_times(hoap2, columns, write: Write) -> None:
    del columns["time"]
    motion = read_motion(write(columns), hoap2, rate=50.0)
    np.testing.assert_allclose(motion.time, np.arange(COUNT) / 50.0)


@pytest.mark.parametrize("posture", ["standing", "neutral"])
def test_missing_joints_are_of_the_named_posture(hoap2, joints, columns, write, posture) -> None:
    del columns["left_elbow_pitch"]
    k = hoap2.joint_names.index("left_elbow_pitch")
    motion = read_motion(write(columns), hoap2, missing=posture)
    assert (motion.joints[:, k] == hoap2.limits.joint_positions(hoap2.postures[posture])[k]).all()


def test_npz_forms_are_the_same(hoap2, joints, columns, tmp_path: Path, rng) -> None:
    base = base_columns(rng)
    np.savez(tmp_path / "a.npz", **columns, **base)
    time = columns.pop("time")
    np.savez(tmp_path / "b.npz", time=time, names=list(columns), positions=joints, **base)
    q = np.hstack((np.column_stack(list(base.values())), joints))
    np.savez(tmp_path / "c.npz", time=time, q=q, com=np.zeros((COUNT, 3)))
    for name in "abc":
        motion = read_motion(tmp_path / f"{name}.npz", hoap2)
        np.testing.assert_allclose(motion.joints, joints)
        np.testing.assert_allclose(motion.base, q[:, :7], atol=1e-12)


def test_run_of_wbc_is_read_back(tmp_path: Path) -> None:
    problem = tmp_path / "p.yaml"
    problem.write_text(
        "robot: hoap2_like\nsupport: double\n"
        "tasks:\n"
        "  hand: {type: frame, frame: left_hand, control: position,"
        " target: {offset: [0, 0, 0.02]}}\n"
        "stop: {duration: 0.2, speed: null}\n"
    )
    result = load_problem(problem).run()
    result.save(tmp_path / "r.npz")
    motion = read_motion(tmp_path / "r.npz", result.robot)
    np.testing.assert_allclose(motion.time, result.history.time)
    np.testing.assert_allclose(motion.joints, result.history.q[:, 7:])
    np.testing.assert_allclose(motion.base, result.history.q[:, :7], atol=1e-12)
    series = analyze(motion, cutoff=None, feet=("left", "right"))
    np.testing.assert_allclose(series.com, result.history.com, atol=1e-9)
    np.testing.assert_allclose(series.inertia, result.history.inertia, atol=1e-9)
    # And what an analysis writes is a recording again.
    series.save(tmp_path / "s.npz")
    again = read_motion(tmp_path / "s.npz", result.robot)
    np.testing.assert_allclose(again.joints, series.q[:, 7:])


def test_continuous_joints_of_q_are_angles(tmp_path: Path, rng) -> None:
    robot = Robot.load(MIXED)
    q = np.tile(robot.postures["neutral"], (COUNT, 1))
    k = robot.limits.unbounded[0]
    start = robot.limits.starts[k]
    angle = 3.0 + 0.05 * np.arange(COUNT)  # passes pi
    q[:, start], q[:, start + 1] = np.cos(angle), np.sin(angle)
    np.savez(tmp_path / "c.npz", time=TIME, q=q)
    motion = read_motion(tmp_path / "c.npz", robot)
    np.testing.assert_allclose(motion.joints[:, k], angle)
    series = analyze(motion, cutoff=None)
    np.testing.assert_allclose(series.q[:, start : start + 2], q[:, start : start + 2], atol=1e-12)
    np.testing.assert_allclose(series.v[:, 6 + k], 0.05 * RATE, atol=1e-8)


# ---------------------------------------------------------------------- what is refused


def refused(path: Path, robot: Robot, *words: str, **options: object) -> RecordingError:
    with pytest.raises(RecordingError) as caught:
        read_motion(path, robot, **options)
    for word in (path.name, *words):
        assert word in str(caught.value)
    return caught.value


def test_missing_joints_are_named(hoap2, columns, write: Write) -> None:
    del columns["left_elbow_pitch"], columns["head_yaw"]
    assert refused(write(columns), hoap2, "left_elbow_pitch", "head_yaw", "standing")
    with pytest.raises(UnknownNameError, match="sitting"):
        read_motion(write(columns), hoap2, missing="sitting")


def test_unknown_joint_has_a_suggestion(hoap2, joints, columns, write: Write) -> None:
    columns |= {"left_nee_pitch": TIME}
    with pytest.raises(UnknownNameError, match="did you mean 'left_knee_pitch'"):
        read_motion(write(columns), hoap2)
    assert read_motion(write(columns), hoap2, ignore=["left_nee*"]).joints.shape == joints.shape


def test_nan_names_column_and_row(hoap2, joints, columns, write: Write) -> None:
    joints[17, 3] = np.nan
    error = refused(write(columns), hoap2, "NaN", "fill")
    assert (error.column, error.row, error.line) == (hoap2.joint_names[3], 18, 19)


def test_infinite_is_never_filled(hoap2, joints, columns, write: Write) -> None:
    joints[17, 3] = np.inf
    error = refused(write(columns), hoap2, "infinite", fill=True)
    assert (error.column, error.row) == (hoap2.joint_names[3], 18)


@pytest.mark.parametrize(("value", "row"), [(TIME[20], 22), (TIME[3], 22), (np.nan, 22)])
def test_times_must_increase(hoap2, columns, write: Write, value: float, row: int) -> None:
    columns["time"] = TIME.copy()
    columns["time"][21] = value
    error = refused(write(columns), hoap2, "time", fill=True)
    assert (error.column, error.row) == ("time", row)


def test_positions_past_limits_are_refused_with_a_hint_at_degrees(
    hoap2, joints, columns, write: Write
) -> None:
    k = hoap2.joint_names.index("left_knee_pitch")
    joints[30, k] = hoap2.limits.upper[k] + 0.12
    path = write(columns)
    error = refused(path, hoap2, "left_knee_pitch", "limits", "0.12")
    assert (error.column, error.row, error.line) == ("left_knee_pitch", 31, 32)
    assert "in degrees" not in str(error)
    assert read_motion(path, hoap2, beyond=0.13).joints[30, k] == joints[30, k]
    in_degrees = columns_of(hoap2, np.rad2deg(np.delete(joints, 30, axis=0)[[*range(59), 58]]))
    assert refused(write(in_degrees), hoap2, "in degrees?")
    assert read_motion(write(in_degrees), hoap2, degrees=True).time.size == COUNT


def test_small_excess_of_limits_is_told(hoap2, joints) -> None:
    k = hoap2.joint_names.index("left_knee_pitch")
    joints[:, k] = hoap2.limits.upper[k] + 0.05
    base = np.tile(hoap2.postures["standing"][:7], (COUNT, 1))
    series = analyze(Motion(hoap2, TIME, joints, base))
    assert series.past_limits == {"left_knee_pitch": pytest.approx(0.05)}
    series = analyze(Motion(hoap2, TIME, np.minimum(joints, hoap2.limits.upper), base))
    assert series.past_limits == {}


def test_missing_times_and_times_with_a_rate_are_refused(hoap2, columns, write: Write) -> None:
    assert refused(write(columns), hoap2, "time", rate=100.0)
    del columns["time"]
    assert refused(write(columns), hoap2, "'time'", "rate")
    with pytest.raises(InvalidInputError, match="rate"):
        read_motion(write(columns), hoap2, rate=0.0)


def test_contradicting_columns_are_refused(hoap2, columns, write: Write, rng) -> None:
    base = base_columns(rng)
    turns = {"head_yaw [turns]": columns["head_yaw"]}
    for changed, words in (
        (columns | {k: v for k, v in base.items() if k != "base_qw"}, ["base_qw"]),
        (columns | base | {"base_roll": TIME}, ["not both"]),
        (columns | {"t": TIME}, ["'t'", "'time'"]),
        ({k: v for k, v in columns.items() if k != "head_yaw"} | turns, ["turns", "deg"]),
    ):
        refused(write(changed), hoap2, *words)
    path = write(columns)
    path.write_text(path.read_text().replace("head_yaw", "head_pitch", 1))
    refused(path, hoap2, "head_pitch", "twice")
    base["base_qw"][5] += 0.5
    assert refused(write(columns | base), hoap2, "norm").row == 6


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["empty"]),
        ("time,a\n", ["no rows"]),
        ("time,a\n0,1\n1,2,3\n", ["row 2", "3 cells"]),
        ("time,a,b\n0,1\n1,2\n", ["row 1", "2 cells"]),
        ("time,a\n0,1\n\n1,x\n", ["'a'", "line 4", "'x' is not a number"]),
        ("time;a\n0;1,5\n", ["'1,5' is not a number; write decimals with a point"]),
        ("time head_yaw\n0 1\n", ["one column, 'time head_yaw'", "commas"]),
        ("0.0,1.0\n0.1,1.0\n", ["first line holds numbers"]),
        (",time\n0,0\n1,1\n", ["column 1 has no name"]),
    ],
)
def test_broken_csv_is_refused(hoap2, tmp_path: Path, text: str, words: list[str]) -> None:
    path = tmp_path / "broken.csv"
    path.write_text(text)
    assert refused(path, hoap2, *words)


def test_text_in_another_encoding_is_refused(hoap2, columns, write: Write) -> None:
    path = write(columns)
    path.write_text(path.read_text(), encoding="utf-16")
    assert refused(path, hoap2, "not text in UTF-8")


@pytest.mark.parametrize(
    ("head", "end"), [("# ", ""), ("# recorded on Monday\n", ""), ("\ufeff", ""), ("", ",")]
)
def test_comments_order_marks_and_last_commas_are_skipped(
    hoap2, joints, columns, write, head, end
) -> None:
    path = write(columns)
    path.write_text(head + path.read_text().replace("\n", f"{end}\n"), encoding="utf-8")
    np.testing.assert_allclose(read_motion(path, hoap2).joints, joints, rtol=1e-12)


def test_empty_cells_are_missing_numbers(hoap2, columns, write: Write) -> None:
    path = write(columns)
    lines = path.read_text().splitlines()
    lines[11] = re.sub(r"^([^,]*),[^,]*,", r"\1,,", lines[11])
    path.write_text("\n".join(lines))
    assert refused(path, hoap2, hoap2.joint_names[0]).line == 12
    assert len(read_motion(path, hoap2, fill=True).dropouts) == 1


@pytest.mark.parametrize("whole", [False, True])
def test_tracker_files_with_the_world_among_the_bodies_are_read(whole, hoap2, tmp_path) -> None:
    """As MuJoCo numbers them; holosoma's ``joint_pos`` are all of its ``qpos``."""
    place, turn = np.array([0.3, -0.2, 0.7]), np.array([0.5, 0.5, -0.5, 0.5])  # w x y z
    joints = np.tile(hoap2.limits.joint_positions(hoap2.posture("standing")), (COUNT, 1))
    base = np.tile(np.concatenate((place, turn)), (COUNT, 1))
    arrays = {
        "fps": np.array([50.0]),
        "joint_pos": np.hstack((base, joints)) if whole else joints,
        "joint_names": np.array(hoap2.joint_names),
        "body_names": np.array(["world", "base"]),
        "body_pos_w": np.tile([np.zeros(3), place], (COUNT, 1, 1)),
        "body_quat_w": np.tile([[1.0, 0.0, 0.0, 0.0], turn], (COUNT, 1, 1)),
    }
    np.savez(tmp_path / "a.npz", **arrays)
    motion = read_motion(tmp_path / "a.npz", hoap2)
    np.testing.assert_array_equal(motion.joints, joints)
    np.testing.assert_array_equal(motion.base, base[:, [0, 1, 2, 4, 5, 6, 3]])


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"time": TIME, "q": np.zeros((COUNT, 9))}, ["'q'", "(60, 9)", "another robot"]),
        ({"time": TIME[1:], "head_yaw": TIME}, ["60 rows", "59"]),
        (
            {k: v for k, v in TRACKED.items() if k != "joint_names"},
            ["'joint_pos'", "MuJoCo and PhysX", "joint_names"],
        ),
        (TRACKED | {"fps": np.zeros(1)}, ["'fps'", "no rate"]),
        (TRACKED | {"body_quat_w": np.ones((COUNT, 1, 3))}, ["'body_quat_w'", "bodies, 4"]),
        (TRACKED | {"body_pos_w": np.ones((9, 1, 3))}, ["'body_pos_w'", "(60, bodies, 3)"]),
        (TRACKED | {"joint_pos": np.zeros(COUNT)}, ["'joint_pos'", "(n, joints)"]),
        (TRACKED | {"joint_pos": np.float64(1.0)}, ["'joint_pos'", "(n, joints)"]),
        (TRACKED | {"joint_names": np.arange(3)}, ["'positions'", "expected (rows, 10)"]),
        (TRACKED | {"fps": np.array([np.nan])}, ["'fps'", "no rate"]),
        (TRACKED, ["no column for"]),
        ({"time": TIME, "head_yaw": np.zeros((COUNT, 2))}, ["head_yaw", "shape"]),
        ({"time": TIME, "names": ["head_yaw"], "positions": np.zeros((COUNT, 2))}, ["positions"]),
        ({"time": TIME, "head_yaw": np.array(["x"] * COUNT)}, ["head_yaw", "numbers"]),
        ({"time": TIME, "q": np.zeros((COUNT, 32), dtype=complex)}, ["'q'", "real numbers"]),
    ],
)
def test_broken_npz_is_refused(hoap2, tmp_path: Path, arrays: dict, words: list[str]) -> None:
    np.savez(tmp_path / "broken.npz", **arrays)
    assert refused(tmp_path / "broken.npz", hoap2, *words)


def test_missing_files_are_refused(hoap2, tmp_path: Path) -> None:
    (tmp_path / "x.npz").write_text("no zip")
    assert refused(tmp_path / "x.npz", hoap2, "cannot be read")
    assert refused(tmp_path / "absent.csv", hoap2, "cannot be read")
    assert refused(tmp_path / "walk.bvh", hoap2, ".csv or .npz")


def test_few_rows_are_refused(hoap2, joints, columns, write: Write) -> None:
    columns = {name: values[:5] for name, values in columns.items()}
    assert refused(write(columns), hoap2, "5 rows")
    with pytest.raises(InvalidInputError, match="5 rows"):
        Motion(hoap2, TIME[:5], joints[:5])
    with pytest.raises(InvalidInputError, match="increase"):
        Motion(hoap2, TIME[::-1], joints)


# ---------------------------------------------------------------------- dropouts


def test_gaps_in_time_are_filled_up_to_the_longest(hoap2, joints, columns, write: Write) -> None:
    kept = np.delete(np.arange(COUNT), slice(20, 26))  # six rows: 70 ms from row 19 to row 26
    columns = {name: values[kept] for name, values in columns.items()}
    motion = read_motion(write(columns), hoap2)
    (gap,) = motion.dropouts
    assert (gap.kind, gap.filled) == ("gap in time", True)
    assert (gap.start, gap.end) == pytest.approx((0.19, 0.26))
    np.testing.assert_allclose(motion.time, TIME, atol=1e-12)
    # PCHIP over 70 ms of sines of 5 rad/s: a parabola is off by A (w T)^2 / 8 = 1.5% at most.
    np.testing.assert_allclose(motion.joints, joints, atol=0.015 * 0.25)
    assert refused(write(columns), hoap2, "0.07", longest_gap=0.05)


def test_missing_numbers_are_filled_if_requested(hoap2, joints, columns, write: Write) -> None:
    true = joints.copy()
    joints[10:13, [2, 4]] = np.nan
    joints[40, 4] = np.nan
    motion = read_motion(write(columns), hoap2, fill=True)
    first, second = motion.dropouts
    assert first.kind == second.kind == "missing numbers"
    assert first.columns == (hoap2.joint_names[2], hoap2.joint_names[4])
    assert (first.start, first.end) == pytest.approx((0.09, 0.13))
    assert second.duration == pytest.approx(0.02)
    np.testing.assert_allclose(motion.joints, true, atol=0.002)
    path = write(columns)
    assert refused(path, hoap2, hoap2.joint_names[2], fill=True, longest_gap=0.03)
    joints[-1, 4] = np.nan
    assert refused(write(columns), hoap2, "beginning or end", fill=True)


def test_frozen_rows_are_reported(hoap2, joints, columns, write: Write) -> None:
    true = joints.copy()
    joints[31:35] = joints[30]
    path = write(columns)
    motion = read_motion(path, hoap2)
    (frozen,) = motion.dropouts
    assert (frozen.kind, frozen.filled) == ("frozen", False)
    assert (frozen.start, frozen.end) == pytest.approx((0.30, 0.35))
    assert frozen.columns and set(frozen.columns) <= set(hoap2.joint_names)
    np.testing.assert_allclose(motion.joints, joints)  # as recorded
    assert "left as recorded" in str(frozen)
    filled = read_motion(path, hoap2, fill=True)
    assert filled.dropouts[0].filled
    np.testing.assert_allclose(filled.joints, true, atol=0.004)


@pytest.mark.parametrize("base_too", [True, False])
def test_frozen_base_is_filled_with_the_joints(hoap2, columns, write, rng, base_too) -> None:
    columns |= (base := base_columns(rng))
    true = np.column_stack(list(base.values()))
    for name, values in columns.items():
        if name in hoap2.joint_names or (base_too and name in base):
            columns[name] = values.copy()
            columns[name][31:35] = values[30]
    motion = read_motion(write(columns), hoap2, fill=True)
    # PCHIP over 50 ms of 0.1 m and 0.2 rad at 1 rad/s; and where it was not frozen, as recorded.
    np.testing.assert_allclose(motion.base, true, atol=1e-4 if base_too else 1e-12)


def test_printed_gap_length_is_accepted(hoap2, columns, write: Write) -> None:
    kept = np.delete(np.arange(COUNT), slice(20, 35))
    columns = {name: values[kept] for name, values in columns.items()}
    columns["time"] = columns["time"] * 1.00123 + 1.7e9  # as computers count time
    told = str(refused(write(columns), hoap2, "1700000000.19"))
    longest = float(re.search(r"longest gap of (\S+) s", told)[1])
    (gap,) = read_motion(write(columns), hoap2, longest_gap=longest).dropouts
    assert longest - 0.01 < gap.duration <= longest


def test_gaps_too_long_to_fill_are_refused(hoap2, columns, write: Write) -> None:
    columns["time"] = np.where(TIME > 0.3, TIME + 1e6, TIME)
    with pytest.raises(InvalidInputError, match="1,000,000"):
        read_motion(write(columns), hoap2, longest_gap=1e7)


def test_rest_and_coarse_sensors_are_not_frozen(hoap2, joints, write: Write) -> None:
    ramp = np.clip((TIME - 0.2) / 0.1, 0.0, 1.0)[:, None]  # moves, then rests for good
    assert read_motion(write(columns_of(hoap2, joints[:1] + 0.1 * ramp)), hoap2).dropouts == ()
    coarse = np.round((joints[:1] + 0.05 * TIME[:, None]) / 0.004) * 0.004  # a step in 8 rows
    assert read_motion(write(columns_of(hoap2, coarse)), hoap2, beyond=0.01).dropouts == ()
