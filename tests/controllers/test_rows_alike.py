"""What must not change an answer: rows that repeat each other, say nothing, or are scaled.

And the linear algebra of ticks against NumPy's eigenvalues and pseudo-inverses.
"""

import numpy as np
import pytest

from wbc.constraints.rows import Bounds, relax_for_contacts
from wbc.controllers import KinematicController
from wbc.controllers.singular import reduce_singular
from wbc.laws import Rows
from wbc.tasks import InertiaTask

N = 9


def task(rng: np.random.Generator, k: int, threshold: float, weight: float = 1.0) -> Rows:
    matrix = rng.normal(size=(k, N))
    matrix[-1] = matrix[0] + 1e-2 * rng.normal(size=N)  # nearly repeats the first
    return Rows(matrix, rng.normal(size=k), weight * rng.uniform(0.5, 2.0, k),
                singular_threshold=threshold)  # fmt: skip


def exact(matrix: np.ndarray, target: np.ndarray) -> Rows:
    return Rows(matrix, target, np.ones(len(target)))


def asked(rows: list[Rows], held: list[Rows], root: np.ndarray) -> np.ndarray:
    """Return what is asked for in the end, and what was found of each task's singular values."""
    out, found = reduce_singular(rows, held, root)
    told = [[one.rank, one.least] for _, one in sorted(found.items())]
    return np.concatenate([*(row.target for row in out), np.ravel(told)])


@pytest.mark.parametrize("weighed", [False, True])
def test_held_rows_may_repeat_each_other_say_nothing_and_have_any_scale(rng, weighed: bool) -> None:
    root = np.sqrt(rng.uniform(0.5, 4.0, N)) if weighed else np.ones(N)
    A, b = rng.normal(size=(3, N)), rng.normal(size=3)
    rows = [task(rng, 3, 0.3), task(rng, 2, 0.1), task(rng, 2, 0.0)]
    expected = asked(rows, [exact(A, b)], root)
    assert np.abs(expected[:3] - rows[0].target).max() > 1e-3, "something is singular"
    np.testing.assert_array_equal(expected[5:7], rows[2].target)
    nothing = exact(np.zeros((2, N)), np.zeros(2))
    for held in (
        [exact(A[:1], b[:1]), exact(A[1:], b[1:])],
        [exact(A, b), exact(A[::-1], b[::-1])],
        [exact(1e4 * A, 1e4 * b)],
        [exact(A * [[1.0], [1e3], [1e-2]], b * [1.0, 1e3, 1e-2])],
        [nothing, exact(A, b)],
        [exact(A, b), nothing],
        [exact(np.vstack((A, A[0] - 2.0 * A[1])), np.r_[b, b[0] - 2.0 * b[1]])],
    ):
        np.testing.assert_allclose(asked(rows, held, root), expected, rtol=1e-6, atol=1e-7)
    free = asked(rows, [], root)
    np.testing.assert_allclose(asked(rows, [nothing], root), free, atol=1e-12)
    assert np.abs(free - expected).max() > 1e-3


def test_weights_count_beside_each_other_only(rng) -> None:
    """A thousandth of all weights changes nothing; rows of weight 0 are as if they were not."""
    root, held = np.ones(N), [exact(rng.normal(size=(2, N)), rng.normal(size=2))]
    rows = [task(rng, 3, 0.3), task(rng, 4, 0.2)]
    expected = asked(rows, held, root)
    for factor in (1e-3, 1e3):
        scaled = [row._replace(weight=factor * row.weight) for row in rows]
        np.testing.assert_allclose(asked(scaled, held, root), expected, rtol=1e-6, atol=1e-8)
    idle = rows[1]._replace(weight=rows[1].weight * [1.0, 0.0, 1.0, 1.0])
    without = rows[1]._replace(matrix=rows[1].matrix[[0, 2, 3]], target=rows[1].target[[0, 2, 3]],
                               weight=rows[1].weight[[0, 2, 3]])  # fmt: skip
    found, other = asked([rows[0], idle], held, root), asked([rows[0], without], held, root)
    np.testing.assert_allclose(np.delete(found, 4), other, atol=1e-10)
    assert found[4] == rows[1].target[1]
    off = rows[1]._replace(weight=np.zeros(4))
    np.testing.assert_allclose(asked([rows[0], off], held, root),
                               np.insert(asked([rows[0]], held, root), 3, off.target))  # fmt: skip


def test_curvature_is_made_positive_at_its_own_scale(hoap2) -> None:
    """Eigenvalues become their sizes, at least 1e-5 of the largest; vectors stay.

    Oracle: NumPy's eigenvalues of the cost, its curvature the residual's in Python.
    """
    here = hoap2.snapshot(hoap2.posture("standing"))
    damping = 1e-3
    for factor, indefinite in ((0.5, True), (1.0 + 1e-6, False), (4.0, True)):
        task = InertiaTask(hoap2, factor * here.inertia, weight=10.0, second_order=True)
        residual = task.residual(here)
        J = task.weight[:, None] * residual.jacobian
        H = J.T @ J + residual.curvature
        values, vectors = np.linalg.eigh(H)
        assert bool(values.min() < -1e-3 * values.max()) is indefinite
        sizes = np.maximum(np.abs(values), 1e-5 * np.abs(values).max())
        expected = (vectors * sizes) @ vectors.T + damping * np.eye(hoap2.nv)
        tick = KinematicController(hoap2, [task], contacts=(), damping=damping).step(here)
        np.testing.assert_allclose(tick.qp.P, expected, atol=1e-9 * np.abs(values).max())


def test_margins_give_way_to_contacts_and_never_ask_for_more(rng) -> None:
    """Lower ends become min(lower, what the least velocity of the contacts leaves); by pinv.

    But for rows that forbid rest, as users' own may.
    """
    A, b = rng.normal(size=(4, N)), 1e-3 * rng.normal(size=4)
    C = rng.normal(size=(6, N))
    bounds = Bounds(tuple("abcdef"), C, np.array([-5.0, -1e-5, 0, 0, 1e-6, -2e-4]), np.full(6, 7.0))
    found = relax_for_contacts(bounds, exact(A, b))
    needed = C @ np.linalg.pinv(A) @ b - 0.1 * np.abs(b).max() - 1e-4
    expected = np.where(bounds.lower > 0.0, bounds.lower, np.minimum(bounds.lower, needed))
    np.testing.assert_allclose(found.lower, expected, atol=1e-9)
    np.testing.assert_array_equal(found.upper, bounds.upper)
    at_rest = relax_for_contacts(bounds, exact(A, 0.0 * b))
    expected = np.where(bounds.lower > 0.0, bounds.lower, np.minimum(bounds.lower, -1e-4))
    np.testing.assert_allclose(at_rest.lower, expected, atol=1e-12)
