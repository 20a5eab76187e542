"""Exported C: complete, and where a compiler exists, with the results of CasADi's machine."""

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from wbc.cli import app
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.rmp.functions import CompilerError, compile_c, export_c, largest_difference
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import EulerSolidRmp, SolidRmp


@pytest.mark.slow
@pytest.mark.parametrize("kind", (PlanarRmp, SolidRmp, EulerSolidRmp))
def test_compiled_functions_agree(kind: type[PlanarRmp], tmp_path: Path) -> None:
    model = kind(20.0)
    source = export_c(model, tmp_path)
    text = source.read_text()
    assert all(f"int {name}(const casadi_real** arg" in text for name in model.functions)
    assert source.with_suffix(".h").exists()
    if shutil.which("cc") is None:
        with pytest.raises(CompilerError, match="cannot run the C compiler 'cc'"):
            compile_c(source)
    else:
        assert largest_difference(model, compile_c(source)) < 1e-12


def test_some_functions_only(tmp_path: Path) -> None:
    text = export_c(PlanarRmp(20.0), tmp_path, ["energies"]).read_text()
    assert "int energies(const" in text
    assert "int bias(const" not in text


def test_mistakes(tmp_path: Path) -> None:
    model = PlanarRmp(20.0)
    with pytest.raises(UnknownNameError, match="did you mean 'energies'"):
        export_c(model, tmp_path, ["energy"])
    with pytest.raises(InvalidInputError, match="is not a directory"):
        export_c(model, tmp_path / "missing")
    source = export_c(model, tmp_path, ["bias"])
    with pytest.raises(CompilerError, match="cannot run the C compiler 'no-such-compiler'"):
        compile_c(source, "no-such-compiler")
    if shutil.which("cc") is not None:
        source.write_text("not C at all")
        with pytest.raises(CompilerError, match=r"cc failed on planarrmp\.c"):
            compile_c(source)


def test_a_difference_is_seen(tmp_path: Path) -> None:
    if shutil.which("cc") is not None:
        library = compile_c(export_c(PlanarRmp(20.0), tmp_path, ["bias"]))
        # Of another mass: the bias is proportional to it.
        assert largest_difference(PlanarRmp(25.0), library, ["bias"]) == pytest.approx(0.2)


def test_command_line(tmp_path: Path) -> None:
    arguments = ["codegen", "planar", "--mass", "20", "-o", str(tmp_path), "--function", "bias"]
    if shutil.which("cc") is not None:
        arguments += ["--compiler", "cc"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert "int bias(const" in (tmp_path / "planarrmp.c").read_text()
    wrong = CliRunner().invoke(app, ["codegen", "planar", "--mass", "-1", "-o", str(tmp_path)])
    assert wrong.exit_code == 1
    assert "mass: must be greater than 0" in wrong.output
