"""Readers of C3D, TRC, MOT, BVH and SMPL poses, against other readers and closed forms."""

import re
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.human.walker import LABELS, recorded, write_trc
from wbc.errors import WbcError
from wbc.human import human_motion, is_human_recording, read_markers
from wbc.human.body import HumanBody
from wbc.human.bones import REACH, joint_landmarks
from wbc.human.bvh import UNITS, _unit
from wbc.human.c3d import _sensors, plate_wrench
from wbc.human.c3d_parameters import read_c3d_head
from wbc.human.markers import ForcePlate, MarkerRecording
from wbc.motion.table import RecordingError

BODY = HumanBody.of(1.76, 72.0, "male")
CORNERS = np.array(((0.9, 0.4, 0.0), (-0.1, 0.4, 0.0), (-0.1, -0.3, 0.0), (0.9, -0.3, 0.0)))
DOWN = CORNERS[[3, 2, 1, 0]]  # corners in the other turn: z points into the ground


def write_c3d(path: Path, seconds: float = 0.2) -> np.ndarray:
    """Write a march with ezc3d: mm, z up, a plate of type 2; return true force and moment."""
    ezc3d = pytest.importorskip("ezc3d")
    recording, _ = recorded(BODY, seconds=seconds, plates=True)
    plate, file = recording.plates[0], ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    file["parameters"]["POINT"]["LABELS"]["value"] = list(recording.labels)
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    points = np.ones((4, len(recording.labels), len(recording.time)))
    points[:3] = 1e3 * recording.positions.transpose(2, 1, 0)
    points[:3, LABELS.index("LFIN"), 3] = np.nan  # ezc3d writes a residual of -1
    file["data"]["points"] = points
    R = np.column_stack(((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)))  # of DOWN
    sensor = DOWN.mean(axis=0) + R @ np.array((0.0, 0.0, 0.04))  # 40 mm under the surface
    force = -plate.force @ R  # on the plate, in its axes
    moment = -(plate.moment - np.cross(sensor, plate.force)) @ R
    file["parameters"]["ANALOG"]["RATE"]["value"] = [100.0]
    names = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"]
    file["parameters"]["ANALOG"]["LABELS"]["value"] = names
    file["parameters"]["ANALOG"]["UNITS"]["value"] = ["N", "N", "N", "Nmm", "Nmm", "Nmm"]
    file["data"]["analogs"] = np.hstack((force, 1e3 * moment)).T[None]
    for name, value in {
        "USED": [1.0],
        "TYPE": [2.0],
        "CORNERS": 1e3 * DOWN.T[:, :, None],
        "ORIGIN": np.array(((0.0,), (0.0,), (-40.0,))),
        "CHANNEL": np.arange(1.0, 7.0)[:, None],
        "ZERO": [1.0, 0.0],
    }.items():
        file.add_parameter("FORCE_PLATFORM", name, value)
    file.write(str(path))
    return np.hstack((plate.force, plate.moment))


March = tuple[Path, np.ndarray]  # a file, and the true force and moment


@pytest.fixture
def march(tmp_path: Path) -> March:
    path = tmp_path / "march.c3d"
    return path, write_c3d(path)


def _with(
    path: Path, group: str, *, points: float = 1.0, moments: float = 1.0, readings: float = 0.0,
    **values: object,
) -> None:  # fmt: skip
    """Write a C3D file again with other parameters, its data times factors, with an offset."""
    import ezc3d

    file = ezc3d.c3d(str(path))
    for name, value in values.items():
        file.add_parameter(group, name, value)
    file["data"]["points"][:3] *= points
    file["data"]["analogs"][:, 3:] *= moments
    file["data"]["analogs"] += readings
    file.write(str(path))


def test_c3d_with_a_plate_is_read(march: March) -> None:
    path, truth = march
    found = read_markers(path)
    recording, _ = recorded(BODY, seconds=0.2)
    assert found.labels == tuple(LABELS) and found.rate == pytest.approx(100.0)
    lost = np.isnan(found.positions).any(axis=2)
    assert lost[3, LABELS.index("LFIN")] and lost.sum() == 1
    seen = ~lost
    np.testing.assert_allclose(found.positions[seen], recording.positions[seen], atol=1e-6)
    plate = found.upright("z").plates[0]
    # 4-byte floats: 1e-7 of 1.5 kN and 1.5e6 N mm.
    np.testing.assert_allclose(plate.force, truth[:, :3], atol=1e-3)
    np.testing.assert_allclose(plate.moment, truth[:, 3:], atol=2e-3)


@pytest.mark.parametrize("offset", [0, 40000])
def test_c3d_of_floats_that_declares_unsigned_integers_keeps_their_signs(march, offset) -> None:
    path, true = march
    _with(path, "ANALOG", FORMAT=["UNSIGNED"], readings=float(offset))
    data = bytearray(path.read_bytes())
    at = data.index(b"OFFSET") + len("OFFSET") + 2
    kind, dimensions = data[at : at + 2]
    assert (kind, dimensions) == (2, 1)
    word = offset - 65536 if offset > 32767 else offset  # they have a sign
    struct.pack_into("<6h", data, at + 3, *6 * [word])
    path.write_bytes(data)
    plate = read_markers(path).plates[0]
    found = np.hstack((plate.force, plate.moment))
    np.testing.assert_allclose(-found, true, rtol=1e-5, atol=2e-2)


@pytest.mark.parametrize(("word", "factor"), [("mete", 1e-3), ("millimeters", 1.0), ("cent", 0.1)])
def test_c3d_with_unit_words_is_read(march: March, word: str, factor: float) -> None:
    path, _ = march
    before = read_markers(path)
    _with(path, "POINT", UNITS=[word], points=factor)
    np.testing.assert_allclose(read_markers(path).positions, before.positions, atol=1e-6)


@pytest.mark.parametrize("word", ["N-M", "N.m", "Nm", "N*m"])
def test_c3d_with_any_spelling_of_newton_metres_is_read(march: March, word: str) -> None:
    path, truth = march
    _with(path, "ANALOG", UNITS=["N"] * 3 + [word] * 3, moments=1e-3)
    plate = read_markers(path).upright("z").plates[0]
    np.testing.assert_allclose(plate.moment, truth[:, 3:], atol=2e-3)


