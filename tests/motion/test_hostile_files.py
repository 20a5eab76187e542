"""Files made to break a reader: every one ends in a typed error or a sound motion, and soon.

``WBC_FUZZ=100000`` tries as many mutated files instead of a few hundred.
"""

import io
import os
import random
import struct
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from tests.damage import damaged
from wbc.errors import WbcError
from wbc.motion import RecordingError, analyze, read_motion
from wbc.motion import table as tables
from wbc.robot import Robot

COUNT = int(os.environ.get("WBC_FUZZ", "400"))
SECONDS = 3.0  # for one file, on a busy machine
TIME = np.arange(20) / 100.0
OPTIONS = ({}, {"fill": True, "longest_gap": 10.0}, {"rate": 50.0, "missing": "standing"})


@pytest.fixture(scope="module")
def good(hoap2: Robot) -> dict[str, np.ndarray]:
    q = np.tile(hoap2.postures["standing"], (len(TIME), 1))
    q[:, 7:] += 0.01 * np.sin(5.0 * TIME)[:, None]
    return {"time": TIME, "q": q}


def csv_bytes(robot: Robot, good: dict[str, np.ndarray]) -> bytes:
    file = io.StringIO()
    rows = np.column_stack((good["time"], good["q"][:, 7:]))
    header = ",".join(("time", *robot.joint_names))
    np.savetxt(file, rows, delimiter=",", header=header, comments="", fmt="%.6g")
    return file.getvalue().encode()


def npz_bytes(arrays: dict[str, np.ndarray], compressed: bool) -> bytes:
    file = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(file, **arrays)
    return file.getvalue()


def npy_bytes(header: str, data: bytes = b"", version: bytes = b"\x01\x00") -> bytes:
    """Return an array's file with a header of one's own."""
    text = (header + "\n").encode("latin1")
    size = struct.pack("<H" if version == b"\x01\x00" else "<I", len(text))
    return b"\x93NUMPY" + version + size + text + data


def zip_bytes(entries: dict[str, bytes], method: int = zipfile.ZIP_STORED) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, content in entries.items():
            archive.writestr(name, content)
    return file.getvalue()


def outcome(path: Path, robot: Robot, **options: object) -> Exception | None:
    """Read a file and reduce it: only typed errors and finite numbers pass, and only soon."""
    began = time.process_time()
    try:
        motion = read_motion(path, robot, **options)
        assert np.isfinite(motion.joints).all() and np.isfinite(motion.time).all()
        series = analyze(motion, planted="auto" if motion.base is None else None, cutoff=None)
        assert np.isfinite(series.com).all() and np.isfinite(series.acceleration).all()
        error = None
    except WbcError as caught:
        error = caught
        assert len(str(error)) < 3000
    assert time.process_time() - began < SECONDS
    return error


# ---------------------------------------------------------------------- mutations


