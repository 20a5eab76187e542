"""What is measured: every candidate finds the optimum, and one that only says so is caught."""

import numpy as np
import pytest
import qpsolvers
from qpbench.export import problem_of
from qpbench.measure import Measured, measure
from qpbench.sequence import QpSequence
from qpbench.solvers import CANDIDATES, candidate_names, make_candidate
from qpbench.suite import STANDARD, Job, record
from qpbench.summary import LIMIT, RATIOS, performance_profile, shifted_geometric_mean, summarise
from scipy.sparse import csc_matrix

from tests.benchmarks.qpbench.test_sequence import random_qp
from wbc.errors import UnknownNameError
from wbc.qp import QP
from wbc.qp.active_set import ActiveSet
from wbc.qp.solution import RawSolution


def solvable() -> QpSequence:
    """Return QPs that drift, with two sizes; each has a point, so a solution."""
    rng = np.random.default_rng(3)
    qps = []
    for size in ((6, 2, 3), (4, 1, 0)):
        first = random_qp(rng, *size)
        inside = np.clip(rng.standard_normal(size[0]), -0.2, 0.2) * 0.5
        for k in range(4):
            g = first.g * (1 + 0.05 * k)
            qps.append(
                QP.build(
                    first.P + np.eye(size[0]),
                    g,
                    A=first.A,
                    b=first.A @ inside,
                    C=first.C,
                    l=first.C @ inside - 0.1,
                    u=first.C @ inside + 0.1,
                    lower=inside - 0.3,
                    upper=inside + 0.3,
                )
            )
    return QpSequence("drifting", {}, tuple(qps))


@pytest.fixture(scope="module")
def optima() -> list[np.ndarray]:
    """Return the optima by an interior point on the problems as they are exported."""
    found = []
    for qp in solvable().qps:
        parts = {key: one and np.array(one) for key, one in problem_of(qp).items()}
        for key in ("P", "G", "A"):
            if parts[key] is not None:
                parts[key] = csc_matrix(parts[key].reshape(-1, qp.g.size))
        found.append(qpsolvers.solve_problem(qpsolvers.Problem(**parts), "clarabel").x)
    return found


@pytest.mark.parametrize("name", candidate_names())
def test_every_candidate_finds_the_optimum(name: str, optima: list[np.ndarray]) -> None:
    """It is unique: P >= 1, so that a gap of 1e-8 is a distance of 1.4e-4 at most."""
    candidate = make_candidate(name, 1e-8)
    for qp, wanted in zip(solvable().qps, optima, strict=True):
        assert np.allclose(candidate.answer(qp).x, wanted, atol=2e-4)


def test_figures_of_all_candidates() -> None:
    found = measure([solvable()], list(CANDIDATES), [1e-3, 1e-6], repeats=2)
    assert len(found) == 2 * len(CANDIDATES)
    for one in found:
        assert one.success.all() and one.seconds.shape == (2, 8) and (one.seconds >= 0).all()
        assert one.residuals.max() < 1e-2 and (one.reference > 0).all()
    with pytest.raises(UnknownNameError, match="did you mean 'active_set'"):
        measure([solvable()], ["activeset"], [1e-6], repeats=1)


def test_a_solver_that_only_says_solved_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    answer = ActiveSet.answer

    def lying(self: ActiveSet, qp: QP) -> RawSolution:
        raw = answer(self, qp)
        return raw._replace(x=raw.x + (1e-3 if qp.b.size == 1 else 0.0))

    monkeypatch.setattr(ActiveSet, "answer", lying)
    (found,) = measure([solvable()], ["active_set"], [1e-6], repeats=1)
    assert found.success.tolist() == [True] * 4 + [False] * 4
    assert (found.residuals[4:] > 1e-4).all() and (found.residuals[:4] < 1e-6).all()


def test_shifted_geometric_mean() -> None:
    """Of equal times it is the time; of 10 and 40 us with a shift of 10 us, sqrt(20 50) - 10."""
    assert shifted_geometric_mean(np.full(5, 3e-4)) == pytest.approx(3e-4)
    mean = shifted_geometric_mean(np.array([10e-6, 40e-6]))
    assert mean == pytest.approx((np.sqrt(20 * 50) - 10) * 1e-6)


def test_performance_profile() -> None:
    times = {"a": np.array([1.0, 1.0, np.inf, np.inf]), "b": np.array([2.0, 0.5, 1.0, np.inf])}
    profile = performance_profile(times)
    two = int(np.searchsorted(RATIOS, 2.0 * (1 + 1e-9)))
    assert profile["a"][0] == 0.25 and profile["b"][0] == 0.5  # each where it is the fastest
    assert profile["a"][two] == 0.5 and profile["b"][two] == 0.75
    assert profile["b"][-1] == 0.75  # what nobody solves counts against all


def test_a_failure_counts_as_the_limit() -> None:
    sequence = solvable()
    times = np.full((3, 8), 1e-4)
    times[1] = 5e-5  # the best pass counts
    one = Measured(
        "drifting", "daqp", 1e-6, times, np.full(8, 2), np.full(8, 1e-9),
        np.array([True] * 7 + [False]), np.full(3, 1e-3),
    )  # fmt: skip
    figures = summarise([sequence], [one], "wbc bench")["accuracies"]["1e-06"]["solvers"]["daqp"]
    of_all = figures["all"]
    assert of_all["success"] == 7 / 8 and of_all["median"] == pytest.approx(5e-5)
    logs = [np.log(6e-5)] * 7 + [np.log(LIMIT + 1e-5)]
    assert of_all["shifted_geometric_mean"] == pytest.approx(np.exp(np.mean(logs)) - 1e-5)
    assert figures["sequences"]["drifting"]["passes"] == pytest.approx([1e-4, 5e-5, 1e-4])


def test_standard_jobs_scale_in_size_and_hardness() -> None:
    assert len({job.name for job in STANDARD}) == len(STANDARD)
    arm, long = (record(Job(name, "velocity", False), 3) for name in ("arm", "long"))
    assert (arm.about["joints"], long.about["joints"]) == (6, 62)
    torque = record(Job("hoap2_like", "torque", False), 3)
    assert torque.qps[0].u.size > 0 and torque.qps[0].g.size > 31

    def active(hard: bool) -> float:
        """Return the share of bounds that hold the optimum back."""
        qps = record(Job("hoap2_like", "velocity", hard), 20).qps
        return float(np.mean([np.abs(ActiveSet().answer(qp).z_box) > 1e-6 for qp in qps]))

    assert active(hard=True) > active(hard=False) + 0.05
    again = record(Job("arm", "velocity", False), 3)
    assert all((a.P == b.P).all() for a, b in zip(arm.qps, again.qps, strict=True))
