"""Settling the active set: exact from a rough start, harmless when it cannot."""

import numpy as np
import pytest

from wbc.qp.backend import make_backend
from wbc.qp.kkt import kkt_residuals
from wbc.qp.polish import polish
from wbc.qp.problem import QP
from wbc.qp.solution import RawSolution, Status


def random_qp(rng: np.random.Generator, damping: float) -> QP:
    """Robot-like: few stiff rows, weak damping, a box that is active here and there."""
    n = 20
    J = rng.normal(size=(8, n)) * np.exp(rng.normal(size=(8, 1)))
    feasible = rng.uniform(-0.5, 0.5, n)
    A, C = rng.normal(size=(4, n)), rng.normal(size=(3, n))
    return QP.build(
        J.T @ J + damping * np.eye(n),
        rng.normal(size=n),
        A=A,
        b=A @ feasible,
        C=C,
        l=C @ feasible - 0.1,
        u=C @ feasible + 0.1,
        lower=np.full(n, -1.0),
        upper=np.full(n, 1.0),
    )


@pytest.mark.parametrize("damping", [1e-4, 1e-2, 1.0])
def test_a_rough_answer_becomes_exact(damping: float, rng: np.random.Generator) -> None:
    """The rough answer is a solver's with noise of 1e-4; the oracle is that solver's own answer."""
    for _ in range(20):
        qp = random_qp(rng, damping)
        exact = make_backend("active_set", eps=1e-10).solve(qp)
        assert exact.solved
        noise = [1e-4 * rng.normal(size=size) for size in (20, 4, 3, 20)]
        parts = (exact.x, exact.y, exact.z, exact.z_box)
        x, y, z, z_box = (part + error for part, error in zip(parts, noise, strict=True))
        rough = RawSolution(x, y, z, z_box, claim=Status.SOLVED, iterations=1, message="")
        polished = polish(qp, rough)
        r = kkt_residuals(qp, polished.x, polished.y, polished.z, polished.z_box)
        # One dense solve of entries up to 1e2 over curvatures down to the damping.
        assert max(r.primal, r.dual, r.complementarity) < 1e-9
        np.testing.assert_allclose(polished.x, exact.x, atol=1e-7)


def test_what_is_not_finite_is_left_alone(rng: np.random.Generator) -> None:
    qp = random_qp(rng, 1.0)
    broken = RawSolution(
        np.full(20, np.nan), np.zeros(4), np.zeros(3), np.zeros(20), Status.FAILED, 0, ""
    )
    assert polish(qp, broken) is broken


def test_an_infeasible_qp_is_not_made_to_look_solved(rng: np.random.Generator) -> None:
    qp = random_qp(rng, 1.0)
    far = qp._replace(b=qp.b + 1e3)
    rough = RawSolution(np.zeros(20), np.zeros(4), np.zeros(3), np.zeros(20), Status.SOLVED, 1, "")
    polished = polish(far, rough)
    r = kkt_residuals(far, polished.x, polished.y, polished.z, polished.z_box)
    assert r.primal > 1.0


def test_bounds_that_nearly_contradict_each_other() -> None:
    """Two ankles tied by two feet, both pushed to their limits, which differ by 1e-7 of drift.

    Least squares would exceed one limit and not reach the other; the closed form: the tighter one
    is met, the other is not active.
    """
    qp = QP.build(
        np.eye(2),
        [-1.0, -1.0],
        A=[[1.0, -1.0]],
        b=[2e-7],
        lower=[-1.0, -1.0],
        upper=[0.25, 0.25],
    )
    rough = RawSolution(
        np.array([0.25 + 1e-7, 0.25 - 1e-7]),
        np.zeros(1),
        np.zeros(0),
        np.array([0.75, 0.75]),
        Status.ITERATION_LIMIT,
    )
    polished = polish(qp, rough)
    np.testing.assert_allclose(polished.x, [0.25, 0.25 - 2e-7], atol=1e-12)
    np.testing.assert_allclose(polished.z_box, [1.5, 0.0], atol=1e-6)
