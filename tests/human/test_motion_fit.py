"""A human fitted to the markers of a known motion."""

import re
from dataclasses import replace

import numpy as np
import pytest

import wbc
from tests.human.walker import LABELS, marching, recorded, squatting, write_trc
from wbc.cli.analyze_report import verdict
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.human import HumanMotion, MarkerRecording, compared, human_motion, read_markers
from wbc.human.body import ANKLE_HEIGHT, HINGE_NAMES, HINGES, NAMES, SEGMENT_NAMES, HumanBody
from wbc.human.comparison import plates_mass
from wbc.human.contacts import cutoff_by_steps, feet_down
from wbc.human.fit import (
    PELVIS_TILT,
    MarkerSet,
    escape_local_minima,
    fit_poses,
    initial_poses,
    unwrap_joints,
    upright_trunk,
)
from wbc.human.kinematics import Poses, forward_kinematics, rotations
from wbc.human.landmarks import landmark, landmark_of, missing_landmarks
from wbc.human.marker_identification import identify_markers, rotate_z_up, with_labels_of
from wbc.human.markers import ForcePlate
from wbc.human.skeleton import configurations, human_robot
from wbc.motion import RmpSeries
from wbc.motion.ground import sole_corners
from wbc.motion.table import RecordingError
from wbc.robot import Robot

BODY = HumanBody.of(1.76, 72.0, "male")


def com_of(body: HumanBody, poses: object) -> np.ndarray:
    robot = human_robot(body)
    return np.array([robot.snapshot(q).com for q in configurations(robot, poses)])


def configurations_of(human: HumanMotion) -> np.ndarray:
    return np.hstack((human.motion.base, human.motion.joints))


def fitted_com(human: HumanMotion) -> np.ndarray:
    return np.array([human.motion.robot.snapshot(q).com for q in configurations_of(human)])


def markers_of(labels: list[str]) -> MarkerSet:
    marks = tuple(landmark(str(landmark_of(label))) for label in labels)
    places = BODY.scale * np.array([one.place for one in marks])
    return MarkerSet(tuple(labels), marks, places, BODY.dimensions)


def test_known_body_is_fitted_exactly() -> None:
    recording, truth = recorded(BODY, seconds=0.5)
    markers = markers_of(LABELS)
    start = initial_poses(recording.positions, markers)
    found, _ = fit_poses(start, recording.positions, markers)
    seen = (
        forward_kinematics(found, BODY.dimensions).origin
        - forward_kinematics(truth, BODY.dimensions).origin
    )
    # Joints lean to neutral by (10 mm / lever / spread)^2 of their angle: a mm or so.
    assert np.abs(seen).max() < 3e-3
    assert np.sqrt((seen**2).mean()) < 5e-4


def test_knees_and_elbows_by_joint_centres_bend_the_right_way() -> None:
    """The centres alone allow them to bend backwards, the limb turned by half a turn, as well."""
    limbs = [f"{s}{j}JC" for s in "LR" for j in ("H", "K", "A", "S", "E", "W")]
    labels = ["LASI", "RASI", "LPSI", "RPSI", "C7", "CLAV", "STRN", *limbs]
    rng, time = np.random.default_rng(1), np.arange(100) / 30.0
    ranges = {
        "hip_flexion": (-0.4, 2.2),
        "hip_adduction": (-0.7, 0.3),
        "hip_rotation": (-0.7, 0.5),
        "knee_flexion": (0.2, 2.5),
        "shoulder_lift": (-0.5, 2.0),
        "shoulder_swing": (-0.3, 1.2),
        "shoulder_rotation": (-0.8, 0.8),
        "elbow_flexion": (0.2, 2.3),
    }
    angles = np.zeros((100, len(HINGE_NAMES)))
    for name, (least, most) in ranges.items():
        for side in ("left", "right"):
            angles[:, HINGE_NAMES.index(f"{side}_{name}")] = rng.uniform(least, most, 100)
    posed = Poses(np.zeros((100, 3)), rotations(0.4 * rng.standard_normal((100, 3))), angles)
    recording, _ = recorded(BODY, labels=labels, posed=(time, posed))
    markers = markers_of(labels)
    start = initial_poses(recording.positions, markers)
    found, _ = fit_poses(start, recording.positions, markers)
    for name in ("knee_flexion", "elbow_flexion"):
        both = [HINGE_NAMES.index(f"{side}_{name}") for side in ("left", "right")]
        assert (found.angles[:, both] > 0.0).all(), name


def test_frames_in_local_minima_are_refitted_from_their_neighbours() -> None:
    recording, truth = recorded(BODY, posed=squatting(rate=25.0))
    markers = markers_of(LABELS)
    wrong = truth.angles.copy()
    hip, knee = (HINGE_NAMES.index(f"left_{n}") for n in ("hip_rotation", "knee_flexion"))
    for frames in (slice(20, 30), slice(68, 82)):
        wrong[frames, hip] += np.pi
        wrong[frames, knee] *= -1.0
    start = Poses(truth.position, truth.rotation, wrong)
    stuck, cost = fit_poses(start, recording.positions, markers)
    found = escape_local_minima(stuck, cost.copy(), recording.positions, markers)
    assert (stuck.angles[22:28, knee] < 0.0).all()  # or the test would be none
    assert np.abs(found.angles[:, knee] - truth.angles[:, knee]).max() < 0.05


Marched = tuple[MarkerRecording, tuple[HumanBody, Poses], HumanMotion]


@pytest.fixture(scope="module")
def marched() -> Marched:
    """A body that is not usual, markers 0.6 spreads beside where they should be, 1 mm of noise."""
    rng = np.random.default_rng(3)
    usual = HumanBody.of(1.82, 72.0, "male")
    sizes = usual.dimensions * (1.0 + 0.02 * rng.standard_normal(len(NAMES)))
    body = HumanBody(sizes, 72.0, 1.82, "male")
    recording, poses = recorded(body, off=0.6, noise=1e-3, seed=5, plates=True)
    holes = recording.positions.copy()
    k = LABELS.index
    holes[100:106, k("LKNE")] = np.nan  # short: interpolated
    holes[150:210, k("C7")] = np.nan  # long: follows the fit
    holes[60:70, [k("LANK"), k("LTOE")]] = holes[60:70, [k("LTOE"), k("LANK")]]
    holes[240, k("C7")] += 0.6  # a ghost
    return recording, (body, poses), human_motion(replace(recording, positions=holes))


@pytest.mark.slow
def test_unknown_body_is_calibrated(marched: Marched) -> None:
    _, (body, poses), human = marched
    assert human.rms < 6e-3
    off = np.abs(human.body.dimensions - body.dimensions)
    lengths = [NAMES.index(name) for name in ("thigh", "shank", "upper_arm", "forearm")]
    assert off[lengths].max() < 0.03  # of 0.3 to 0.45 m: markers hide the rest
    off = fitted_com(human) - com_of(body, poses)
    assert np.sqrt((off**2).sum(axis=1).mean()) < 0.02
    assert np.sqrt(((off - off.mean(axis=0)) ** 2).sum(axis=1).mean()) < 5e-3


