"""Exported C: complete, and where a compiler exists, with the results of CasADi's machine."""

import shutil
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.rmp.codegen import CompilerError, compile_c, export_c
from wbc.rmp.pendulum import ReactionMassPendulum
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import EulerSolidRmp, SolidRmp


def sample(function: ca.Function, rng: np.random.Generator) -> list[np.ndarray]:
    """Arguments for which nothing is singular: all entries between 0.3 and 1.2."""
    return [rng.uniform(0.3, 1.2, function.size1_in(k)) for k in range(function.n_in())]


def worst(model: ReactionMassPendulum, library: Path) -> float:
    """Largest difference of any result, relative to that Function's largest."""
    rng, found = np.random.default_rng(1), 0.0
    for name, function in model.functions.items():
        compiled = ca.external(name, str(library))
        for _ in range(5):
            arguments = sample(function, rng)
            for mine, theirs in zip(
                function.call(arguments), compiled.call(arguments), strict=True
            ):
                expected = mine.full()
                gap = np.abs(expected - theirs.full()).max()
                found = max(found, float(gap / np.abs(expected).max()))
    return found


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
        assert worst(model, compile_c(source)) < 1e-12


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