def test_c3d_with_impossible_data_start_is_read_by_its_header(march: March) -> None:
    path, _ = march
    before, data = read_markers(path), bytearray(path.read_bytes())
    at = data.index(b"DATA_START") + 10 + 2 + 2  # type, number of dimensions
    data[at : at + 2] = struct.pack("<h", 1)
    path.write_bytes(data)
    np.testing.assert_array_equal(read_markers(path).positions, before.positions)


def test_c3d_with_repeated_point_names_takes_the_first_with_a_note(march: March) -> None:
    path, _ = march
    before = read_markers(path)
    labels = ["LTOE" if name == "RTOE" else name for name in LABELS]
    _with(path, "POINT", LABELS=labels)
    found = read_markers(path)
    assert "several markers are called LTOE: the first that is seen is taken" in found.notes
    expected = before.positions[:, labels.index("LTOE")]
    np.testing.assert_array_equal(found.positions[:, found.labels.index("LTOE")], expected)


def test_c3d_with_column_of_field_numbers_is_read(march: March) -> None:
    path, _ = march
    first, last = (np.array(((value,), (0.0,))) for value in (1.0, 20.0))
    _with(path, "TRIAL", ACTUAL_START_FIELD=first, ACTUAL_END_FIELD=last)
    assert len(read_markers(path).time) == 20


def test_plates_with_the_same_corners_are_noted(march: March) -> None:
    path, _ = march
    assert not any("same corners" in note for note in read_markers(path).notes)
    twice = {
        "CORNERS": np.repeat(1e3 * DOWN.T[:, :, None], 2, axis=2),
        "ORIGIN": np.array(((0.0, 0.0), (0.0, 0.0), (-40.0, -40.0))),
        "CHANNEL": np.repeat(np.arange(1.0, 7.0)[:, None], 2, axis=1),
    }
    _with(path, "FORCE_PLATFORM", USED=[2.0], TYPE=[2.0, 2.0], **twice)
    (note,) = read_markers(path).notes
    assert "force plate 1 and plate 2 have the same corners" in note


