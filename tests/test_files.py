"""Writing where the system refuses: a limit of a file's size stands for a full disk."""

import json
import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from qpbench.page import put_section

from tests.command import wbc_command
from wbc.cli.outputs import Outputs
from wbc.files import write_text, write_whole
from wbc.journal import Journal, JournalError
from wbc.rmp.functions import export_c
from wbc.rmp.planar import PlanarRmp

REFUSED = "File too large"  # what the system says beyond the limit
HEAD = {"of": "a test"}
TEXT = "x" * 20
LINE = len(json.dumps({"run": 1, "text": TEXT})) + 1  # bytes of an entry in a journal


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """Let the system refuse to write files beyond a size [bytes]; Python ignores its signal."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_write_whole_on_a_full_disk_keeps_what_was_there_and_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    write_text(path, "old")
    with largest_file(1000), pytest.raises(OSError, match=REFUSED) as caught:
        write_text(path, "new" * 1000)
    assert caught.value.filename == str(path)
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["result.json"]


def test_write_whole_takes_the_longest_names_that_the_system_does(tmp_path: Path) -> None:
    for name in ("n" * 255, "ä" * 127):
        write_text(tmp_path / name, "x")
        assert (tmp_path / name).read_text() == "x"


def test_errors_without_a_number_are_told(tmp_path: Path) -> None:
    def fill(file: object) -> None:
        raise OSError("encoder error -2 when writing image file")  # as Pillow does

    with pytest.raises(OSError, match="encoder error -2"):
        write_whole(tmp_path / "a", fill)


@pytest.mark.parametrize("room", range(0, 100, 7))
def test_a_journal_on_a_full_disk_keeps_whole_lines_and_goes_on(tmp_path: Path, room: int) -> None:
    path = tmp_path / "journal"
    with Journal(path, HEAD) as journal:
        journal.add({"run": 0})
        before = path.read_bytes()
        with largest_file(len(before) + room), pytest.raises(JournalError, match=REFUSED) as caught:
            for number in range(1, 9):
                journal.add({"run": number, "text": TEXT})
        assert "\n" not in str(caught.value) and "is kept there" in str(caught.value)
    kept = path.read_bytes()
    assert kept.startswith(before) and kept.endswith(b"\n") and len(kept) <= len(before) + room
    with Journal(path, HEAD) as journal:
        assert [entry["run"] for entry in journal.entries] == list(range(1 + room // LINE))
        journal.add({"run": 9})
    assert json.loads(path.read_bytes().splitlines()[-1]) == {"run": 9}


def test_a_journal_that_cannot_begin_leaves_nothing(tmp_path: Path) -> None:
    with largest_file(5), pytest.raises(JournalError, match=REFUSED):
        Journal(tmp_path / "journal", HEAD)
    assert not os.listdir(tmp_path)
    for place in (tmp_path, tmp_path / "missing" / "journal"):
        with pytest.raises(JournalError, match=r"cannot be written: (Is a|No such)"):
            Journal(place, HEAD)


def test_casadis_own_c_is_not_cut_short_in_silence(tmp_path: Path) -> None:
    """CasADi's streams fail without a word; its source has 50 kB, its header 9."""
    for size in (0, 4096, 20_000):
        with largest_file(size), pytest.raises(OSError, match="is the disk full"):
            export_c(PlanarRmp(20.0), tmp_path)
    assert not os.listdir(tmp_path)


def test_a_page_that_cannot_be_written_stays(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# By hand\n")
    with largest_file(100), pytest.raises(OSError, match=REFUSED):
        put_section(page, "solvers", "x" * 1000)
    assert page.read_text() == "# By hand\n"


def test_a_result_that_can_be_written_nowhere_is_told_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    outputs = Outputs()
    with largest_file(10):
        outputs.save(tmp_path / "r.json", lambda path: write_text(path, "x" * 100))
    assert outputs.exit_code() == 1
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "nor into a temporary folder" in told and "is lost" in told
    assert not os.listdir(tmp_path)


def command(*arguments: object) -> tuple[int, str]:
    done = wbc_command(*arguments)
    assert done.exception is None or isinstance(done.exception, SystemExit)
    return done.exit_code, done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ("schema", "-o", "{}/s.json"),
        ("init", "{}/p.yaml"),
        ("codegen", "planar", "--mass", "20", "-o", "{}"),
    ],
)
def test_commands_on_a_full_disk_say_one_line(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    with largest_file(100):
        code, told = command(*(one.format(tmp_path) for one in arguments))
    assert code == 1 and told.startswith("error: ") and told.count("\n") == 1
    assert not os.listdir(tmp_path)


def test_folders_in_place_of_files_are_told_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "planarrmp.h").mkdir()
    code, told = command("codegen", "planar", "--mass", "20", "-o", tmp_path)
    assert code == 1 and told == f"error: {tmp_path}/planarrmp.h: Is a directory\n"


@pytest.mark.slow
def test_output_that_cannot_be_printed_is_told_in_one_line() -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    for arguments in (["schema"], ["--help"]):
        with open("/dev/full", "w") as full:
            done = subprocess.run(
                [sys.executable, "-m", "wbc", *arguments], stdout=full, stderr=subprocess.PIPE,
                text=True, check=False,
            )  # fmt: skip
        assert done.returncode == 1
        assert done.stderr == "error: the system refuses: No space left on device\n"


def test_sequences_that_cannot_all_be_kept_leave_no_folder(tmp_path: Path) -> None:
    problem = tmp_path / "stand.yaml"
    problem.write_text(
        "robot: hoap2_like\nsupport: double\n"
        "tasks: {com: {type: com, target: {offset: [0, 0, -0.01]}}, posture: {type: posture}}\n"
    )
    folder = tmp_path / "sequences"
    with largest_file(100):
        code, told = command("bench", problem, "--ticks", 2, "--sequences", folder, "-q")
    last = told.splitlines()[-1]  # after a note, if this process may use several threads
    assert code == 1 and last.startswith(f"error: {folder}/") and last.endswith(REFUSED)
    assert not folder.exists()