@pytest.mark.slow
def test_missing_and_swapped_markers_are_repaired_and_told(marched: Marched) -> None:
    _, _, human = marched
    told = {(one.kind, one.columns) for one in human.motion.dropouts}
    assert ("missing numbers", ("LKNE",)) in told
    assert ("missing numbers", ("C7",)) in told
    assert ("swapped markers", ("LANK", "LTOE")) in told
    assert ("ghost", ("C7",)) in told
    joints = human.motion.robot.joint_names
    knees = [joints.index(f"left_{name}") for name in ("knee_flexion", "ankle_dorsiflexion")]
    jumps = np.diff(human.motion.joints[:, knees], n=2, axis=0)
    # Noise of 1 mm makes 0.02 rad of the ankle; a swap that was followed would be several tenths.
    assert np.abs(jumps).max() < 0.1


@pytest.mark.slow
def test_forces_are_those_of_the_true_motion(marched: Marched) -> None:
    recording, (body, _), human = marched
    assert human.body.mass == pytest.approx(body.mass, rel=0.01)  # weighed by the plate
    series = wbc.analyze(human.motion, cutoff=6.0, noise=human.noise, feet=None)
    plate = recording.plates[0].force
    inner = slice(40, -40)
    off = series.ground_force[inner] - plate[inner]
    rms = np.sqrt((off**2).mean(axis=0))
    assert rms[2] < 0.02 * plate[:, 2].max()
    assert rms[:2].max() < 0.02 * plate[:, 2].max()
    held = np.abs(off) < 1.96 * series.uncertainty.momentum_rate[inner, :3]
    assert held.mean() > 0.85


@pytest.mark.slow
def test_plates_without_all_of_the_force_are_not_compared(marched: Marched) -> None:
    _, _, human = marched
    series = wbc.analyze(human.motion, cutoff=6.0, noise=None, feet=None)
    nowhere = np.zeros((len(human.motion.time), 2), dtype=bool)
    assert compared(series, human.recording.plates, nowhere, human.motion.time) is None
    assert compared(series, (), human.down, human.motion.time) is None


def below(human: HumanMotion) -> np.ndarray:
    """Return where the left sole is above the ground (n, 3) [m], at its height 0."""
    robot, q = human.motion.robot, configurations_of(human)
    frame = robot.feet["left"].frame
    return np.array([robot.snapshot(one).position(frame) * (1.0, 1.0, 0.0) for one in q])


@pytest.mark.slow
def test_frames_near_a_foot_beside_the_plates_are_not_compared(marched: Marched) -> None:
    _, _, human = marched
    series = wbc.analyze(human.motion, cutoff=6.0, noise=None, feet=None)
    time = human.motion.time
    force = np.where(time[:, None] < 1.5, 0.0, human.recording.plates[0].force)
    plate = ForcePlate("plate", time, force, np.cross(below(human), force))
    found = compared(series, (plate,), np.tile((True, False), (len(time), 1)), time)
    assert found is not None
    # What the low-pass carries of the missing force into the frames beside it is 9 % at its edge.
    assert np.abs(found.force_error[:, 2]).max() < 0.03 * found.force[:, 2].max()


@pytest.mark.slow
@pytest.mark.parametrize("offset", [20.0, -60.0])  # N, the larger known by the plate's place
def test_offset_of_an_unloaded_plate_is_subtracted_and_noted(offset: float) -> None:
    recording, _ = recorded(BODY, seconds=2.0, plates=True)
    (plate,) = recording.plates
    read = np.tile((3.0, 0.0, offset), (len(plate.time), 1))
    corners = np.array(((4.6, 0.4, 0.0), (4.0, 0.4, 0.0), (4.0, 0.0, 0.0), (4.6, 0.0, 0.0)))
    drifted = ForcePlate("beside", plate.time, read, 0.3 * read, corners)
    human = human_motion(recording.with_plates((plate, drifted)))
    assert f"offsets of unloaded plates subtracted: beside {abs(offset):.0f} N" in human.notes
    assert np.abs(human.recording.plates[1].force).max() < 1e-9
    assert human.body.mass == pytest.approx(BODY.mass, rel=0.01)


@pytest.mark.slow
def test_mass_that_a_file_tells_is_taken_where_plates_do_not_weigh() -> None:
    recording, _ = recorded(BODY, seconds=2.0, plates=True)
    told = replace(recording, mass=61.5)
    alone = human_motion(told.with_plates(()))
    assert alone.body.mass == 61.5
    assert "mass 61.5 kg, as its file says (there are no force plates)" in alone.notes
    weighed = human_motion(told)
    assert weighed.body.mass == pytest.approx(BODY.mass, rel=0.01)
    assert any("its file says that it has 61.5 kg" in note for note in weighed.notes)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "told"), [(0.2248, "kg are usual"), (1e-3, "N at most: are their forces in N")]
)
def test_plates_in_other_units_are_doubted(factor: float, told: str) -> None:
    recording, _ = recorded(BODY, seconds=2.0, plates=True)
    (plate,) = recording.plates
    other = replace(plate, force=factor * plate.force, moment=factor * plate.moment)
    notes = human_motion(recording.with_plates((other,))).notes
    assert any(told in note for note in notes), notes


@pytest.mark.slow
def test_plates_with_other_axes_than_the_markers_are_noted() -> None:
    recording, _ = recorded(BODY, seconds=2.0, plates=True)
    (plate,) = recording.plates
    y_up = np.array(((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)))
    human = human_motion(recording.with_plates((plate.rotated(y_up),)))
    assert any("force plates push sideways" in note for note in human.notes)


@pytest.mark.slow
@pytest.mark.parametrize("away", [0.0, 1.0])
def test_plates_that_push_away_from_the_feet_are_noted(away: float) -> None:
    recording, _ = recorded(BODY, seconds=2.0, plates=True)
    (plate,) = recording.plates
    moment = plate.moment + np.cross((0.0, away, 0.0), plate.force)
    moved = ForcePlate("plate", plate.time, plate.force, moment)
    notes = human_motion(recording.with_plates((moved,))).notes
    assert any("force plates push where no foot is in 100 %" in one for one in notes) == (away > 0)