def test_c3d_with_a_plate_of_type_4_is_calibrated_by_its_matrix(march: March) -> None:
    path, truth = march
    _with(path, "FORCE_PLATFORM", TYPE=[4.0], CAL_MATRIX=np.diag((2.0,) * 6)[:, :, None])
    plate = read_markers(path).upright("z").plates[0]
    np.testing.assert_allclose(plate.force, 2.0 * truth[:, :3], atol=2e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_origin_of_a_treadmill_is_read_either_way_round(march: March, sign: float) -> None:
    """Its sensor stays; its surface is 0.3 m further back, which an origin tells with any sign."""
    path, truth = march
    back = 1e3 * (DOWN - (0.3, 0.0, 0.0)).T[:, :, None]
    origin = np.array(((-300.0 * sign,), (0.0,), (-40.0,)))
    _with(path, "FORCE_PLATFORM", CORNERS=back, ORIGIN=origin)
    found = read_markers(path)
    plate = found.upright("z").plates[0]
    np.testing.assert_allclose(plate.moment, truth[:, 3:], atol=0.05)
    assert any("the other way round" in note for note in found.notes) == (sign < 0.0)


@pytest.mark.parametrize(
    ("values", "plates", "words"),
    [
        ({"TYPE": [4.0]}, 0, "of type 4 without a calibration matrix"),
        ({"CHANNEL": np.arange(4.0, 10.0)[:, None]}, 0, "not among the 6 recorded"),
        ({"CORNERS": [1.0]}, 0, "corners, origin or channels are missing"),
        (
            {"ORIGIN": np.array(((9000.0,), (0.0,), (-40.0,)))},
            1,
            "force plate 1 has its sensors 9000 of",
        ),
    ],
)
def test_c3d_with_a_doubtful_plate_keeps_its_markers_with_a_note(
    march: March, values: dict[str, object], plates: int, words: str
) -> None:
    path, _ = march
    _with(path, "FORCE_PLATFORM", **values)
    found = read_markers(path)
    assert len(found.labels) == len(LABELS) and len(found.plates) == plates
    assert any(words in note for note in found.notes), found.notes


def test_c3d_whose_header_counts_channels_in_place_of_their_readings_is_read(march: March) -> None:
    """As the MotionMonitor writes it: every frame but the first was read from elsewhere."""
    import ezc3d

    path, _ = march
    expected = read_markers(path)
    file = ezc3d.c3d(str(path))
    file["parameters"]["ANALOG"]["RATE"]["value"] = [200.0]
    file["data"]["analogs"] = np.repeat(file["data"]["analogs"], 2, axis=2)
    file.write(str(path))
    content = bytearray(path.read_bytes())
    assert content[4] == 12
    content[4] = 6
    path.write_bytes(content)
    found = read_markers(path)
    np.testing.assert_array_equal(found.positions, expected.positions)
    np.testing.assert_array_equal(found.plates[0].force[::2], expected.plates[0].force)


def test_c3d_with_impossible_header_is_refused(march: March) -> None:
    path, _ = march
    data = path.read_bytes()
    # Not so many analog samples of each channel are in a frame.
    for changed, words in (
        (data[:18] + struct.pack("<h", 513) + data[20:], "6 analog values .* no 513 per channel"),
        (data[:-600], "is it cut off"),
    ):
        path.write_bytes(changed)
        with pytest.raises(RecordingError, match=words):
            read_markers(path)
    path.write_bytes(data)
    _with(path, "POINT", UNITS=["furlong"])
    with pytest.raises(RecordingError, match="POINT:UNITS: expected mm"):
        read_markers(path)


@pytest.mark.parametrize(("value", "mass"), [(74.5, 74.5), (0.0, None), (1.0, None)])
def test_mass_of_vicons_c3d_is_read(march: March, value: float, mass: float | None) -> None:
    path, _ = march
    _with(path, "PROCESSING", Bodymass=[value])
    assert read_markers(path).mass == mass


@pytest.mark.parametrize(
    ("moments", "corners", "what"), [(1e-3, 1.0, "moments"), (1.0, 1e-3, "corners")]
)
def test_plates_in_another_unit_than_told_are_read(march, moments, corners, what) -> None:
    """N m called N mm put the CoP into the plate's middle, without a word."""
    import ezc3d

    path, truth = march
    told = ezc3d.c3d(str(path))["parameters"]["FORCE_PLATFORM"]
    places = {name: corners * np.asarray(told[name]["value"]) for name in ("CORNERS", "ORIGIN")}
    _with(path, "FORCE_PLATFORM", moments=moments, **places)
    found = read_markers(path)
    np.testing.assert_allclose(found.upright("z").plates[0].moment, truth[:, 3:], atol=2e-3)
    assert any(f"has its {what} in another unit than told" in note for note in found.notes)


def test_plate_with_long_drift_and_a_short_step_pushes_up() -> None:
    force, moment = np.zeros((2, 1000, 3))
    force[:, 2] = -8.0
    force[400:410, 2] = 700.0
    for sign in (1.0, -1.0):
        plate = ForcePlate("plate", np.arange(1000) / 1e3, sign * force, moment).pushing()
        assert plate.force[405, 2] == 700.0


def test_tared_plate_reads_zero_unloaded() -> None:
    time = np.arange(2000) / 1e3
    push = np.where((time > 0.8) & (time < 1.5), 700.0, 0.0)
    force = np.column_stack((0.1 * push, 0.0 * push, push))
    moment = np.cross((0.5, 0.2, 0.0), force)
    noise = np.random.default_rng(0).normal(0.0, 1.0, force.shape)
    off, turn = np.array((2.0, -1.0, -18.0)), np.array((4.0, 9.0, 1.0))
    plate, read = ForcePlate("plate", time, force + off + noise, moment + turn + noise).tared()
    assert read == pytest.approx(np.linalg.norm(off), abs=0.2)
    np.testing.assert_allclose(plate.force - noise, force, atol=0.2)
    np.testing.assert_allclose(plate.moment - noise, moment, atol=0.2)
    # Someone always stands on it, or for all but a moment: what it reads by itself is not known.
    for some in (time > 0.0, time > 0.05):
        stands = ForcePlate("plate", time, force + off + 300.0 * some[:, None], moment)
        assert stands.tared() == (stands, 0.0)
    # An amplifier nobody has set to zero, known by the times at which nobody is above the plate.
    far = ForcePlate("plate", time, force - (5.0, 0.0, 90.0) + noise, moment)
    plate, read = far.tared((time < 0.6) | (time > 1.7))
    assert read == pytest.approx(np.hypot(5.0, 90.0), abs=0.2)
    np.testing.assert_allclose(plate.force - noise, force, atol=0.2)


def test_mips_parameters_with_an_intel_offset_are_all_read() -> None:
    """As in a sample of c3d.org, which a program on another machine had written to."""
    records = b""
    for order, name, value in (("<", b"FIRST", 7), (">", b"LAST", 8)):
        record = struct.pack(">bBh", 2, 0, value) + b"\0"  # type, no dimensions, no description
        records += struct.pack("bb", len(name), 1) + name
        records += struct.pack(order + "h", 2 + len(record)) + record
    group = struct.pack("bb", 5, -1) + b"POINT" + struct.pack(">hB", 3, 0)
    begin = bytes((1, 0x50, 1, 86))
    data = bytes((2, 0x50)).ljust(512, b"\0") + (begin + group + records).ljust(512, b"\0")
    found = read_c3d_head(data, "sample")
    assert found.number("POINT:FIRST", 0.0) == 7.0 and found.number("POINT:LAST", 0.0) == 8.0


def test_plates_of_all_types_agree() -> None:
    """One wrench, as the four types of the C3D manual record it, on a plate that is turned."""
    rng = np.random.default_rng(0)
    force, point, free = rng.standard_normal((3, 5, 3)) * np.reshape((30, 0.2, 3), (3, 1, 1))
    force[:, 2] = -700.0
    point[:, 2], free[:, :2] = 0.0, 0.0
    depth, unit = -0.03, 1.0
    turn = Rotation.from_euler("z", 0.7).as_matrix()
    corners = CORNERS @ turn.T + (0.4, -0.2, 0.0)
    moment = np.cross(point - (0.0, 0.0, -depth), force) + free  # about the sensor
    a, b = 0.2, 0.1
    solve = np.zeros((6, 8))  # the eight sensors' sums of type 3
    solve[0, :2], solve[1, 2:4], solve[2, 4:] = 1.0, 1.0, 1.0
    solve[3, 4:] = b, b, -b, -b
    solve[4, 4:] = -a, a, a, -a
    solve[5, :4] = -b, b, a, -a
    eight = np.hstack((force, moment)) @ np.linalg.pinv(solve).T
    six, zero = np.hstack((force, moment)), np.array((0.0, 0.0, depth))
    first = np.hstack((force, point[:, :2], free[:, 2:]))
    found = {
        1: plate_wrench(1, first, corners, np.zeros(3), unit, 1.0),
        2: plate_wrench(2, six, corners, zero, unit, 1.0),
        3: plate_wrench(3, eight, corners, np.array((a, b, depth)), unit, 1.0),
        4: plate_wrench(4, six, corners, zero, unit, 1.0),
    }
    middle = corners.mean(axis=0)
    for f, m in found.values():
        np.testing.assert_allclose(f, force @ turn.T, atol=1e-10)
        expected = np.cross(middle + point @ turn.T, force @ turn.T) + free @ turn.T
        np.testing.assert_allclose(m, expected, atol=1e-9)


def test_mot_plates_are_read(tmp_path: Path) -> None:
    write_trc(tmp_path / "a.trc", recorded(BODY, seconds=0.1)[0])
    rows = [
        "0.0 10 700 -5 0.1 0 0.2 0 3 0",
        "0.1 20 800 5 0.1 0 0.2 0 4 0",
        "0.2 0 1 0 NaN 0 9 0 nan 0",
    ]
    names = [f"ground_{k}" for k in ("force_vx", "force_vy", "force_vz", "force_px", "force_py")]
    names += ["ground_force_pz", *(f"ground_torque_{axis}" for axis in "xyz")]
    head = "grf\nnRows=3\nnColumns=10\nendheader\n\n"
    text = head + "\n".join(["  time " + " ".join(names), *rows])
    (tmp_path / "a.mot").write_text(text)
    found = read_markers(tmp_path / "a.trc", forces=tmp_path / "a.mot")
    plate = found.plates[0]
    assert plate.force[0].tolist() == [10.0, 700.0, -5.0]
    expected = np.cross((0.1, 0.0, 0.2), (10.0, 700.0, -5.0)) + (0.0, 3.0, 0.0)
    np.testing.assert_allclose(plate.moment[0], expected)
    assert not plate.force[2].any() and not plate.moment[2].any()  # 1 N: its point is noise
    up = found.upright("y").plates[0]
    assert up.force[0].tolist() == [10.0, 5.0, 700.0]


def test_mot_in_mm_is_read_with_a_note(tmp_path: Path) -> None:
    """As OpenSim's adapter makes it of a C3D file."""
    write_trc(tmp_path / "a.trc", recorded(BODY, seconds=0.1)[0])
    names = [f"f1_{kind}{axis}" for kind in ("v", "p", "torque_") for axis in "xyz"]
    rows = "0.0 10 700 -5 100 0 200 0 3000 0\n0.1 20 800 5 100 0 200 0 4000 0\n"
    (tmp_path / "a.mot").write_text(f"endheader\ntime {' '.join(names)}\n{rows}")
    found = read_markers(tmp_path / "a.trc", forces=tmp_path / "a.mot")
    expected = np.cross((0.1, 0.0, 0.2), (10.0, 700.0, -5.0)) + (0.0, 3.0, 0.0)
    np.testing.assert_allclose(found.plates[0].moment[0], expected)
    assert any("points of f1 are taken for mm" in note for note in found.notes)


def test_mot_torques_about_the_origin_are_read_with_a_note(tmp_path: Path) -> None:
    """As AddBiomechanics' ``initial_off_treadmill`` has them: the moment counted twice."""
    write_trc(tmp_path / "a.trc", recorded(BODY, seconds=0.1)[0])
    force, point = np.array([10.0, 700.0, -5.0]), np.array([0.1, 0.0, -0.2])
    moment = np.cross(point, force) + (0.0, 3.0, 0.0)
    names = [f"ground_{kind}{axis}" for kind in ("force_v", "force_p", "torque_") for axis in "xyz"]
    row = " ".join(map(str, (*force, *point, *moment)))
    text = f"endheader\ntime {' '.join(names)}\n0.0 {row}\n0.1 {row}\n"
    (tmp_path / "a.mot").write_text(text)
    found = read_markers(tmp_path / "a.trc", forces=tmp_path / "a.mot")
    np.testing.assert_allclose(found.plates[0].moment, [moment, moment])
    assert any("torques of ground_force" in note for note in found.notes)


def test_notes_on_plates_of_another_file_are_told(march: March, tmp_path: Path) -> None:
    path, _ = march
    _with(path, "FORCE_PLATFORM", TYPE=[7.0])
    write_trc(tmp_path / "a.trc", recorded(BODY, seconds=0.1)[0])
    (note,) = read_markers(tmp_path / "a.trc", forces=path).notes
    assert "force plate 1 was left out: its type is 7; types 1 to 4" in note and "MOT" in note


@pytest.mark.parametrize("empty", [False, True])
def test_trc_with_repeated_names_takes_the_first_that_is_seen_with_a_note(empty, tmp_path) -> None:
    """An empty one, left over in the file, hid the marker."""
    path, (recording, _) = tmp_path / "a.trc", recorded(BODY, seconds=0.1)
    positions = recording.positions.copy()
    if empty:
        positions[1:, recording.labels.index("LTOE")] = np.nan
    write_trc(path, replace(recording, positions=positions))
    before = read_markers(path)
    path.write_text(path.read_text().replace("RTOE", "LTOE"))
    found = read_markers(path)
    assert found.notes == ("several markers are called LTOE: the first that is seen is taken",)
    expected = before.positions[:, before.labels.index("RTOE" if empty else "LTOE")]
    np.testing.assert_array_equal(found.positions[:, found.labels.index("LTOE")], expected)
    assert len(found.labels) == len(before.labels) - 1


def test_unnamed_markers_of_a_trc_are_left_out_with_a_note(tmp_path: Path) -> None:
    path, (recording, _) = tmp_path / "a.trc", recorded(BODY, seconds=0.1)
    write_trc(path, recording)
    before, lines = read_markers(path), path.read_text().splitlines()
    count = len(before.labels)
    lines[2] = lines[2].replace(f"\t{count}\t", f"\t{count + 2}\t")
    rows = [line + 3 * (k + 1) * "\t1.5" for k, line in enumerate(lines[6:])]
    path.write_text("\n".join((*lines[:6], *rows)))
    found = read_markers(path)
    assert found.notes == (f"the header declares {count + 2} markers, {count} are named",)
    np.testing.assert_array_equal(found.positions, before.positions)


@pytest.mark.parametrize(
    "form",
    [
        "ground_force_1_{} ground_moment_1_m{}",
        "FP1_{} FP1_moment_{}",
        "ground_force_1_{} ground_force_1_m{}",
    ],
)
def test_mot_columns_of_other_programs_are_read(tmp_path: Path, form: str) -> None:
    """Among them those of OpenSim's C3D adapter, whose torque is that at the plate's middle."""
    write_trc(tmp_path / "a.trc", recorded(BODY, seconds=0.1)[0])
    push, turn = form.split()
    names = [push.format(kind + axis) for kind in "vp" for axis in "xyz"]
    names += [turn.format(axis) for axis in "xyz"]
    rows = "0.0 10 700 -5 0.1 0 0.2 7 3 9\n0.1 20 800 5 0.1 0 0.2 0 4 0\n"
    (tmp_path / "a.mot").write_text(f"endheader\ntime {' '.join(names)}\n{rows}")
    (plate,) = read_markers(tmp_path / "a.trc", forces=tmp_path / "a.mot").plates
    expected = np.cross((0.1, 0.0, 0.2), (10.0, 700.0, -5.0)) + (7.0, 3.0, 9.0)
    np.testing.assert_allclose(plate.moment[0], expected)


def test_trc_separated_by_commas_is_read(tmp_path: Path) -> None:
    recording, _ = recorded(BODY, seconds=0.1)
    write_trc(tmp_path / "walk.trc", recording)
    tabs = read_markers(tmp_path / "walk.trc")
    (tmp_path / "commas.trc").write_text((tmp_path / "walk.trc").read_text().replace("\t", ","))
    commas = read_markers(tmp_path / "commas.trc")
    assert commas.labels == tabs.labels
    np.testing.assert_array_equal(commas.positions, tabs.positions)


def test_trc_separated_by_blanks_between_tabs_is_read(tmp_path: Path) -> None:
    """As files of the University of Wisconsin: a head with blanks, rows behind a tab."""
    path = tmp_path / "a.trc"
    write_trc(path, recorded(BODY, seconds=0.1)[0])
    before, lines = read_markers(path), path.read_text().splitlines()
    lines[3] = "Frame#\tTime      " + "      ".join(LABELS)
    path.write_text("\n".join([*lines[:5], *("\t" + line for line in lines[5:])]))
    found = read_markers(path)
    assert found.labels == before.labels
    np.testing.assert_array_equal(found.positions, before.positions)


def test_mot_force_without_its_point_is_refused(tmp_path: Path) -> None:
    write_trc(tmp_path / "a.trc", recorded(BODY, seconds=0.1)[0])
    names = "time r_force_vx r_force_vy r_force_vz"
    (tmp_path / "a.mot").write_text(f"a\nendheader\n{names}\n0 1 700 2\n0.1 1 700 2\n")
    with pytest.raises(RecordingError, match="r_force has no point: three columns such as"):
        read_markers(tmp_path / "a.trc", forces=tmp_path / "a.mot")


BVH = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
%s
  JOINT Neck
  {
    OFFSET 0 60 0
    CHANNELS 3 Zrotation Xrotation Yrotation
%s
    JOINT Head
    {
      OFFSET 0 10 0
      CHANNELS 3 Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET 0 20 0
      }
    }
  }
}
MOTION
Frames: %d
Frame Time: 0.01
%s
"""
LIMB = """    JOINT {0}
    {{
      OFFSET {1}
      CHANNELS 3 Zrotation Xrotation Yrotation
      JOINT {2}
      {{
        OFFSET {3}
        CHANNELS 3 Zrotation Xrotation Yrotation
        JOINT {4}
        {{
          OFFSET {5}
          CHANNELS 3 Zrotation Xrotation Yrotation
          End Site
          {{
            OFFSET {6}
          }}
        }}
      }}
    }}
