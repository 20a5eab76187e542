"""Exported C: complete, and where a compiler exists, with the results of CasADi's machine."""

import copy
import pickle
import shutil
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from tests.command import wbc_command
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.rmp.balance.law import LawBounds
from wbc.rmp.balance.momentum_qp import MomentumQp
from wbc.rmp.functions import export_c
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import EulerSolidRmp, SolidRmp


@pytest.mark.parametrize("kind", (PlanarRmp, SolidRmp, EulerSolidRmp))
def test_a_copied_or_pickled_pendulum_is_the_same(kind: type[PlanarRmp]) -> None:
    model = kind(20.0, 1.62)
    q = np.linspace(0.3, 1.2, len(model.Q))
    for other in (copy.deepcopy(model), pickle.loads(pickle.dumps(model))):
        assert repr(other) == repr(model)
        found, expected = (one.functions["mass_matrix"](q).full() for one in (other, model))
        np.testing.assert_array_equal(found, expected)


def test_a_copied_or_pickled_law_commands_the_same() -> None:
    """Laws of processes: a flat foot's ended in a TypeError of a SwigPyObject."""
    model = SolidRmp(35.0)
    q, v = np.array((0.0, 0.0, 1.55, 0.01, 0.7, 0.0, 0.0, 0.0, 1.0, 0.2, 0.2, 0.2)), np.zeros(11)
    sole = ((-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1))
    bounds = LawBounds(polygon=sole, wheel_torque=50.0, wheel_angle=0.6)
    law = MomentumQp(model, bounds, (0.0, 0.0, 0.7), (0.2, 0.2, 0.2), 2e-3)
    expected = law.command(q, v, 0.0).force
    for other in (copy.deepcopy(law), pickle.loads(pickle.dumps(law))):
        np.testing.assert_array_equal(other.command(q, v, 0.0).force, expected)


@pytest.mark.slow
@pytest.mark.parametrize("kind", (PlanarRmp, SolidRmp, EulerSolidRmp))
def test_compiled_functions_agree(kind: type[PlanarRmp], tmp_path: Path) -> None:
    """Without contraction to fused operations, they are those of CasADi's own machine."""
    model = kind(20.0)
    source = export_c(model, tmp_path)
    text = source.read_text()
    assert all(f"int {name}(const casadi_real** arg" in text for name in model.functions)
    assert source.with_suffix(".h").exists()
    if (compiler := shutil.which("cc")) is None:
        pytest.skip("no C compiler")
    library = source.with_suffix(".so")
    flags = ["-O2", "-ffp-contract=off", "-fPIC", "-shared"]
    subprocess.run([compiler, *flags, source, "-o", library, "-lm"], check=True)
    rng = np.random.default_rng(0)
    for name, function in model.functions.items():
        # Between these no pendulum is singular.
        given = [rng.uniform(0.3, 1.2, function.size1_in(k)) for k in range(function.n_in())]
        compiled = ca.external(name, str(library)).call(given)
        for mine, theirs in zip(function.call(given), compiled, strict=True):
            expected = mine.full()
            np.testing.assert_allclose(theirs.full(), expected, atol=1e-12 * abs(expected).max())


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


def test_command_line(tmp_path: Path) -> None:
    folder = tmp_path / "made for it"
    arguments = ["codegen", "planar", "--mass", "20", "-o", str(folder), "--function", "bias"]
    done = wbc_command(*arguments)
    assert done.exit_code == 0, done.output
    assert "int bias(const" in (folder / "planarrmp.c").read_text()
    wrong = wbc_command("codegen", "planar", "--mass", "-1", "-o", tmp_path)
    assert wrong.exit_code == 1
    assert "mass: must be greater than 0" in wrong.output