def test_a_plate_between_feet_far_apart_carries_both() -> None:
    time, poses = squatting(2.0)
    angles = np.zeros_like(poses.angles)
    for side, lean in (("left", 0.45), ("right", -0.45)):
        angles[:, HINGE_NAMES.index(f"{side}_hip_flexion")] = lean
        angles[:, HINGE_NAMES.index(f"{side}_ankle_dorsiflexion")] = -lean
    sway = 0.01 * np.sin(2.0 * time)
    position = np.column_stack((sway, 0.0 * sway, np.full(len(time), 0.83)))
    still = Poses(position, np.tile(np.eye(3), (len(time), 1, 1)), angles)
    recording, _ = recorded(BODY, posed=(time, still), plates=True)
    human = human_motion(recording)
    assert human.body.mass == pytest.approx(BODY.mass, rel=0.01)
    assert not any("force plates push" in note for note in human.notes)


@pytest.mark.slow
def test_late_plates_are_told_and_bands_contain_their_delay(marched: Marched) -> None:
    _, _, human = marched
    series = wbc.analyze(human.motion, cutoff=6.0, noise=human.noise, feet=None)
    time, force, soles = human.motion.time, human.recording.plates[0].force, below(human)
    moment = np.cross(soles, force)
    down = np.tile((True, False), (len(time), 1))
    late = []
    for by in (0.0, 0.012):
        found = compared(series, (ForcePlate("plate", time + by, force, moment),), down, time)
        assert found is not None
        late.append(found.late)
    assert late[1] - late[0] == pytest.approx(0.012, abs=0.002)
    stands = np.tile(force.mean(axis=0), (len(time), 1))  # tells nothing of clocks
    still = compared(series, (ForcePlate("plate", time, stands, moment),), down, time)
    assert still is None or np.isnan(still.late)
    punctual = replace(human.noise, late=0.0)
    other = wbc.analyze(human.motion, cutoff=6.0, noise=punctual, feet=None)
    wider = series.uncertainty.momentum_rate**2 - other.uncertainty.momentum_rate**2
    rate = np.gradient(series.ground_force, series.time, axis=0)
    np.testing.assert_allclose(wider[:, :3], (human.noise.late * rate) ** 2, atol=1e-3)


@pytest.mark.slow
def test_frames_with_a_foot_over_the_edge_of_a_plate_are_not_compared(marched: Marched) -> None:
    _, _, human = marched
    series = wbc.analyze(human.motion, cutoff=6.0, noise=None, feet=None)
    time, force, soles = human.motion.time, human.recording.plates[0].force, below(human)
    moment = np.cross(soles, force)
    down = np.tile((True, False), (len(time), 1))
    square = np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0]])
    frames = []
    for corners in (None, 3.0 * square, 3.0 * square + soles[0] - (0.0, 3.0, 0.0)):
        plate = ForcePlate("plate", time, force, moment, corners)
        found = compared(series, (plate,), down, time)
        frames.append(0 if found is None else len(found.time))
    assert frames[1] == frames[0] > 100
    # The third one's edge is under the middle of the sole at first: it is left while it is over it.
    over = np.abs(soles[:, 1] - soles[0, 1]) < 0.02
    assert over.sum() > 20 and frames[2] <= frames[0] - over.sum()


def quiet_stand() -> tuple[RmpSeries, np.ndarray, np.ndarray, np.ndarray]:
    """Return a human who stands for 2 s: its series, times, force, and where the feet are."""
    moment = np.arange(200) / 100.0
    high = BODY.size("thigh") + BODY.size("shank") + ANKLE_HEIGHT * BODY.scale
    place_ = np.column_stack((0.005 * np.sin(3.0 * moment), 0.0 * moment, np.full(200, high)))
    poses = Poses(place_, np.tile(np.eye(3), (200, 1, 1)), np.zeros((200, len(HINGES))))
    human = human_motion(recorded(BODY, posed=(moment, poses))[0], mass=72.0)
    series = wbc.analyze(human.motion, cutoff=4.0, noise=None, feet=None)
    time, robot = human.motion.time, human.motion.robot
    q = configurations_of(human)[0]
    feet = np.array([robot.snapshot(q).position(robot.feet[s].frame) for s in ("left", "right")])
    return series, time, np.tile((0.0, 0.0, robot.weight), (len(time), 1)), feet


def test_plate_with_its_cop_under_one_foot_does_not_carry_the_other() -> None:
    """Without corners nothing else tells that the other foot stands beside the plate."""
    series, time, force, feet = quiet_stand()
    down = np.ones((len(time), 2), dtype=bool)
    found = []
    for spot in (feet[0], feet.mean(axis=0)):
        plate = ForcePlate("plate", time, force, np.cross(spot, force))
        found.append(compared(series, (plate,), down, time))
    assert found[0] is None and found[1] is not None and len(found[1].time) > 20


def test_noise_of_an_empty_plate_is_no_load() -> None:
    series, time, force, feet = quiet_stand()
    plate = ForcePlate("plate", time, force, np.cross(feet.mean(axis=0), force))
    clock = np.linspace(time[0], time[-1], 2000)
    noise = np.random.default_rng(0).normal(scale=20.0, size=(2000, 3))
    down = np.ones((len(time), 2), dtype=bool)
    plates = (plate, ForcePlate("empty", clock, noise, np.cross((2.0, 0.0, 0.0), noise)))
    found, alone = (compared(series, some, down, time) for some in (plates, (plate,)))
    assert found is not None and alone is not None
    np.testing.assert_array_equal(found.time, alone.time)


@pytest.mark.parametrize("given", ["cal:{}", "P01_{}", "{}"])
def test_markers_of_a_static_trial_are_those_of_the_recording(given: str) -> None:
    recording, _ = recorded(BODY, seconds=0.2)
    others = {"LKNE": "lkne", "RKNE": "RKNE_med"}
    labels = tuple(given.format(others.get(label, label)) for label in recording.labels)
    found = with_labels_of(replace(recording, labels=labels), recording)
    expected = ["RKNE_med" if label == "RKNE" else label for label in recording.labels]
    assert list(found.labels) == expected


def test_static_trial_of_legs_alone_is_upright_by_the_axis_that_is_given() -> None:
    """It was "along (nan, nan, nan)", with warnings of NumPy."""
    recording, _ = recorded(BODY, seconds=0.2)
    shanks = recording.columns(("LTIB", "RTIB"))
    places = recording.positions[:, shanks]
    legs = replace(recording, labels=("LTIB", "RTIB"), positions=places, up=None)
    markers, _ = identify_markers(recording, legs)
    stood, notes = rotate_z_up(legs, markers, "z")
    np.testing.assert_array_equal(stood.positions, places)
    assert notes == ()
    with pytest.raises(RecordingError, match=r"no marker .* say which axis is up"):
        rotate_z_up(legs, markers, None)


