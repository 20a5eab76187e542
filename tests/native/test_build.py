"""Where the core comes from, and every way in which it cannot be had."""

import ctypes
import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from wbc.errors import UnknownNameError
from wbc.native import VARIABLE, NativeCoreError, build, core, library, mode, status
from wbc.robot import Robot

ROOT = os.geteuid() == 0
compiles = pytest.mark.skipif(
    not any(shutil.which(name) for name in build.COMPILERS), reason="no C compiler here"
)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch):
    """An empty cache and a library that is not loaded yet."""
    monkeypatch.setenv(build.CACHE_VARIABLE, str(tmp_path))
    monkeypatch.setattr(library, "SHIPPED", tmp_path / "none")
    monkeypatch.setenv(VARIABLE, "auto")  # and back at the end, whatever is set between
    monkeypatch.delenv("CC", raising=False)
    library._loaded.cache_clear()
    yield tmp_path / "native"
    library._loaded.cache_clear()


def script(path: Path, text: str) -> str:
    path.write_text("#!/bin/sh\n" + text + "\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


def why() -> str:
    """Return why there is no core; Python runs all the same, and ``require`` says the same."""
    assert core() is None
    reason = status().reason
    robot = Robot.load("hoap2_like")
    assert robot.native is None
    assert robot.snapshot(robot.posture()).com.shape == (3,)
    os.environ[VARIABLE] = "require"  # the fixture takes it back
    with pytest.raises(NativeCoreError, match=VARIABLE) as raised:
        Robot.load("hoap2_like").snapshot(robot.posture())
    assert reason in str(raised.value)
    return reason


@pytest.mark.slow
@compiles
def test_it_is_compiled_once_and_then_found(cache: Path, monkeypatch) -> None:
    first = core()
    assert first is not None
    assert first.path.parent.parent == cache
    assert [path.name for path in cache.iterdir()] == [first.path.parent.name]  # nothing is left
    made = first.path.stat().st_mtime_ns
    monkeypatch.setattr(build, "_compile", None)  # not called again
    library._loaded.cache_clear()
    again = core()
    assert again is not None
    assert again.path == first.path
    assert again.path.stat().st_mtime_ns == made
    monkeypatch.setenv(VARIABLE, "require")
    assert core() is again


def test_off(monkeypatch) -> None:
    monkeypatch.setenv(VARIABLE, " OFF ")
    monkeypatch.setattr(build, "built", None)
    assert core() is None
    assert status() == (None, f"{VARIABLE}=off")


def test_a_misspelt_mode_is_an_error(monkeypatch) -> None:
    monkeypatch.setenv(VARIABLE, "requir")
    for ask in (mode, core, status):
        with pytest.raises(UnknownNameError, match="did you mean 'require'"):
            ask()


def test_no_compiler(monkeypatch) -> None:
    monkeypatch.setattr(build, "COMPILERS", ("no-such-compiler",))
    assert "no C compiler (no-such-compiler); install one" in why()


def test_a_compiler_that_is_not_there(monkeypatch) -> None:
    monkeypatch.setenv("CC", "/no/such/cc -m64")
    assert "CC='/no/such/cc -m64' is not found" in why()


def test_a_command_that_cannot_be_read(monkeypatch) -> None:
    monkeypatch.setenv("CC", "cc '")
    assert "cannot be read" in why()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("echo 'this is broken' >&2; exit 3", "exit code 3); it said: this is broken"),
        ("exit 0", "exit code 0); it said: nothing"),  # and writes nothing
        ("sleep 5", "was not done after 0.2 s"),
    ],
)
def test_a_broken_compiler(text: str, said: str, tmp_path: Path, monkeypatch, cache) -> None:
    monkeypatch.setenv("CC", script(tmp_path / "broken", text))
    monkeypatch.setattr(build, "LONGEST", 0.2)
    assert said in why()
    assert list(cache.iterdir()) == []


def test_a_compiler_that_writes_something_else(tmp_path: Path, monkeypatch) -> None:
    """The file that comes behind -o holds no library."""
    text = 'while [ "$1" != -o ]; do shift; done; echo no library > "$2"'
    monkeypatch.setenv("CC", script(tmp_path / "broken", text))
    assert "cannot be loaded" in why()


def test_no_cache(monkeypatch) -> None:
    monkeypatch.setenv(build.CACHE_VARIABLE, "off")
    assert "WBC_CACHE=off" in why()


