"""Every candidate on every sequence, in turns, so that the machine's drift hits all alike."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from time import thread_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from qpbench.sequence import QpSequence
from qpbench.solvers import make_candidate
from wbc.qp import Status
from wbc.qp.kkt import acceptable, kkt_residuals
from wbc.qp.solution import RawSolution
from wbc.validate import Array

REFERENCE = 200  # solutions of the linear system that measures the machine's present speed


@dataclass(frozen=True, eq=False)
class Measured:
    """A candidate on a sequence of k QPs, r times."""

    sequence: str
    solver: str
    eps: float  # accuracy asked for
    seconds: Array  # (r, k) thread CPU time
    iterations: NDArray[np.int64]  # (k,) as the solver counts them, 0 if it does not
    residuals: Array  # (k,) worst KKT residual; infinite where there was no finite answer
    success: NDArray[np.bool_]  # (k,) it reported solved, and the residuals agree, each time
    reference: Array  # (r,) seconds that a fixed computation took just before and after, on average


def measure(
    sequences: Sequence[QpSequence],
    solvers: Sequence[str],
    accuracies: Sequence[float],
    repeats: int,
    progress: Callable[[int, int, str], object] | None = None,
) -> list[Measured]:
    """Solve every sequence by every solver, in order and from the start, ``repeats`` times.

    Parameters
    ----------
    progress:
        Called with passes done, passes in all, and the name of the solver.

    Raises
    ------
    UnknownNameError
        A solver that is not here.
    """
    keys = [(s, name, eps) for s in sequences for eps in accuracies for name in solvers]
    passes: dict[int, list[_Pass]] = {k: [] for k in range(len(keys))}
    done, total = 0, repeats * len(keys)
    for repeat in range(repeats):
        for k in _turned(range(len(keys)), repeat * 3):
            sequence, name, eps = keys[k]
            passes[k].append(_pass(sequence, name, eps))
            done += 1
            if progress is not None:
                progress(done, total, name)
    return [_joined(key, passes[k]) for k, key in enumerate(keys)]


@dataclass(frozen=True, eq=False)
class _Pass:
    seconds: Array
    iterations: NDArray[np.int64]
    residuals: Array
    success: NDArray[np.bool_]
    reference: float


def _turned(order: range, by: int) -> list[int]:
    """Return the order rotated, so that no solver always follows the same other one."""
    by %= len(order)
    return [*order[by:], *order[:by]]


def _pass(sequence: QpSequence, name: str, eps: float) -> _Pass:
    candidate = make_candidate(name, eps)
    before = reference_time()
    times, answers = [], list[RawSolution]()
    with _no_collection():
        for qp in sequence.qps:
            start = thread_time()
            raw = candidate.answer(qp)
            times.append(thread_time() - start)
            answers.append(raw)
    reference = 0.5 * (before + reference_time())
    residuals, success = [], []
    for qp, raw in zip(sequence.qps, answers, strict=True):
        parts = (raw.x, raw.y, raw.z, raw.z_box)
        r = kkt_residuals(qp, *parts)
        worst = max(r.primal, r.dual, r.complementarity)
        finite = all(np.isfinite((r.primal, r.dual, r.complementarity)))
        residuals.append(worst if finite else np.inf)
        good = finite and raw.claim is Status.SOLVED and acceptable(r, eps, qp, *parts)
        success.append(bool(good))
    return _Pass(
        np.array(times),
        np.array([raw.iterations for raw in answers], dtype=np.int64),
        np.array(residuals),
        np.array(success),
        reference,
    )


def _joined(key: tuple[QpSequence, str, float], passes: Sequence[_Pass]) -> Measured:
    sequence, name, eps = key
    return Measured(
        sequence.name,
        name,
        eps,
        np.array([one.seconds for one in passes]),
        passes[0].iterations,
        np.max([one.residuals for one in passes], axis=0),
        np.logical_and.reduce([one.success for one in passes]),
        np.array([one.reference for one in passes]),
    )


def reference_time() -> float:
    """Return the present time of a fixed computation like those of QP solvers [s]."""
    matrix = np.eye(40) + 0.01
    right: Any = np.ones(40)
    start = thread_time()
    for _ in range(REFERENCE):
        right = np.linalg.solve(matrix, right)
        right /= np.abs(right).max()
    return thread_time() - start


@contextmanager
def _no_collection() -> Iterator[None]:
    """Keep Python's garbage collector out of the times."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