def test_human_who_sits_at_times_has_the_mass_of_the_other_times_with_a_note() -> None:
    series, time, force, feet = quiet_stand()
    down, spot = np.ones((len(time), 2), dtype=bool), feet.mean(axis=0)
    sits = force * np.where(time < 0.7, 0.2, 1.0)[:, None]
    weighed = [
        plates_mass(series, (ForcePlate("plate", time, one, np.cross(spot, one)),), down)
        for one in (force, sits)
    ]
    assert [mass for mass, _ in weighed] == pytest.approx([72.0, 72.0], rel=0.01)
    assert not weighed[0][1] and "something else, as a seat, carries" in weighed[1][1][0]


@pytest.mark.slow
def test_squats_with_clusters_on_thighs_and_shanks_are_fitted() -> None:
    """Where a cluster's markers are is not known: they must not turn the first postures."""
    few = [n for n in LABELS if n[1:] not in ("THI", "TIB", "FHD", "BHD")]
    few = [n for n in few if n not in ("T10", "CLAV", "STRN")]
    more = [f"{side}{part}{k}" for side in "LR" for part in ("TH", "SH") for k in range(1, 5)]
    labels = [*few, "LHJC", "RHJC", *more]
    recording, _ = recorded(BODY, labels=labels, off=1.0, noise=1e-3, seed=4, posed=squatting())
    human = human_motion(recording, mass=72.0)
    assert human.rms < 3e-3  # 1.7 mm of noise in three axes; knees bent backwards: 10 mm
    knees = [human.motion.robot.joint_names.index(f"{s}_knee_flexion") for s in ("left", "right")]
    # Bent by 0.1 to 2.1, as far as markers tell where a straight knee is.
    bent = human.motion.joints[:, knees]
    assert (np.abs(bent.min(axis=0) - 0.1) < 0.2).all()
    assert (np.abs(bent.max(axis=0) - 2.1) < 0.2).all()


def test_human_is_fitted_only_while_in_view() -> None:
    recording, _ = recorded(BODY, seconds=1.0)
    here = recording.positions.copy()
    here[:35] = here[80:] = np.nan
    here[35:40, :10] = np.nan  # not all of it at once
    human = human_motion(replace(recording, positions=here), mass=72.0)
    assert human.motion.time[[0, -1]] == pytest.approx(recording.time[[35, 79]])
    assert any("0.35 to 0.79 s" in note for note in human.notes)
    assert human.rms < 5e-3