@compiles
def test_a_file_in_the_way_of_the_cache(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv(build.CACHE_VARIABLE, str(tmp_path / "file"))
    assert "no folder for what is compiled" in why()


@compiles
@pytest.mark.skipif(ROOT, reason="root may write everywhere")
def test_an_unwritable_cache(cache: Path) -> None:
    cache.mkdir(mode=0o500)
    assert "cannot be written to" in why()


@compiles
def test_a_cache_that_others_may_write_to(cache: Path) -> None:
    cache.mkdir()
    cache.chmod(0o777)
    assert "can be written to by others" in why()


@pytest.mark.slow
@compiles
@pytest.mark.parametrize("damage", ["truncated", "changed", "no checksum", "another library"])
def test_a_poisoned_build_is_not_loaded(damage: str, cache: Path) -> None:
    """It is made anew, by content: nothing of what was put there runs."""
    path = build.built()
    content = path.read_bytes()
    if damage == "truncated":
        path.write_bytes(content[: len(content) // 2])
    elif damage == "changed":
        path.write_bytes(content[:1000] + b"?" + content[1001:])
    elif damage == "no checksum":
        (path.parent / build.CHECKSUM).unlink()
    else:  # whole and well-formed, as from another machine: it cannot be loaded
        path.write_bytes(b"\x7fELF of another machine")
        (path.parent / build.CHECKSUM).write_text(build._checksum(path.read_bytes()))
    found = core()
    assert found is not None
    assert found.path == path
    assert path.read_bytes() == content  # compilers give the same bits for the same source


@pytest.mark.slow
@compiles
def test_a_library_of_another_version_is_not_used(monkeypatch) -> None:
    monkeypatch.setattr(library, "VERSION", 10**6)
    assert "is of version" in why()


@pytest.mark.slow
@compiles
def test_what_a_wheel_carries_is_used_without_a_compiler(tmp_path: Path, monkeypatch) -> None:
    folder = tmp_path / "package"
    folder.mkdir()
    build._compile(build.find_compiler(), folder / "_core.here.so")
    monkeypatch.setattr(library, "SHIPPED", folder)
    monkeypatch.setattr(build, "COMPILERS", ())
    found = core()
    assert found is not None
    assert found.path == folder / "_core.here.so"


@pytest.mark.slow
@compiles
@pytest.mark.parametrize("damage", ["no library", "other sources"])
def test_what_a_wheel_carries_is_not_used_if_it_does_not_fit(
    damage: str, tmp_path: Path, monkeypatch, cache: Path
) -> None:
    """As after sources were edited in place: the core is compiled as if there were none."""
    folder = tmp_path / "package"
    folder.mkdir()
    if damage == "no library":
        (folder / "_core.here.so").write_bytes(b"no library")
    else:
        with monkeypatch.context() as patch:
            patch.setattr(build, "fingerprint", lambda: "of another day")
            build._compile(build.find_compiler(), folder / "_core.here.so")
    monkeypatch.setattr(library, "SHIPPED", folder)
    found = core()
    assert found is not None
    assert found.path.parent.parent == cache


@pytest.mark.slow
@compiles
def test_processes_that_build_at_once(cache: Path) -> None:
    """All end with the same whole build, and leave nothing beside it."""
    code = (
        "from pathlib import Path; from wbc.native import core, library;"
        "library.SHIPPED = Path('none'); print(core().path)"
    )
    command = [sys.executable, "-c", code]
    running = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(4)]
    paths = {process.communicate(timeout=60)[0].strip() for process in running}
    assert [process.returncode for process in running] == [0] * 4
    assert len(paths) == 1
    assert [path.name for path in cache.iterdir()] == [Path(paths.pop()).parent.name]


@compiles
def test_flags_and_compiler_decide_on_the_build(monkeypatch, tmp_path: Path) -> None:
    found = build.find_compiler()
    keys = {build._key(found), build._key([*found, "-g"])}
    monkeypatch.setattr(build, "FLAGS", (*build.FLAGS, "-g"))
    keys.add(build._key(found))
    copy = shutil.copytree(build.SOURCE, tmp_path / "source")
    monkeypatch.setattr("wbc.native.fingerprint.SOURCE", copy)
    (copy / "tree.c").write_text((copy / "tree.c").read_text() + "\n")
    keys.add(build._key(found))
    assert len(keys) == 4


@pytest.mark.slow
@compiles
def test_the_source_is_plain_c99_without_warnings(tmp_path: Path) -> None:
    """And has no memory of its own: no symbol of the library can be written to."""
    strict = ["-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wstrict-prototypes", "-Werror"]
    build._compile([*build.find_compiler(), *strict], tmp_path / "core.so")
    assert ctypes.PyDLL(str(tmp_path / "core.so")).wbc_core_version() == library.VERSION
    names = shutil.which("nm")
    if names is not None:
        listed = subprocess.run(
            [names, "--defined-only", str(tmp_path / "core.so")],
            capture_output=True,
            text=True,
            check=True,
        ).stdout.split("\n")
        kinds = {line.split()[2]: line.split()[1] for line in listed if len(line.split()) == 3}
        ours = {name: kind for name, kind in kinds.items() if kind in "bBdDcC" and name[0] != "_"}
        assert not {name for name in ours if not name.startswith("completed")}, ours
