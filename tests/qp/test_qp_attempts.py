"""Ticks through ProxQP: from the last one, stalled, or without a solution; its own solver."""

import subprocess
import sys
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

import numpy as np
import pytest

from wbc.qp import QP, proxqp_workspace
from wbc.qp.active_set import ActiveSet, proximal
from wbc.qp.core import CoreSolution, solve_in_core
from wbc.qp.kkt import acceptable, kkt_residuals
from wbc.qp.proxqp import COOLDOWN, ProxQP
from wbc.qp.proxqp_workspace import Workspace


@pytest.mark.parametrize("most", [3e-13, 1e-6, 0.3, 0.5, 0.75, 1.0, 1.7, 3.0, 1e5])
def test_costs_below_one_are_scaled_by_a_power_of_two_warm_as_well(most: float, rng) -> None:
    """To a largest curvature in [1, 2); multipliers are those of the QP as it was given."""
    C = rng.normal(size=(2, 4))
    for again in (False, True):
        P = most * np.diag([1.0, 0.5, 0.7, 0.9])
        qp = QP.build(P, most * rng.normal(size=4), C=C, l=np.full(2, 0.5), u=np.ones(2))
        if not again:
            workspace = Workspace.create(qp, 1e-10, 1000)
            found = workspace.solve_cold()
            if most >= 1.0 or most < 1e-12:
                assert workspace.scale == 1.0
            else:
                assert 1.0 <= workspace.scale * most < 2.0 and np.log2(workspace.scale) % 1.0 == 0.0
        else:
            found = workspace.solve_warm(qp)
        if most > 1e-12:
            gradient = P @ found.x + qp.g + C.T @ found.z
            np.testing.assert_allclose(gradient, 0.0, atol=1e-7 * most)


class Reduced:
    """A QP without equalities as a tick has it, judged by its KKT conditions."""

    def __init__(self, qp: QP) -> None:
        self.qp, self.iterations, self.x, self.asked = qp, 0, None, 0

    def accept(self, x: bytes, z: bytes, scale: float, iterations: int) -> bool:
        x, z = np.frombuffer(x), np.frombuffer(z) / scale
        rows, box = np.split(z, [self.qp.u.size])
        point = x, np.zeros(0), rows, box
        if not acceptable(kkt_residuals(self.qp, *point), 1e-8, self.qp, *point):
            return False
        self.x, self.iterations = x, iterations
        return True

    def solve(self) -> bool:
        self.asked += 1
        found = ActiveSet().solve(self.qp, quick=True)
        self.x, self.iterations = found.x, found.iterations
        return found.solved


@pytest.fixture
def reduced(solvable):
    return Reduced(solvable(np.random.default_rng(5), me=0, mi=3))


def test_a_tick_is_solved_from_the_last_one(reduced, monkeypatch) -> None:
    """From nothing the active-set method looks whether there is a solution at all."""
    backend, bounded = ProxQP(), False
    assert backend.solve_reduced(reduced, "a", bounded) == ("proxqp", 2) and reduced.asked == 1
    expected = reduced.x.copy()
    assert backend.solve_reduced(reduced, "a", bounded) == ("proxqp", 1) and reduced.asked == 1
    np.testing.assert_allclose(reduced.x, expected, atol=1e-7)
    assert backend.solve_reduced(reduced, "b", bounded) == ("proxqp", 2)  # another name
    cold = ProxQP(warm=False)
    for _ in range(2):
        assert cold.solve_reduced(reduced, "a", bounded) == ("proxqp_cold", 2)


def test_a_tick_without_a_solution_is_not_asked_of_proxqp(reduced, monkeypatch) -> None:
    monkeypatch.setattr(Workspace, "create", lambda *_, **__: pytest.fail("asked"))
    qp = reduced.qp
    none = Reduced(qp._replace(C=np.repeat(qp.C[:1], 3, axis=0), l=np.array([-1.0, -1.0, 5.0]),
                   u=np.array([0.0, 9.0, 6.0])))  # fmt: skip
    assert ProxQP().solve_reduced(none, "a", True) is None


def test_what_is_far_from_the_last_qp_is_no_warm_start_where_ticks_are_relaxed(reduced) -> None:
    """From there ProxQP was rejected after up to 9 ms; the active-set method answers first."""
    qp, backend = reduced.qp, ProxQP()
    near, far = Reduced(qp._replace(g=1.001 * qp.g)), Reduced(qp._replace(g=-2.0 * qp.g))
    assert backend.solve_reduced(reduced, "a", True) == ("proxqp", 2)
    assert backend.solve_reduced(near, "a", True) == ("proxqp", 1)
    assert backend.solve_reduced(far, "a", True) == ("proxqp", 2) and far.asked == 1
    patient, far = ProxQP(), Reduced(far.qp)
    patient.solve_reduced(reduced, "a", False)
    assert patient.solve_reduced(far, "a", False) in (("proxqp", 1), ("active_set", 2))


def test_ticks_that_stall_are_the_active_set_methods_for_a_while(reduced, monkeypatch) -> None:
    """A hundred of that name; of others none; then ProxQP is asked again."""
    backend = ProxQP(max_iterations=1)
    assert backend.solve_reduced(reduced, "a", False) == ("active_set", 3)
    made: list[int] = []
    honest = Workspace.create
    monkeypatch.setattr(Workspace, "create", lambda *a, **k: made.append(1) or honest(*a, **k))
    for _ in range(COOLDOWN):
        assert backend.solve_reduced(reduced, "a", False) == ("active_set", 1)
    assert not made
    backend.solve_reduced(reduced, "b", False)
    backend.solve_reduced(reduced, "a", False)
    assert len(made) == 2


def test_proximal_step_beyond_all_rows_leaves_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    box = {"lower": np.zeros(2), "upper": np.ones(2)}
    qp = QP.build(np.zeros((2, 2)), np.ones(2), C=[[1.0, 1.0]], l=[1.0], u=[2.0], **box)

    def thrown(qp: QP, eps: float, most: int, give: np.ndarray | None) -> CoreSolution:
        found = solve_in_core(qp, eps, most, give)
        far = found.residuals._replace(primal=1e22)
        return found._replace(x=np.full(2, 1e200), residuals=far)

    assert proximal(qp, 1e-8, 100) is not None
    monkeypatch.setattr("wbc.qp.active_set.solve_in_core", thrown)
    assert proximal(qp, 1e-8, 100) is None


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