@pytest.mark.parametrize("part", range(4))
def test_mutated_files_raise_typed_errors(hoap2, good, tmp_path, part) -> None:
    named = {name: good["q"][:, 7 + k] for k, name in enumerate(hoap2.joint_names)}
    models = {
        "csv": [csv_bytes(hoap2, good)],
        "npz": [npz_bytes(good, True), npz_bytes(good, False), npz_bytes(named, False)],
    }
    rng = random.Random(part)
    errors = 0
    for k in range(max(COUNT // 4, 1)):
        ending = ("csv", "npz")[k % 2]
        model = rng.choice(models[ending])
        path = tmp_path / f"m.{ending}"
        path.write_bytes(damaged(model, rng))
        errors += outcome(path, hoap2, **rng.choice(OPTIONS)) is not None
    assert errors > COUNT // 20  # they were hostile indeed


def test_mutated_array_headers_raise_typed_errors(hoap2: Robot, tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    header = "{'descr': '<f8', 'fortran_order': False, 'shape': (20,), }"
    pieces = (
        *("|O", "<f8", ">c16", "|V9999999", "<M8[s]", "<U99999999", "[('a', '<f8')]"),
        *("(2**60,)", "(-1,)", "()", "((((((", "(99999999999999, 8)", "'", "True", "\\", "{", "}"),
    )
    errors, count = 0, max(COUNT // 4, 1)
    for _ in range(count):
        text = header
        for _ in range(int(rng.integers(1, 4))):
            at = int(rng.integers(0, len(text)))
            end = at + int(rng.integers(0, 12))
            text = text[:at] + pieces[int(rng.integers(0, len(pieces)))] + text[end:]
        path = tmp_path / "h.npz"
        path.write_bytes(zip_bytes({"time.npy": npy_bytes(text, bytes(160))}))
        errors += outcome(path, hoap2, missing="standing") is not None
    assert errors > count // 2  # they were hostile indeed


# ---------------------------------------------------------------------- by hand


HUGE = "{'descr': '<f8', 'fortran_order': False, 'shape': (9895604649984,), }"  # 72 TiB
OVERFLOWING = "{'descr': '<f8', 'fortran_order': False, 'shape': (4294967296, 4294967296), }"
OBJECTS = "{'descr': '|O', 'fortran_order': False, 'shape': (20,), }"
SOUND = "{'descr': '<f8', 'fortran_order': False, 'shape': (20,), }"


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (npy_bytes(HUGE, bytes(160)), "not what the file holds"),
        (npy_bytes(OVERFLOWING, bytes(160)), "not what the file holds"),
        (npy_bytes(OBJECTS, bytes(160)), "real numbers"),
        (npy_bytes(SOUND, bytes(152)), "not what the file holds"),
        (npy_bytes("{" * 5000), "cannot be read"),
        (npy_bytes("(" * 60000), "cannot be read"),
        (npy_bytes("{'descr': '<f8', 'shape': (20,)}", bytes(160)), "cannot be read"),
        (npy_bytes("{}" * 4, version=b"\x02\x00"), "cannot be read"),
        (npy_bytes(SOUND, bytes(160), version=b"\x03\x00"), "version"),
        (npy_bytes(SOUND, bytes(160), version=b"\x09\x07"), "version"),
        (b"\x93NUMPY", "cannot be read"),
        (b"", "cannot be read"),
    ],
)
def test_bad_array_headers_are_refused(hoap2, tmp_path, array, words) -> None:
    path = tmp_path / "h.npz"
    path.write_bytes(zip_bytes({"time.npy": array}))
    error = outcome(path, hoap2, missing="standing")
    assert isinstance(error, RecordingError) and words in str(error)


def test_bad_archives_are_refused(hoap2, good, tmp_path) -> None:
    arrays = {f"{name}.npy": npz_entry(good, name) for name in good}
    path = tmp_path / "a.npz"

    def refused(content: bytes) -> str:
        path.write_bytes(content)
        error = outcome(path, hoap2)
        assert isinstance(error, RecordingError)
        return str(error)

    for method in (zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        assert "unknown compression" in refused(zip_bytes(arrays, method))
    content = bytearray(zip_bytes(arrays))
    directory = content.index(b"PK\x01\x02")
    encrypted = content.copy()
    encrypted[6] |= 1  # the flag, in the entry's own header and in the directory
    encrypted[directory + 8] |= 1
    assert "encrypted" in refused(bytes(encrypted))
    exotic = content.copy()
    exotic[8:10] = exotic[directory + 10 : directory + 12] = b"\x63\x00"
    assert "unknown compression" in refused(bytes(exotic))
    packed = bytearray(zip_bytes(arrays, zipfile.ZIP_DEFLATED))
    packed[60:90] = bytes(30)
    assert "cannot be read" in refused(bytes(packed))
    assert "holds no arrays" in refused(zip_bytes({}))
    with pytest.warns(UserWarning, match="Duplicate name"):
        twice = io.BytesIO()
        with zipfile.ZipFile(twice, "w") as archive:
            archive.writestr("time.npy", arrays["time.npy"])
            archive.writestr("time.npy", arrays["time.npy"])
    assert "there twice" in refused(twice.getvalue())


def npz_entry(arrays: dict[str, np.ndarray], name: str) -> bytes:
    file = io.BytesIO()
    np.save(file, arrays[name])
    return file.getvalue()


def test_sizes_are_refused_before_anything_is_unpacked(hoap2, good, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(tables, "MAX_BYTES", 10_000)
    bomb = zip_bytes({"time.npy": bytes(20_000)}, zipfile.ZIP_DEFLATED)
    assert len(bomb) < 1_000
    for name, content in (("a.npz", bomb), ("a.csv", b"a" * 20_000)):
        (tmp_path / name).write_bytes(content)
        error = outcome(tmp_path / name, hoap2)
        assert isinstance(error, RecordingError) and "at most 10000" in str(error)


def test_irregular_files_are_refused(hoap2: Robot, tmp_path: Path) -> None:
    (tmp_path / "folder.csv").mkdir()
    os.mkfifo(tmp_path / "pipe.npz")  # would wait for a writer for ever
    for name in ("folder.csv", "pipe.npz", "a\0b.csv", "x" * 300 + ".npz"):
        error = outcome(tmp_path / name, hoap2)
        assert isinstance(error, RecordingError) and "cannot be read" in str(error)


def test_wide_and_long_text_is_refused(hoap2, good, tmp_path) -> None:
    path = tmp_path / "a.csv"
    first, rest = csv_bytes(hoap2, good).decode().split("\n", 1)
    row = rest.split("\n", 1)[0]
    cases = {
        "a cell of 200,000 digits": f"{first}\n{row.replace(',', ',' + '1' * 200_000, 1)}\n{rest}",
        "a long cell in quotes": f'{first}\n"{"x" * 200_000}"\n{rest}',
        "a long name": f"{first},{'y' * 200_000}\n{rest}",
        "spaces in a name": f"{first},a{' ' * 100_000}b\n{rest}",
        "spaces before a bracket": f"{first},a{' ' * 100_000}(\n{rest}",
        "brackets": f"{first},{'(' * 50_000}{')' * 50_000}\n{rest}",
        "60,000 columns": ",".join(f"c{k}" for k in range(60_000)) + "\n" + "0," * 59_999 + "0\n",
        "60,000 columns of one name": ",".join(["c"] * 60_000) + "\n" + "0," * 59_999 + "0\n",
        "quotes over lines": f'{first}\n"1\n2\n{rest}',
        "numbers with underscores": f"{first}\n{row.replace('0', '0_0', 1)}\n{rest}",
        "NUL": f"{first}\n\0{rest}",
    }
    for name, text in cases.items():
        path.write_text(text)
        assert isinstance(outcome(path, hoap2), WbcError), name
    path.write_text(cases["60,000 columns"])
    assert "time" in str(outcome(path, hoap2, ignore=["c*"]))