def test_cuts_that_leave_few_frames_are_refused_with_their_reason() -> None:
    """One frame in view was an IndexError in a quantile."""
    recording, _ = recorded(BODY, seconds=0.5)
    hidden, spliced = recording.positions.copy(), recording.positions.copy()
    hidden[:20] = hidden[21:] = np.nan
    spliced += (np.arange(50) // 5)[:, None, None]
    for here, words in ((hidden, "1 of 50 frames.*not seen"), (spliced, "5 of 50 frames.*jumps")):
        with pytest.raises(InvalidInputError, match=words):
            human_motion(replace(recording, positions=here))


def test_what_a_short_recording_does_not_tell_is_said() -> None:
    """That plates do not weigh the human was said to be for want of feet on them."""
    notes = human_motion(recorded(BODY, seconds=0.2, plates=True)[0]).notes
    assert any("0.19 s are too short to tell forces" in note for note in notes)


def test_frames_that_a_file_leaves_out_are_told() -> None:
    """A spline bridged them in silence."""
    recording, _ = recorded(BODY, seconds=3.0)
    kept = np.r_[0:60, 65:130, 152:300]
    human = human_motion(
        replace(recording, time=recording.time[kept], positions=recording.positions[kept]),
        mass=72.0,
    )
    assert human.motion.time == pytest.approx(recording.time)
    gaps = {(round(one.start, 2), round(one.end, 2)) for one in human.motion.dropouts}
    assert gaps == {(0.59, 0.65), (1.29, 1.52)}
    assert any("from 1.30 to 1.51 s too few markers are seen" in one for one in human.notes)


@pytest.mark.parametrize(("apart", "cutoff"), [(0.5, 4.8), (0.02, 6.0), (2.0, 6.0)])
def test_two_touchdowns_of_a_short_recording_are_a_step(apart: float, cutoff: float) -> None:
    """They had the cutoff without steps: forces of one stride were a third farther off."""
    time = np.arange(300) / 100.0
    down = np.column_stack((time >= 0.5, time >= 0.5 + apart))
    assert cutoff_by_steps(down, time) == pytest.approx(cutoff)
    assert cutoff_by_steps(~down, time) == pytest.approx(cutoff)


@pytest.mark.parametrize("lost", ["all", "forearm"])
def test_body_moves_on_while_its_markers_are_not_seen(lost: str) -> None:
    """Without markers frames had the posture of a key frame: the body jumped, with 4 kN."""
    recording, _ = recorded(BODY, seconds=3.0)
    forearm = ("RELB", "RWRA", "RWRB", "RFIN")
    hidden = [k for k, label in enumerate(LABELS) if lost == "all" or label in forearm]
    positions = recording.positions + recording.time[:, None, None] * (1.2, 0.0, 0.0)
    whole = human_motion(replace(recording, positions=positions), mass=72.0, by_steps=False)
    positions = positions.copy()
    positions[130:152, hidden] = np.nan
    human = human_motion(replace(recording, positions=positions), mass=72.0, by_steps=False)
    off = np.abs(configurations_of(human) - configurations_of(whole))[130:152]
    assert off.max() < 0.2  # rad
    assert off[:, :3].max() < 0.02
    note = "from 1.30 to 1.51 s too few markers are seen"
    assert any(note in one for one in human.notes) == (lost == "all")


@pytest.mark.slow
@pytest.mark.parametrize("rate", [100, 25])
def test_t_pose_before_the_motion_is_dropped_with_a_note(rate: int) -> None:
    """As files of animation begin with a T-pose, away from where the motion begins."""
    whole, _ = recorded(BODY, seconds=1.0)
    step = 100 // rate
    time, places = whole.time[::step], whole.positions[::step]
    first = places[0].copy()
    first[[whole.labels.index(n) for n in ("LELB", "LWRA", "LWRB", "LFIN")]] += (0.0, 0.4, 0.4)
    first += (-0.25, 0.1, 0.0)
    before = np.append(time[0] - step / 100, time)
    found, truth = (
        human_motion(replace(whole, time=t, positions=at))
        for t, at in ((before, np.concatenate((first[None], places))), (time, places))
    )
    np.testing.assert_array_equal(found.motion.time, truth.motion.time)
    np.testing.assert_array_equal(found.motion.base, truth.motion.base)
    assert any("jumps at 0.000 s" in note for note in found.notes)
    assert not any("leaps" in note for note in truth.notes)


@pytest.mark.slow
def test_spliced_recordings_are_cut_to_the_longest_part() -> None:
    whole, _ = recorded(BODY, seconds=1.0)
    places = whole.positions.copy()
    places[30:] += (1.0, -0.5, 0.0)
    found = human_motion(replace(whole, positions=places))
    assert found.motion.time[0] == 0.3 and len(found.motion.time) == 70
    assert any("jumps at 0.300 s" in note and "0.990 s" in note for note in found.notes)


@pytest.mark.slow
def test_a_frame_in_which_the_whole_body_is_elsewhere_is_left_out() -> None:
    """Nobody was told, and the ground had to push with 1.6 times the weight and more."""
    whole, _ = recorded(BODY, seconds=1.0)
    places = whole.positions.copy()
    places[40] += (5.0, -5.0, 5.0)
    found, truth = (human_motion(replace(whole, positions=at)) for at in (places, whole.positions))
    assert np.abs(found.motion.base - truth.motion.base).max() < 2e-3
    assert any("one frame, at 0.400 s" in note for note in found.notes)
    assert not any("one frame" in note for note in truth.notes)


@pytest.mark.slow
def test_joints_of_a_skeleton_are_never_swapped() -> None:
    whole, _ = recorded(BODY, seconds=1.0)
    places, k = whole.positions.copy(), whole.labels.index
    places[40:, [k("LANK"), k("LTOE")]] = places[40:, [k("LTOE"), k("LANK")]]
    marks = tuple(landmark(str(landmark_of(label))) for label in whole.labels)
    for given, told in (((), True), (marks, False)):
        seen = replace(whole, positions=places, landmarks=given)
        kinds = {one.kind for one in human_motion(seen).motion.dropouts}
        assert ("swapped markers" in kinds) is told


def test_segment_axes_of_plug_in_gait_are_no_markers() -> None:
    recording, _ = recorded(BODY, seconds=0.1)
    axes = tuple(f"{side}CL{end}" for side in "LR" for end in "OALP")
    places = np.zeros((len(recording.time), len(axes), 3))
    both = np.concatenate((recording.positions, places), axis=1)
    seen = MarkerRecording(recording.time, recording.labels + axes, both, up="z")
    markers, notes = identify_markers(seen, None)
    assert tuple(markers) == recording.labels and "LCLA" in notes[0]


def test_y_up_in_mm_is_recognised(tmp_path) -> None:  # type: ignore[no-untyped-def]
    recording, _ = recorded(BODY, seconds=0.15)
    write_trc(tmp_path / "march.trc", recording)
    read = read_markers(tmp_path / "march.trc")
    assert read.labels == tuple(LABELS)
    turned = read.upright("y").positions
    np.testing.assert_allclose(turned, recording.positions, atol=6e-7)  # three decimals of mm
    human = human_motion(read, mass=72.0)
    assert any("y taken for up" in note for note in human.notes)
    assert human.motion.base[:, 2].mean() == pytest.approx(0.93, abs=0.03)


@pytest.mark.parametrize(
    ("axes", "signs", "words"),
    [
        # As Unity writes them: a human of 2 mm of residual would walk backwards.
        ((0, 2, 1), (1.0, 1.0, 1.0), "left-handed"),
        ((1, 0, 2), (1.0, 1.0, 1.0), "left-handed"),
        ((0, 2, 1), (1.0, -1.0, 1.0), "its y axis points down"),
    ],
)
def test_axes_of_other_worlds_are_refused(axes, signs, words) -> None:
    recording, _ = recorded(BODY, seconds=0.1)
    with pytest.raises(RecordingError, match=words):
        human_motion(replace(recording, positions=recording.positions[:, :, axes] * signs, up=None))


def test_given_axis_that_is_not_up_is_noted() -> None:
    recording, _ = recorded(BODY, seconds=0.1)
    seen = replace(recording, up=None)
    said = "x taken for up, as given, but the trunk is along z of the feet"
    assert any(said in note for note in human_motion(seen, mass=72.0, up="x").notes)
    assert not any("taken for up" in n for n in human_motion(seen, mass=72.0, up="z").notes)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_axes_that_point_down_may_be_given(axis: str) -> None:
    recording, _ = recorded(BODY, seconds=0.1)
    upright = human_motion(recording, mass=72.0)
    down = np.roll(recording.positions * (-1.0, 1.0, -1.0), "zxy".index(axis), axis=2)
    human = human_motion(replace(recording, positions=down, up=None), mass=72.0, up=f"-{axis}")
    assert not any("taken for up" in note for note in human.notes)
    np.testing.assert_allclose(human.motion.base[:, 2], upright.motion.base[:, 2], atol=1e-3)


def test_impossible_speed_is_noted() -> None:
    recording, _ = recorded(BODY, seconds=0.3)
    for speed, told in ((9.0, False), (90.0, True)):
        ahead = recording.positions + recording.time[:, None, None] * (speed, 0.0, 0.0)
        notes = human_motion(replace(recording, positions=ahead), mass=72.0).notes
        assert any("moves at 90 m/s" in note for note in notes) is told


@pytest.mark.parametrize("given", [{"stature": 176.0}, {"mass": 72e3}, {"mass": 706.0}])
def test_mass_and_stature_in_another_unit_are_refused(given: dict[str, float]) -> None:
    recording, _ = recorded(BODY, seconds=0.1)
    with pytest.raises(InvalidInputError, match="no human's"):
        human_motion(recording, **given)  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("rise", [0.0, 0.3])
def test_feet_standing_at_several_heights_are_noted(rise: float) -> None:
    time = np.arange(120) / 50.0
    up = rise * np.clip(time - 1.0, 0.0, 0.4) / 0.4  # on a box, as if it were lifted
    position = np.column_stack((0.0 * time, 0.0 * time, 0.93 + up))
    angles = np.zeros((len(time), len(HINGES)))
    poses = Poses(position, np.tile(np.eye(3), (len(time), 1, 1)), angles)
    recording, _ = recorded(BODY, posed=(time, poses))
    notes = human_motion(recording, mass=72.0).notes
    assert any("feet stand at heights of" in note for note in notes) is bool(rise)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("frames", [range(1), range(0, 100, 3)])
def test_bands_are_finite_without_motion_and_with_rare_markers(frames: range) -> None:
    recording, _ = recorded(BODY, seconds=1.0, noise=1e-3)
    places = recording.positions.copy()
    if len(frames) == 1:
        places[:] = places[0]
    else:  # each marker in a third of the frames
        for k in range(len(LABELS)):
            places[np.setdiff1d(np.arange(100), np.array(frames) + k % 3), k] = np.nan
    human = human_motion(replace(recording, positions=places), mass=72.0)
    series = wbc.analyze(human.motion, cutoff=human.cutoff, noise=human.noise)
    assert series.uncertainty is not None and np.isfinite(series.uncertainty.cop).all()


def test_pulling_ground_and_low_frame_rate_are_noted() -> None:
    recording, _ = recorded(BODY, seconds=2.0)
    hop = 0.08 * np.sin(6.0 * np.pi * recording.time)[:, None, None] * (0.0, 0.0, 1.0)
    for by, high, told in (
        (1.0, 0.0, ""),
        (1.0, hop, "pull by 1"),
        (40.0, 0.0, "2.5 frames a sec"),
    ):
        slow = replace(recording, time=by * recording.time, positions=recording.positions + high)
        notes = human_motion(slow, mass=72.0).notes
        found = [note for note in notes if "pull by" in note or "frames a sec" in note]
        assert len(found) == bool(told) and all(told in note for note in found)


def test_plates_that_weigh_another_mass_are_noted() -> None:
    recording, _ = recorded(BODY, seconds=2.0, plates=True)
    for mass, told in ((72.0, False), (158.7, True)):  # pounds
        notes = human_motion(recording, mass=mass).notes
        assert any("weighed 7" in n and "158.7 kg was given" in n for n in notes) is told


def test_markers_of_no_human_are_refused_or_noted() -> None:
    recording, _ = recorded(BODY, seconds=0.5)
    places, k = recording.positions.copy(), recording.labels.index
    swapped = [k(name) for name in ("LKNE", "LANK", "RKNE", "RANK")]
    places[:, swapped] = places[:, [swapped[j] for j in (1, 0, 3, 2)]]
    with pytest.raises(InvalidInputError, match="off any human, whose shank would be"):
        human_motion(replace(recording, positions=places))


OPTITRACK = (  # its baseline set: places by what Motive shows them on
    "WaistLFront left_asis WaistRFront right_asis WaistLBack left_psis WaistRBack right_psis"
    " BackTop spine_high Chest xiphoid BackLeft left_scapula HeadTop head_top LShoulderTop"
    " left_acromion RShoulderTop right_acromion LUArmHigh left_upper_arm LElbowOut"
    " left_elbow_lateral LWristIn left_wrist LHandOut left_hand LThigh left_thigh LKneeOut"
    " left_knee_lateral RKneeOut right_knee_lateral LShin left_shank LAnkleOut left_ankle_lateral"
    " RAnkleOut right_ankle_lateral LHeel left_heel LToeOut left_metatarsal_5 LToeIn"
    " left_metatarsal_1 LToeTip left_toe RToeTip right_toe"
)
QUALISYS = (  # its animation set
    "WaistLFront left_asis WaistRFront right_asis WaistBack sacrum SpineTop spine_high Chest"
    " xiphoid LShoulderTop left_acromion RShoulderTop right_acromion HeadL left_ear LKneeOut"
    " left_knee_lateral RKneeOut right_knee_lateral LAnkleOut left_ankle_lateral RAnkleOut"
    " right_ankle_lateral LHeelBack left_heel LForefootOut left_metatarsal_5 RForefootIn"
    " right_metatarsal_1"
)
XSENS = (
    "pRightASI right_asis pLeftASI left_asis pSacrum sacrum pRightCSI right_iliac_crest pIJ jugular"
    " pPX xiphoid pC7SpinalProcess c7 pT8SpinalProcess spine pRightAcromion right_acromion"
    " pRightArmLatEpicondyle right_elbow_lateral pLeftUlnarStyloid left_wrist_ulnar"
    " pLeftKneeLatEpicondyle left_knee_lateral pRightKneeMedEpicondyle right_knee_medial"
    " pLeftLatMalleolus left_ankle_lateral pRightLatMalleolus right_ankle_lateral pLeftHeelFoot"
    " left_heel pLeftFirstMetatarsal left_metatarsal_1 pRightToe right_toe"
)
WISCONSIN = (  # of OpenSim's models of Lenhart (2015)
    "R.ASIS right_asis L.ASIS left_asis S2 sacrum R.Clavicle right_clavicle R.Mkn right_knee_medial"
    " R.Knee right_knee_lateral L.Knee left_knee_lateral R.Man right_ankle_medial"
    " R.Ankle right_ankle_lateral L.Ankle left_ankle_lateral R.MT0 right_metatarsal_1"
    " R.MT5 right_metatarsal_5 L.Heel left_heel"
)
C_MOTION = (  # of a sample of c3d.org
    "r_asis right_asis l_asis left_asis sacrum sacrum th12 spine r_shoulder right_acromion"
    " r_knjntln right_knee_lateral l_knjntln left_knee_lateral r_tubtib right_tibial_tuberosity"
    " r_ankle right_ankle_lateral l_ankle left_ankle_lateral r_toe right_toe l_heel left_heel"
)


@pytest.mark.parametrize("given", [OPTITRACK, QUALISYS, XSENS, WISCONSIN, C_MOTION])
def test_marker_sets_of_motion_capture_systems_are_identified(given: str) -> None:
    words = given.split()
    marks = words[1::2]
    assert [landmark_of(label) for label in words[::2]] == marks
    assert not missing_landmarks(marks)


@pytest.mark.slow
@pytest.mark.parametrize("pair", [(), ("LASI", "RASI"), ("LTHI", "LKNE"), ("LTOE", "LHEE")])
def test_markers_with_swapped_names_are_noted(pair: tuple[str, ...]) -> None:
    """They fit to 2 mm: the places of all markers are found, too."""
    recording, _ = recorded(BODY, seconds=1.0, off=0.6, noise=1e-3)
    places, k = recording.positions.copy(), [recording.labels.index(name) for name in pair]
    places[:, k] = places[:, k[::-1]]
    human = human_motion(replace(recording, positions=places), mass=72.0)
    told = [note for note in human.notes if "far from the places of their names" in note]
    assert human.rms < 3e-3 and len(told) == bool(pair)
    assert all(name in note for note in told for name in pair[-1:])


def test_a_marker_far_from_those_of_its_segment_is_left_out_with_a_note() -> None:
    """FT is a foot's by name; another laboratory's is at the femur's trochanter."""
    recording, _ = recorded(BODY, seconds=1.0)
    hip = recording.positions[:, [recording.labels.index("LASI")]]
    more = np.concatenate((recording.positions, hip), axis=1)
    human = human_motion(replace(recording, labels=(*LABELS, "LFT"), positions=more), mass=72.0)
    np.testing.assert_array_equal(fitted_com(human), fitted_com(human_motion(recording, mass=72.0)))
    assert any("far from the others" in one and "LFT (left_foot)" in one for one in human.notes)


def test_a_fingertip_that_is_a_foot_by_name_is_left_out_with_a_note() -> None:
    """Of the foot only a toe is marked, so that the ankle tells which of the two is there."""
    recording, _ = recorded(BODY, labels=[one for one in LABELS if one != "LHEE"], seconds=1.0)
    labels = tuple("LFT3" if one == "LFIN" else one for one in recording.labels)
    human = human_motion(replace(recording, labels=labels), mass=72.0)
    assert human.rms < 1e-3, human.rms
    assert any("far from the others" in one and "LFT3 (left_foot)" in one for one in human.notes)


def test_a_foot_that_rests_some_cm_high_carries_the_human_where_no_other_one_does() -> None:
    """A recording drifts by 50 mm; in a jump over that height none rests, one who lies has none."""
    robot, time = Robot.load("hoap2_like"), np.arange(100) / 100.0
    left, right = robot.feet
    places = {foot: np.tile(np.eye(4), (100, 1, 1)) for foot in robot.feet}
    places[right][:, 2, 3] = 0.3 * np.sin(np.pi * time)  # swings between both ends
    places[left][:, 2, 3] = 0.05
    assert feet_down(robot, places, time, 0.0)[:, 0].all()
    lies = places | {left: places[left].copy()}
    lies[left][:, :3, :3] = rotations(np.array([[0.0, -1.5, 0.0]]))[0]
    lies[left][:, 2, 3] += 0.05 - sole_corners(robot, lies)[0, 0, :, 2].min()
    assert not feet_down(robot, lies, time, 0.0)[20:80, 0].any()
    places[left][:, 2, 3] = places[right][:, 2, 3] = 0.05 + 0.07 - 4.905 * (time - 0.5) ** 2
    assert not feet_down(robot, places, time, 0.0)[20:-20].any()


def test_the_verdict_tells_feet_that_stand_on_ground_that_drifts() -> None:
    """After 1 s of standing on level ground all markers rise by 40 mm, and stay there."""
    _, standing = marching(1.0)
    poses = Poses(*(np.repeat(part[:1], 600, axis=0) for part in vars(standing).values()))
    recording, _ = recorded(BODY, posed=(np.arange(600) / 200.0, poses))
    places = recording.positions.copy()
    places[:, :, 2] += 0.04 * np.clip(recording.time - 1.0, 0.0, 1.0)[:, None]
    human = human_motion(replace(recording, positions=places), mass=72.0, ground_height=0.0)
    said = str(verdict(wbc.analyze(human.motion, cutoff=6.0, noise=None), human))
    unknown, higher = map(int, re.findall(r"[Ii]n (\d+) of", said)[:2])
    assert "a foot stands by its speed, above the ground" in said, said
    assert 0.9 * unknown < higher <= unknown, said


def test_missing_markers_are_named() -> None:
    labels = [label for label in LABELS if label not in ("LKNE", "LANK")] + ["Foo"]
    recording, _ = recorded(BODY, labels=labels[:-1], seconds=0.2)
    more = np.concatenate((recording.positions, recording.positions[:, :1]), axis=1)
    with pytest.raises(RecordingError) as caught:
        human_motion(MarkerRecording(recording.time, tuple(labels), more, up="z"))
    text = str(caught.value)
    assert "the left knee (LKNE); the left ankle (LANK)" in text
    assert "LASI (left_asis)" in text and "not known: Foo" in text


def test_shoulders_alone_and_joints_of_cameras_are_fitted_with_a_note() -> None:
    few = ["LASI", "RASI", "SACR", "LSHO", "RSHO", "LKNE", "RKNE", "LANK", "RANK", "LTOE", "RTOE"]
    recording, poses = recorded(BODY, labels=few, seconds=1.0)
    human = human_motion(recording, mass=72.0)
    assert "of the trunk only the shoulders are known: its tilt is less certain" in human.notes
    assert human.rms < 2e-3
    assert np.abs(fitted_com(human) - com_of(BODY, poses)).max() < 0.02
    ends = {"Hip": "thigh", "Knee": "shank", "Ankle": "foot", "Shoulder": "upper_arm"}
    placed = forward_kinematics(poses, BODY.dimensions)
    tracks = {
        f"{side[0].upper()}{name}": placed.origin[:, SEGMENT_NAMES.index(f"{side}_{segment}")]
        for side in ("left", "right")
        for name, segment in ends.items()
    }
    heels, _ = recorded(BODY, labels=["LHEE", "RHEE"], seconds=1.0)
    seen = np.concatenate((np.stack(list(tracks.values()), axis=1), heels.positions), axis=1)
    human = human_motion(
        MarkerRecording(recording.time, (*tracks, "LHeel", "RHeel"), seen, up="z"), mass=72.0
    )
    assert "of the pelvis only the hips are known: its tilt is less certain" in human.notes
    assert {one.name for one in human.markers.landmarks} >= {"left_hip_centre", "left_knee_centre"}
    assert np.abs(fitted_com(human) - com_of(BODY, poses)).max() < 0.04


def test_small_child_has_its_stature_and_a_note_about_the_unit() -> None:
    recording, _ = recorded(BODY, seconds=0.3)
    small = replace(recording, positions=0.55 * recording.positions)
    child, known = human_motion(small, sex="Male"), human_motion(small, stature=0.95)
    assert child.body.stature == pytest.approx(0.55 * BODY.stature, rel=0.02)
    told = [note for note in child.notes if "a small child, or are they in another unit?" in note]
    assert len(told) == 1 and told[0] not in known.notes


def test_subject_is_required_of_two_humans_and_objects_are_left_out() -> None:
    recording, _ = recorded(BODY, seconds=0.15)
    both = np.concatenate((recording.positions, recording.positions + (0.0, 1.0, 0.0)), axis=1)
    names = [f"{who}:{label}" for who in ("Anna", "Bo") for label in LABELS]
    two = MarkerRecording(recording.time, tuple(names), both, up="z")
    with pytest.raises(RecordingError, match="markers of 2 humans, Anna, Bo: choose one"):
        human_motion(two, mass=72.0)
    with pytest.raises(UnknownNameError, match="did you mean 'Anna'"):
        human_motion(two, mass=72.0, subject="Ana")
    bo = human_motion(two, mass=72.0, subject="Bo")
    assert len(bo.markers.names) == len(LABELS) and bo.motion.base[:, 1].mean() > 0.9
    racket = [name.replace("Bo:", "Racket:") for name in names[: len(LABELS) + 3]]
    with_racket = MarkerRecording(recording.time, tuple(racket), both[:, : len(racket)], up="z")
    anna = human_motion(with_racket, mass=72.0)
    assert "markers of other objects left out: Racket" in anna.notes
    assert anna.rms < 1e-3 and not any("off the fit" in note for note in anna.notes)
    mixed = recording.positions.copy()
    mixed[:, ::3, 0] += 0.3 * np.sin(40.0 * recording.time)[:, None]  # as of who walks elsewhere
    nobody = human_motion(replace(recording, positions=mixed), mass=72.0)
    assert any("not one human's" in note for note in nobody.notes)


def test_lengths_in_another_unit_are_refused_by_the_stature() -> None:
    recording, _ = recorded(BODY, seconds=0.1)
    inches = replace(recording, positions=recording.positions / 0.0254)
    with pytest.raises(InvalidInputError, match=r"the human is 7\d.* m tall.*unit"):
        human_motion(inches)


def test_unwrapped_joints_are_the_same_postures_without_jumps() -> None:
    _, truth = recorded(BODY, seconds=1.0)
    rng, leaping = np.random.default_rng(11), truth.angles.copy()
    for first, middle in (
        ("left_hip_flexion", np.pi),
        ("right_shoulder_swing", np.pi),
        ("right_shoulder_rotation", 0.0),  # with elbow and forearm: it bends backwards
        ("neck_flexion", np.pi),
    ):
        k, folded = HINGE_NAMES.index(first), rng.random(len(leaping)) < 0.3
        other = leaping[:, k : k + 3] * (1.0, -1.0, 1.0) + (np.pi, middle, np.pi)
        leaping[folded, k : k + 3] = other[folded]
    leaping += 2.0 * np.pi * rng.integers(-1, 2, leaping.shape)
    found = unwrap_joints(Poses(truth.position, truth.rotation, leaping))
    there, here = (forward_kinematics(one, BODY.dimensions) for one in (truth, found))
    assert np.abs(here.rotation - there.rotation).max() < 1e-9
    assert np.abs(here.origin - there.origin).max() < 1e-9
    assert np.abs(found.angles - truth.angles).max() < 1e-9


@pytest.mark.slow
def test_hand_that_waves_overhead_passes_the_filter() -> None:
    time, poses = marching(seconds=2.0)
    arm = {"swing": -1.9, "lift": 0.6, "rotation": 0.8}
    for name, mean in arm.items():
        wave = 0.7 * np.sin(4.0 * np.pi * time) if name == "swing" else 0.0
        poses.angles[:, HINGE_NAMES.index(f"right_shoulder_{name}")] = mean + wave
    elbow = HINGE_NAMES.index("right_elbow_flexion")
    poses.angles[:, elbow] = 0.9 + 0.6 * np.sin(4.0 * np.pi * time + 1.0)
    recording, _ = recorded(BODY, posed=(time, poses))
    human = human_motion(recording)
    series = wbc.analyze(human.motion, cutoff=human.cutoff, noise=None, feet=None)
    hand = SEGMENT_NAMES.index("right_hand")
    robot = human.motion.robot
    seen = np.array([robot.snapshot(q).position("right_hand") for q in series.q])
    true = forward_kinematics(poses, BODY.dimensions).origin[:, hand]
    true = np.column_stack([np.interp(series.time, time, one) for one in true.T])
    inner = slice(20, -20)
    assert np.linalg.norm(seen - true, axis=1)[inner].max() < 0.05


LEGS_ONLY = (  # noqa: SIM905
    "LASI RASI LPSI RPSI LTHI RTHI LKNE RKNE LTIB RTIB LANK RANK LHEE RHEE LTOE RTOE"
).split()


def test_markers_of_legs_only_hold_the_trunk_upright_with_a_note() -> None:
    recording, poses = recorded(BODY, labels=LEGS_ONLY, seconds=2.0)
    human = human_motion(recording, mass=72.0)
    assert any("no marker tells the lean of the trunk" in note for note in human.notes)
    assert human.rms < 2e-3
    robot = human.motion.robot
    upright = [robot.snapshot(q).rotation("trunk")[2, 2] for q in configurations_of(human)]
    assert min(upright) > 1.0 - 1e-9
    assert np.abs(fitted_com(human) - com_of(BODY, poses)).max() < 0.04


@pytest.mark.parametrize("tilt", [0.2, 0.6, -0.9])
def test_trunk_without_markers_leans_by_the_excess_tilt_of_the_pelvis(tilt: float) -> None:
    turned = rotations(np.array([[0.0, 0.0, 0.7]])) @ rotations(np.array([[0.0, tilt, 0.0]]))
    poses = Poses(np.zeros((1, 3)), turned, np.zeros((1, len(HINGES))))
    placed = forward_kinematics(upright_trunk(poses), BODY.dimensions)
    trunk = placed.rotation[0, SEGMENT_NAMES.index("trunk")]
    lean = np.sign(tilt) * max(abs(tilt) - PELVIS_TILT, 0.0)
    wanted = rotations(np.array([[0.0, 0.0, 0.7]])) @ rotations(np.array([[0.0, lean, 0.0]]))
    np.testing.assert_allclose(trunk, wanted[0], atol=1e-12)


def test_one_marker_on_the_trunk_is_enough_with_a_note() -> None:
    recording, poses = recorded(BODY, labels=[*LEGS_ONLY, "C7"], seconds=2.0)
    human = human_motion(recording, mass=72.0)
    assert "of the trunk only c7 is known: its tilt is less certain" in human.notes
    assert np.abs(fitted_com(human) - com_of(BODY, poses)).max() < 0.03


def test_arms_without_a_trunk_are_refused() -> None:
    recording, _ = recorded(BODY, labels=[*LEGS_ONLY, "LELB", "LWRA", "LWRB"], seconds=0.5)
    with pytest.raises(RecordingError, match="one or more on the trunk"):
        human_motion(recording)


@pytest.mark.parametrize("frames", [1, 7])
def test_static_trial_of_few_frames_is_as_good_as_a_long_one(tmp_path, frames: int) -> None:  # type: ignore[no-untyped-def]
    walk, _ = recorded(BODY, labels=[one for one in LABELS if one != "LKNE"], seconds=1.0)
    labels = [*LABELS, "LKNM", "RKNM"]
    long, _ = recorded(BODY, labels=labels, seconds=0.08)
    long = replace(long, positions=np.repeat(long.positions[:1], len(long.time), axis=0))
    few = replace(long, time=long.time[:frames], positions=long.positions[:frames])
    write_trc(tmp_path / "static.trc", few)
    read = read_markers(tmp_path / "static.trc", standing=True)
    assert len(read.time) == frames
    with pytest.raises(RecordingError, match=f"{frames} frames; at least 8"):
        read_markers(tmp_path / "static.trc")
    with pytest.raises(InvalidInputError, match=f"{frames} frames; at least 8"):
        human_motion(few)
    bodies = [human_motion(walk, static=one, mass=72.0).body.dimensions for one in (read, long)]
    np.testing.assert_allclose(*bodies, atol=1e-4)


@pytest.mark.parametrize(("said", "told"), [(1.45, True), (1.85, False), (2.1, True)])
def test_stature_contradicted_by_the_limbs_is_noted(said: float, told: bool) -> None:
    recording, _ = recorded(BODY, seconds=0.5)
    human = human_motion(recording, mass=72.0, stature=said)
    notes = [note for note in human.notes if f"m tall, {said:g} m was given" in note]
    assert bool(notes) is told and human.body.stature == said