"""


def write_bvh(path: Path, frames: int = 12, fall: float = 0.0) -> np.ndarray:
    """Write a skeleton in cm that bends its left knee; return the true left ankle [m]."""
    legs = arms = ""
    for side, s in (("Left", 1), ("Right", -1)):
        names = [f"{side}{part}" for part in ("UpLeg", "Leg", "Foot")]
        legs += LIMB.format(names[0], f"{9 * s} 0 0", names[1], "0 -42 0", names[2], "0 -43 0",
                            "0 -7 18")  # fmt: skip
        names = [f"{side}{part}" for part in ("Arm", "ForeArm", "Hand")]
        arms += LIMB.format(names[0], f"{18 * s} -8 0", names[1], f"{28 * s} 0 0", names[2],
                            f"{26 * s} 0 0", f"{9 * s} 0 0")  # fmt: skip
    width = 6 + 3 * 14
    bend = np.linspace(0.0, 60.0, frames)
    rows = np.zeros((frames, width))
    rows[:, 1] = 93.0 - fall
    rows[:, 6 + 3 + 1] = bend  # X rotation of the left shin, behind the left thigh's three
    lines = "\n".join(" ".join(f"{v:g}" for v in row) for row in rows)
    path.write_text(BVH % (legs, arms, frames, lines))
    a = np.radians(bend)
    shin = 0.43 * np.column_stack((np.zeros(frames), -np.cos(a), -np.sin(a)))
    return np.array((0.09, 0.51, 0.0)) + shin


def test_bvh_whose_bones_all_point_along_x_has_the_unit_of_its_legs(tmp_path: Path) -> None:
    """As in LAFAN1: the extent of such a rest pose tells nothing, and clips were refused for it."""
    path = tmp_path / "along.bvh"
    write_bvh(path)
    for cm, unit in ((1.0, "cm"), (1.0 / 2.54, "inch")):

        def along(offset: re.Match[str], cm: float = cm) -> str:
            length = np.linalg.norm([float(word) for word in offset[1].split()])
            return f"OFFSET {cm * length} 0 0\n"

        file = tmp_path / f"{unit}.bvh"
        file.write_text(re.sub("OFFSET (.*)\n", along, path.read_text()))
        assert read_markers(file).notes == (
            f"lengths taken for {unit}: by its legs it is 1.73 m tall",
        )


def test_bvh_with_a_prop_has_the_unit_of_the_human(tmp_path: Path) -> None:
    path = tmp_path / "lift.bvh"
    write_bvh(path)
    thing = (
        "JOINT Prop1\n{\nOFFSET 0 0 230\nCHANNELS 0\nEnd Site\n{\nOFFSET 0 20 0\n}\n}\n}\nMOTION"
    )
    path.write_text(path.read_text().replace("}\nMOTION", thing))
    assert any("lengths taken for cm" in note for note in read_markers(path).notes)


def test_bvh_gives_joints_and_bones(tmp_path: Path) -> None:
    path = tmp_path / "bend.bvh"
    ankle = write_bvh(path)
    found = read_markers(path)
    at = found.positions[:, found.labels.index("LeftFoot")]
    np.testing.assert_allclose(at, ankle, atol=1e-5)
    assert any("lengths taken for cm" in note for note in found.notes)
    human = human_motion(found, mass=70.0)
    knee = human.motion.joints[:, human.motion.robot.joint_names.index("left_knee_flexion")]
    np.testing.assert_allclose(np.degrees(knee - knee[0]), np.linspace(0.0, 60.0, 12), atol=3.0)
    assert human.rms < 0.01
    path.write_text(path.read_text().replace("\n", "\n\n"))  # no frame time of 12 s
    np.testing.assert_array_equal(read_markers(path).positions, found.positions)
    # Under a root that carries all, the skeleton may be drawn anywhere.
    head, _, rows = path.read_text().rpartition("MOTION")
    world = "ROOT World\n{\nOFFSET 0 0 0\nCHANNELS 1 Xposition\nJOINT Hips\n{\nOFFSET 0 0 -500"
    first = head.index("OFFSET")
    head = head[: head.index("ROOT")] + world + head[head.index("\n", first) :] + "}\n"
    lines = rows.splitlines()
    put = [line if k < 3 or not line else f"0 {line}" for k, line in enumerate(lines)]
    path.write_text(head + "MOTION" + "\n".join(put) + "\n")
    assert any("lengths taken for cm" in note for note in read_markers(path).notes)
    write_bvh(path)
    path.write_text(path.read_text().replace("LeftUpLeg", "Wheel"))
    with pytest.raises(RecordingError, match="no left_hip_centre by the usual names"):
        read_markers(path)


@pytest.mark.parametrize(
    "leg",
    [
        "UpLeg Leg Foot ToeBase",  # Motion Builder, Carnegie Mellon's, LAFAN1, Mixamo
        "Leg Shin Foot ToeBase",  # SOMA
        "Hip Knee Ankle Toe",  # Xsens, 100STYLE
        "Hip Knee Ankle Foot",  # SMPL, Kinect
        "Thigh Calf Foot Toe0",  # Biped
        "UpperLeg LowerLeg Foot Toes",  # Bandai Namco
    ],
)
def test_legs_are_identified_by_other_names(leg: str) -> None:
    names = ["Hips", *(f"{side}{part}" for side in ("Left", "Right") for part in leg.split())]
    found = joint_landmarks(names, "it")
    parts = "hip_centre", "knee_centre", "ankle_centre", "toe"
    wanted = ["root", *(f"{side}_{part}" for side in ("left", "right") for part in parts)]
    assert [found[k] for k in range(len(names))] == wanted


def test_joints_of_vroid_are_identified() -> None:
    limbs = "UpperLeg LowerLeg Foot ToeBase UpperArm LowerArm Hand".split()  # noqa: SIM905
    names = [f"J_Bip_C_{one}" for one in ("Hips", "Neck", "Head")]
    names += [f"J_Bip_{side}_{one}" for side in "LR" for one in limbs]
    found = joint_landmarks(names, "it")
    assert [found[k] for k in range(3)] == ["root", "neck_centre", "head_centre"]
    assert sorted(found) == list(range(len(names)))


def test_joints_of_unreal_are_identified() -> None:
    limbs = "thigh calf foot ball upperarm lowerarm hand".split()  # noqa: SIM905
    names = ["root", "pelvis", "neck_01", "head", *(f"{one}_{s}" for s in "lr" for one in limbs)]
    found = joint_landmarks(names, "it")
    assert [found[k] for k in (1, 2, 3)] == ["root", "neck_centre", "head_centre"]
    assert sorted(found) == list(range(1, len(names)))


def test_one_unit_fits_a_human_of_any_height_from_a_metre() -> None:
    for size in UNITS.values():
        for height in (1.01, 1.12, 1.5, 2.19):
            assert _unit(None, height / size, "it")[0] == size


def test_unit_of_carnegie_mellon_is_recognised(tmp_path: Path) -> None:
    path, size = tmp_path / "a.bvh", 0.0254 / 0.45  # of their README: inches times 0.45
    ankle = write_bvh(path)
    lines = path.read_text().splitlines()
    for k, line in enumerate(lines):
        words = line.split()
        if words[:1] == ["OFFSET"]:
            lines[k] = " ".join(["OFFSET", *(str(0.01 * float(w) / size) for w in words[1:])])
        elif k > lines.index("MOTION") + 2 and words:
            moved = [str(0.01 * float(w) / size) for w in words[:3]]
            lines[k] = " ".join((*moved, *words[3:]))
    path.write_text("\n".join(lines) + "\n")
    for unit, note in ((None, "taken for cmu"), ("cmu", "in cmu, as"), (size, f"in {size} m, as")):
        found = read_markers(path, unit=unit)
        at = found.positions[:, found.labels.index("LeftFoot")]
        np.testing.assert_allclose(at, ankle, atol=1e-5)
        assert any(note in one for one in found.notes)
    for unit in (0.0, -1.0, "nan"):
        with pytest.raises(RecordingError, match=r"unit: expected cm, .* or a length in m, got"):
            read_markers(path, unit=unit)


def write_bodies(path: Path, motive: bool = False) -> MarkerRecording:
    """Write the skeleton of :func:`write_bvh` as rigid bodies; return it as markers."""
    bvh = path.with_suffix(".bvh")
    write_bvh(bvh)
    found = read_markers(bvh)
    names = [name for name in found.labels if f"{name}/x" in found.labels]
    at = {name: found.positions[:, k] for k, name in enumerate(found.labels)}
    rows = []
    for name in names:
        axes = np.stack([at[f"{name}/{axis}"] - at[name] for axis in "xyz"], axis=2) / REACH
        rows += [Rotation.from_matrix(axes).as_quat(), (1e3 if motive else 1.0) * at[name]]
    time = found.time[:, None]
    count, table = np.arange(len(time))[:, None], np.hstack((time, *rows))
    parts = ("qx", "qy", "qz", "qw", "x", "y", "z")
    head = [",".join(["time", *(f"{name}_{part}" for name in names for part in parts)])]
    if motive:
        table = np.hstack((count, table))
        seven = [[f"Skeleton 001:{name}"] * 7 for name in names]
        kinds = (["Rotation"] * 4 + ["Position"] * 3) * len(names)
        head = [
            "Format Version,1.23,Take Name,Take 1,Rotation Type,Quaternion,Length Units,Millimeters"
            ",Coordinate Space,Global",
            "",
            ",".join(["", "Type", *["Bone"] * len(kinds)]),
            ",".join(["", "Name", *(one for own in seven for one in own)]),
            ",".join(["", "ID", *["1"] * len(kinds)]),
            ",".join(["", "", *kinds]),
            ",".join(
                ["Frame", "Time (Seconds)", *["X", "Y", "Z", "W", "X", "Y", "Z"] * len(names)]
            ),
        ]
    lines = [",".join(f"{value:.9g}" for value in row) for row in table]
    path.write_text("\n".join([*head, *lines]) + "\n")
    return found


@pytest.mark.parametrize("motive", [False, True])
def test_rigid_bodies_of_a_csv_are_read(tmp_path: Path, motive: bool) -> None:
    path = tmp_path / "bodies.csv"
    expected = write_bodies(path, motive)
    assert is_human_recording(path)
    found = read_markers(path)
    assert len(found.labels) > 40
    prefix = "Skeleton 001:" if motive else ""
    for k, name in enumerate(found.labels):
        own = expected.labels.index(name.removeprefix(prefix))
        np.testing.assert_allclose(found.positions[:, k], expected.positions[:, own], atol=1e-6)
    text = path.read_text()
    # A body that was not seen leaves a gap, and one on a limb, not at its joint, is said.
    lines = text.splitlines()
    lines[9] = ",".join(lines[9].split(",")[:2] + [""] * (len(lines[9].split(",")) - 2))
    path.write_text("\n".join(lines))
    row = 9 - (7 if motive else 1)
    assert np.isnan(read_markers(path).positions[row, 2:]).all()
    for old, new, words in (
        (
            *[
                ("Quaternion", "XYZ", "export quaternions"),
                ("Millim", "Furl", "lengths in 'Furleters'"),
            ],
            (",Name,", ",Nmae,", "no rows Name and Frame"),
        )
        if motive
        else [("_qw", "_q", "names no rigid")]
    ):
        path.write_text(text.replace(old, new))
        with pytest.raises(RecordingError, match=words):
            read_markers(path)
    path.write_text("time,base_x,base_y,base_z,base_qx,base_qy,base_qz,base_qw\n0,0,0,0,0,0,0,1\n")
    assert not is_human_recording(path)  # a robot's


def test_two_skeletons_in_one_table_need_a_subject(tmp_path: Path) -> None:
    path = tmp_path / "bodies.csv"
    write_bodies(path, motive=True)
    rows = [line.split(",") for line in path.read_text().splitlines()]
    name, where = rows[3][2:], rows[6][2:]
    for row in rows[2:7]:
        row += [cell.replace("Skeleton 001", "Bo") for cell in row[2:]]
    across = [
        kind == "X" and axis == 4 for kind, axis in zip(where, [*range(7)] * 99, strict=False)
    ]
    assert sum(across) * 7 == len(name)
    for row in rows[7:]:
        row += [
            f"{float(cell) + 2000.0:.9g}" if x else cell
            for cell, x in zip(row[2:], across, strict=True)
        ]
    path.write_text("\n".join(",".join(row) for row in rows) + "\n")
    found = read_markers(path)
    with pytest.raises(RecordingError, match="2 humans, Skeleton 001, Bo: choose one"):
        human_motion(found, mass=70.0)
    one = human_motion(found, mass=70.0, subject="Skeleton 001")
    bo = human_motion(found, mass=70.0, subject="Bo")
    np.testing.assert_allclose(bo.motion.base[:, 0] - one.motion.base[:, 0], 2.0, atol=1e-5)
    np.testing.assert_allclose(bo.motion.joints, one.motion.joints, atol=1e-4)


def test_bvh_of_two_humans_is_refused_and_a_prop_is_not(tmp_path: Path) -> None:
    path = tmp_path / "a.bvh"
    write_bvh(path)
    alone, text = read_markers(path), path.read_text()
    head, begin = text[: text.index("MOTION")], text.index("Frame Time: 0.01") + 17
    rows = text[begin:].splitlines()
    other = head.removeprefix("HIERARCHY\n")
    tail = text[len(head) : begin] + "\n".join(f"{row} {row}" for row in rows)
    path.write_text(head + other.replace("Hips", "Bo") + tail)
    with pytest.raises(RecordingError, match="2 humans, Hips, Bo: write a file for each"):
        read_markers(path)
    other = other.replace("UpLeg", "Rod").replace("Hips", "Table")
    path.write_text(head + other + tail)
    found = read_markers(path)
    assert found.labels == alone.labels
    np.testing.assert_array_equal(found.positions, alone.positions)


def test_smpl_poses_are_read(tmp_path: Path) -> None:
    path, frames = tmp_path / "amass.npz", 10
    poses = np.zeros((frames, 156))
    poses[:, 0] = np.pi / 2  # y up to z up, as AMASS has it
    poses[:, 3 * 4] = np.linspace(0.0, 1.0, frames)  # the left knee bends
    trans = np.tile((0.0, 0.0, 0.95), (frames, 1))
    np.savez(path, poses=poses, trans=trans, mocap_framerate=120.0, gender=np.array("male"))
    assert is_human_recording(path)
    human = human_motion(read_markers(path, stature=1.8), mass=70.0, stature=1.8)
    robot = human.motion.robot
    knee = human.motion.joints[:, robot.joint_names.index("left_knee_flexion")]
    np.testing.assert_allclose(knee - knee[0], np.linspace(0.0, 1.0, frames), atol=0.05)
    assert human.motion.rate == pytest.approx(120.0)
    arms = human.motion.robot.snapshot(np.r_[human.motion.base[0], human.motion.joints[0]])
    span = arms.position("left_hand") - arms.position("right_hand")
    # A T-pose, facing against y of the world: the left hand is at +x.
    assert span[0] == pytest.approx(2 * 1.8 / 1.741 * (0.175 + 0.282 + 0.269), rel=0.03)
    np.savez(tmp_path / "robot.npz", time=np.arange(9.0), knee=np.zeros(9))
    assert not is_human_recording(tmp_path / "robot.npz")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.replace("PathFileType", "Path"), "does not begin as a TRC file"),
        (lambda t: t.replace("\tmm\t", "\tfurlong\t"), "Units: expected mm"),
        (lambda t: t.replace("0.00000", "soon", 1), "row 1 .line 7.: 'soon' is not a number"),
        (lambda t: t.replace("0.00000", "7e300", 1), "row 1: 7e.300 is no measured number"),
        (lambda t: "\n".join(t.splitlines()[:9]), "at least 8 are needed"),
    ],
)
def test_trc_mistakes_are_refused(tmp_path: Path, change, words: str) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "a.trc"
    write_trc(path, recorded(BODY, seconds=0.1)[0])
    path.write_text(change(path.read_text()))
    with pytest.raises(RecordingError, match=words):
        read_markers(path)


NESTED = "JOINT a\n{\nOFFSET 0 1 0\n"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t.replace("Frame Time: 0.01", "Frame Time: 0"), "frame time is 0 s"),
        (lambda t: t.replace("Frames: 12", "Frames: 13"), "declares 13 frames and has 12"),
        (lambda t: t[: t.index("Frame Time")], "no frames"),
        (lambda t: t.replace("CHANNELS 3", "CHANNELS 4", 1), r"line \d+: .*channels 'CHANNELS 4"),
        (lambda t: t.replace("OFFSET 0 60 0", "OFFSET 0 sixty 0"), r"line \d+: expected 3 numbers"),
        (lambda t: t.replace("JOINT Neck", "ROOT Neck"), r"line \d+: a root in a joint"),
        (lambda t: t.replace("JOINT Neck", "JIONT Neck"), r"line \d+: .* is not expected here"),
        (lambda t: t.replace("}\nMOTION", "MOTION"), "not closed"),
        (lambda t: t.replace("JOINT Neck", NESTED * 300 + "JOINT Neck"), "nested over"),
        (lambda t: t.replace("-42", "-4e7"), "in no usual unit a human"),
    ],
)
def test_bvh_mistakes_are_refused(tmp_path: Path, change, words: str) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "a.bvh"
    write_bvh(path)
    path.write_text(change(path.read_text()))
    with pytest.raises(RecordingError, match=words):
        read_markers(path)
    with pytest.raises(RecordingError, match="unit: expected"):
        write_bvh(path)
        read_markers(path, unit="furlong")


@pytest.mark.parametrize(
    ("kind", "origin", "taken", "words"),
    [
        (3, (0.12, 0.2), (0.12, 0.2), None),
        (
            3,
            (0.201, 0.11),
            (0.11, 0.201),
            "201 of 200 mm and 110 of 300 mm .*: x and y are exchanged",
        ),
        (3, (0.0, 0.0), (0.0, 0.0), "0 of 200 mm and 0 of 300 mm .* so is its CoP"),
        (3, (0.35, 0.25), (0.35, 0.25), "so is its CoP"),
        (2, (0.2001, -0.3), (0.2001, -0.3), None),  # in its corner, as a treadmill's
        (2, (0.9, 0.0), (0.9, 0.0), "so is its CoP"),
        (1, (9.0, 9.0), (9.0, 9.0), None),
    ],
)
def test_sensors_outside_a_plate_are_noted(kind, origin, taken, words) -> None:
    corners = np.array(((0.2, 0.3, 0.0), (-0.2, 0.3, 0.0), (-0.2, -0.3, 0.0), (0.2, -0.3, 0.0)))
    found, notes = _sensors("plate", kind, corners, np.array((*origin, -0.05)))
    np.testing.assert_array_equal(found, (*taken, -0.05))
    assert len(notes) == (words is not None)
    assert all(re.search(str(words), note) for note in notes)


def test_floats_of_a_vax_are_read() -> None:
    """As an F_floating is laid out: 1.0 is 0x4080 in the first half, -0.15625 is 0xbf20."""
    from wbc.human.c3d_parameters import DEC, floats

    data = bytes((0x80, 0x40, 0, 0, 0x20, 0xBF, 0, 0))
    np.testing.assert_array_equal(floats(data, DEC), [1.0, -0.15625])


def test_smpl_poses_in_two_arrays_are_those_in_one(tmp_path: Path) -> None:
    poses = 0.1 * np.random.default_rng(0).standard_normal((9, 66))
    rest = {"trans": np.zeros((9, 3)), "mocap_framerate": 60.0}
    np.savez(tmp_path / "one.npz", poses=poses, **rest)
    np.savez(tmp_path / "two.npz", root_orient=poses[:, :3], pose_body=poses[:, 3:], **rest)
    np.savez(tmp_path / "shaped.npz", poses=poses.reshape(9, 22, 3), **rest)
    smplx = {"global_orient": poses[:, :3], "body_pose": poses[:, 3:].reshape(9, 21, 3)}
    np.savez(tmp_path / "smplx.npz", **smplx, transl=rest["trans"], fps=60)
    one = read_markers(tmp_path / "one.npz")
    for name in ("two", "shaped", "smplx"):
        assert is_human_recording(tmp_path / f"{name}.npz")
        found = read_markers(tmp_path / f"{name}.npz")
        np.testing.assert_array_equal(one.positions, found.positions)
    for parts, words in (
        ({"root_orient": poses[:5, :3], "pose_body": poses[:, 3:]}, "differ in length"),
        ({"poses": poses[:, :60]}, r"poses have shape \(9, 60\)"),
        ({"q": poses}, "no array poses, nor root_orient and pose_body: no human's"),
        *(
            ({"poses": np.ones((9, 24, *shape))}, "not matrices or quat")
            for shape in ((3, 3), (4,))
        ),
    ):
        np.savez(tmp_path / "wrong.npz", **parts, **rest)
        with pytest.raises(RecordingError, match=words):
            read_markers(tmp_path / "wrong.npz")


def test_recordings_from_wrong_arrays_are_refused() -> None:
    time, places = np.arange(9.0), np.zeros((9, 2, 3))
    apart = np.array([[0.0], [2e3]])
    assert repr(MarkerRecording(time, ("a", "b"), places)) == (
        "MarkerRecording(2 markers, 9 frames, 8 s)"
    )
    for arguments, words in (
        ((time, "ab", places), "labels: expected names, got 'ab'"),
        ((time[::-1], ("a", "b"), places), "time must increase"),
        ((time[:0], ("a", "b"), places[:0]), "it has no frames"),
        ((time, ("a", "a"), places), "'a' is there twice"),
        ((time, ("a", "b", "c"), places), r"shape \(9, 2, 3\), expected \(9, 3, 3\)"),
        ((time, ("a", "b"), places + apart), "over 1000 m from the others; are its units"),
        ((time, ("a", "b"), places, (), "up"), "axis that is up"),
    ):
        with pytest.raises(WbcError, match=words):
            MarkerRecording(*arguments)
    few = MarkerRecording(time[:3], ("a", "b"), places[:3])  # a static trial's
    for use in (few.check_moving, lambda: human_motion(few)):
        with pytest.raises(WbcError, match="3 frames; at least"):
            use()
    with pytest.raises(WbcError, match="expected x, y, z, -x, -y, -z, got 'w'"):
        MarkerRecording(time, ("a", "b"), places).upright("w")
    with pytest.raises(WbcError, match="times must increase, at least two"):
        ForcePlate("plate", np.zeros(2), np.zeros((2, 3)), np.zeros((2, 3)))


def test_rows_that_a_header_declares_and_that_are_not_there_are_told(tmp_path: Path) -> None:
    """A file cut off at the end of a line was read in silence."""
    path, (recording, _) = tmp_path / "a.trc", recorded(BODY, seconds=0.2)
    write_trc(path, recording)
    path.write_text("\n".join(path.read_text().splitlines()[:-5]))
    forces = tmp_path / "a.mot"
    names = "\t".join(f"ground_force_{part}{axis}" for part in "vp" for axis in "xyz")
    rows = "".join(f"{t}\t0\t500\t0\t0\t0\t0\n" for t in (0.0, 0.1))
    forces.write_text(f"grf\ndatarows 3\ndatacolumns 7\nendheader\ntime\t{names}\n{rows}")
    notes = read_markers(path, forces=forces).notes
    told = "the header declares {} rows, {} are there: it is an excerpt, or cut off"
    assert notes == (told.format(20, 15), told.format(3, 2))
