"""How the core is compiled: the sources, and the build that brings a compiler where none is."""

import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from tests.needs import needs_compiler
from wbc.native import ffi, lib, sources

build_backend = pytest.importorskip("build_backend", reason="needs setuptools")


@pytest.fixture
def nothing_installed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A machine without a compiler: the only folder of programs, empty."""
    programs = tmp_path / "programs"
    programs.mkdir()
    monkeypatch.setenv("PATH", str(programs))
    monkeypatch.setenv("CC", "")  # so that what builds set is taken back, too
    monkeypatch.delenv("CC")
    monkeypatch.setattr(sysconfig, "get_config_var", {"CC": "gcc -pthread"}.get)
    return programs


def program(folder: Path, name: str) -> Path:
    path = folder / name
    path.write_text("#!/bin/sh\n")
    path.chmod(0o755)
    return path


HOOKS = ("get_requires_for_build_wheel", "get_requires_for_build_editable")


@pytest.mark.parametrize("hook", HOOKS)
def test_ziglang_is_required_where_there_is_no_compiler_and_only_there(
    hook: str, nothing_installed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build_backend.build_meta, hook, lambda settings: ["others"])
    required = getattr(build_backend, hook)
    assert required() == ["others", "ziglang>=0.13"]
    monkeypatch.setenv("CC", "no-such-cc -m64")
    assert required() == ["others", "ziglang>=0.13"]
    for name in ("clang", "cc", "gcc"):
        path = program(nothing_installed, name)
        assert required() == ["others"]
        path.unlink()
    monkeypatch.setenv("CC", f"{program(nothing_installed, 'mine')} -m64")
    assert required() == ["others"]


def test_compiler_is_the_one_asked_for_then_pythons_own_then_the_systems(
    nothing_installed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    used = []
    monkeypatch.setattr(
        build_backend.build_meta,
        "build_wheel",
        lambda *_: used.append(build_backend.os.environ["CC"]),
    )
    monkeypatch.setattr(build_backend, "find_spec", lambda name: name)
    for name in (None, "clang", "cc", "gcc", "mine"):
        if name is not None:
            program(nothing_installed, name)
        monkeypatch.delenv("CC", raising=False)
        if name == "mine":
            monkeypatch.setenv("CC", "mine -m64")
        build_backend.build_wheel("folder")
    assert used == [build_backend.ZIG, "clang", "cc", "gcc -pthread", "mine -m64"]
    assert f"{sys.executable} -m ziglang cc" in build_backend.ZIG


def test_what_is_missing_for_the_build_is_said(nothing_installed, monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(build_backend, "find_spec", lambda name: None)
    with pytest.raises(build_backend.CoreBuildError, match=r"no C compiler \(cc, gcc, clang\)"):
        build_backend.build_editable("folder")
    program(nothing_installed, "cc")
    with monkeypatch.context() as patch:
        patch.setattr(sysconfig, "get_path", lambda name: str(tmp_path))
        with pytest.raises(build_backend.CoreBuildError, match=r"Python\.h is missing: install"):
            build_backend.build_editable("folder")

    def fails(*_: object) -> str:
        raise SystemExit("error: command 'cc' failed with exit code 3")

    monkeypatch.setattr(build_backend.build_meta, "build_editable", fails)
    with pytest.raises(
        build_backend.CoreBuildError, match="could not be compiled by 'cc', whose words"
    ):
        build_backend.build_editable("folder")


def test_cffi_knows_all_functions_and_structures_of_the_header() -> None:
    text = re.sub(r"/\*.*?\*/", "", (sources.SOURCE / "core.h").read_text("ascii"), flags=re.S)
    functions = re.findall(r"\bint (wbc_\w+)\(", text)
    assert len(functions) > 15 and set(functions) <= set(dir(lib))
    structs = re.findall(r"^\} (wbc_\w+);", text, flags=re.M)
    assert len(structs) > 5
    for name in structs:  # nothing between the fields
        fields = ffi.typeof(name).fields
        assert ffi.sizeof(name) == sum(ffi.sizeof(field.type) for _, field in fields), name


@pytest.mark.slow
@needs_compiler
def test_the_source_is_plain_c99_without_warnings(tmp_path: Path) -> None:
    """And has no memory of its own: no symbol of the library can be written to."""
    strict = ["-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Wstrict-prototypes", "-Werror"]
    library = tmp_path / "core.so"
    flags = [*sources.FLAGS, "-O1", *strict, "-fPIC", "-shared", "-o", library]
    subprocess.run(["cc", *flags, *sources.SOURCE.glob("*.c"), "-lm"], check=True)
    names = shutil.which("nm")
    if names is not None:
        command = [names, "--defined-only", library]
        listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        kinds = {
            line.split()[2]: line.split()[1] for line in listed.split("\n") if line.count(" ") == 2
        }
        ours = {name: kind for name, kind in kinds.items() if kind in "bBdDcC" and name[0] != "_"}
        assert not {name for name in ours if not name.startswith("completed")}, ours
