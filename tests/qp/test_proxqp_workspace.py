"""ProxQP's own solver: same bits wherever its memory lies, and the settings it is given."""

import subprocess
import sys
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

import numpy as np
import pytest

from wbc.qp import QP, ProxQP, proxqp_workspace
from wbc.qp.proxqp_workspace import Workspace


def test_solutions_do_not_depend_on_where_memory_lies(ticks):
    """The builds for AVX2 and AVX-512 differ in the last bits at every second place."""
    qps, rng = list(ticks(seed=3, count=30, mi=25)), np.random.default_rng(0)
    found, kept = set(), []
    for _ in range(12):
        kept += [np.empty(2 * size + 200) for size in rng.integers(0, 99, size=7)]
        solver = ProxQP()
        solutions = [solver.solve(qp) for qp in qps]
        found.add(b"".join(s.x.tobytes() + s.z_box.tobytes() for s in solutions))
        kept.append(solver)  # the next one gets other memory
    assert len(found) == 1


def build_after(statements: str) -> str:
    """Return what a fresh process says of the build in use after ``statements``."""
    ask = "from wbc.qp.proxqp_workspace import BUILD; import qpsolvers; print(BUILD or 'narrow')"
    command = [sys.executable, "-c", statements + ask]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def test_the_narrow_build_is_loaded_unless_another_is_there_already():
    assert build_after("") == "narrow"
    whichever = build_after("import proxsuite; ")  # by processor; two in one process would abort
    assert whichever in ("avx512", "avx2", "narrow")


def test_a_build_that_others_loaded_stays_as_it_is(monkeypatch) -> None:
    """Nothing is hidden from who imported proxsuite before, and nothing of it is let go."""
    wide = [f"proxsuite.proxsuite_pywrap_{build}" for build in ("avx512", "avx2")]
    for name in wide:
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    before = dict(sys.modules)
    assert proxqp_workspace._import_proxqp() is proxqp_workspace.proxqp
    assert all(sys.modules.get(name) is before[name] for name in wide)


def test_wide_builds_are_hidden_while_proxsuite_is_imported_and_not_longer(monkeypatch) -> None:
    wide = [f"proxsuite.proxsuite_pywrap_{build}" for build in ("avx512", "avx2")]
    for name in ("proxsuite", *wide):
        monkeypatch.setitem(sys.modules, name, None)  # is put back afterwards
        del sys.modules[name]
    hidden: list[bool] = []

    class Finder(MetaPathFinder, Loader):
        def find_spec(self, fullname, path, target=None):
            return ModuleSpec(fullname, self) if fullname == "proxsuite" else None

        def exec_module(self, module):
            hidden.extend(name in sys.modules and sys.modules[name] is None for name in wide)
            module.proxqp = "the narrow one"

    monkeypatch.setattr(sys, "meta_path", [Finder(), *sys.meta_path])
    assert proxqp_workspace._import_proxqp() == "the narrow one"
    assert hidden == [True, True]
    assert not any(name in sys.modules for name in wide)


@pytest.mark.parametrize("part", ["P", "g", "b"])
def test_no_more_accuracy_is_asked_for_than_the_largest_number_has_digits(part: str) -> None:
    """A tenth of what is promised, but no less than some ulps of the largest number."""
    qp = QP.build(np.eye(2), [-1.0, 1.0], A=[[1.0, 1.0]], b=[0.5])
    usual = Workspace.create(qp, 1e-8, 20).native.settings
    assert usual.eps_abs == usual.eps_duality_gap_abs == pytest.approx(1e-9)
    largest = 1e8
    large = qp._replace(**{part: -largest * getattr(qp, part)})
    asked = Workspace.create(large, 1e-8, 20).native.settings
    digits = largest * np.abs(getattr(qp, part)).max() * np.finfo(float).eps
    assert 4.0 * digits < asked.eps_abs < 16.0 * digits
    assert asked.eps_duality_gap_abs == asked.eps_abs


@pytest.mark.parametrize(
    ("by", "far"), [(0.66, True), (0.67, False), (1.0, False), (1.99, False), (2.01, True)]
)
def test_a_start_is_far_if_the_gradient_changed_by_more_than_half_of_it(by, far) -> None:
    """Times c it has changed by c - 1: half of c where c is 2 / 3, and 2."""
    qp = QP.build(np.eye(2), [3.0, 4.0])
    workspace = Workspace.create(qp, 1e-8, 20)
    assert workspace.is_far(qp._replace(g=by * qp.g)) is far
    workspace.run(qp._replace(g=by * qp.g))
    assert not workspace.is_far(qp._replace(g=by * qp.g)) and qp.g.tolist() == [3.0, 4.0]
