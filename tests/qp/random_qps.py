"""Random QPs whose rows contradict each other by a known gap, or leave a known point."""

from __future__ import annotations

import numpy as np

from wbc.qp import QP

Rng = np.random.Generator


def _room(rng: Rng, size: int, tight: float, scale: float = 1.0) -> np.ndarray:
    """Return how far ends are from a point: a share ``tight`` not at all, three tenths endless."""
    room = scale * rng.exponential(size=size)
    room[rng.random(size) < tight] = 0.0
    room[rng.random(size) < 0.3] = np.inf
    return room


def _cost(rng: Rng, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return P and g: well curved, weakly curved, or not at all in half of the directions."""
    kind = rng.integers(3)
    J = rng.normal(size=(max(1, n // 2) if kind == 2 else n, n))
    P = J.T @ J + (1e-3 if kind == 1 else 0.0) * np.eye(n)
    return P, 10.0 * J.T @ rng.normal(size=len(J))


def _rows(rng: Rng, n: int, m: int) -> np.ndarray:
    """Return rows of lengths over four decades, in half of the cases with many zeros."""
    rows = rng.normal(size=(m, n)) * 10.0 ** rng.uniform(-2, 2, size=(m, 1))
    if rng.random() < 0.5:
        rows[rng.random(rows.shape) < 0.5] = 0.0
    return rows


def contradicting(rng: Rng, gap: float) -> QP:
    """Rows and bounds about a point, some equalities dependent, and one row that they forbid.

    ``gap``: by how much, in a row of unit length. Those that forbid it are a random combination.
    """
    while True:
        n, me, mi = (int(rng.integers(low, high)) for low, high in ((2, 25), (0, 8), (0, 15)))
        me = min(me, n // 2)
        x, A, C = rng.normal(size=n), _rows(rng, n, me), _rows(rng, n, mi)
        b, l, u = A @ x, C @ x - _room(rng, mi, 0.3), C @ x + _room(rng, mi, 0.3)  # noqa: E741
        if me > 2 and rng.random() < 0.4:
            mixture = rng.normal(size=me - 1) * (rng.random(me - 1) < 0.6)
            A[-1], b[-1] = mixture @ A[:-1], mixture @ b[:-1]
        lower, upper = x - _room(rng, n, 0.3), x + _room(rng, n, 0.3)
        rows = np.concatenate((A, C, np.eye(n)))
        low, high = np.concatenate((b, l, lower)), np.concatenate((b, u, upper))
        part = np.where(
            rng.random(len(rows)) < rng.uniform(0.05, 0.5), rng.normal(size=len(rows)), 0.0
        )
        part[~np.isfinite(np.where(part > 0.0, high, low))] = 0.0
        row, used = part @ rows, part != 0.0
        if np.linalg.norm(row) < 1e-6:
            continue
        most = part[used] @ np.where(part > 0.0, high, low)[used] + gap * np.linalg.norm(row)
        kind = rng.integers(3)
        if kind == 0:
            A, b = np.vstack((A, row)), np.append(b, most)
        else:
            sign = 1.0 if kind == 1 else -1.0
            C = np.vstack((C, sign * row))
            l = np.append(l, most if kind == 1 else -np.inf)  # noqa: E741
            u = np.append(u, np.inf if kind == 1 else -most)
        P, g = _cost(rng, n)
        return QP.build(P, g, A=A, b=b, C=C, l=l, u=u, lower=lower, upper=upper)


def overdetermined(rng: Rng) -> tuple[QP, tuple[np.ndarray, ...]]:
    """Rows and bounds of which several parts contradict themselves, and multipliers of them all."""
    n = int(rng.integers(2, 7))
    me, mi = int(rng.integers(0, 3)), n + int(rng.integers(2, 6))
    rows, signs = rng.normal(size=(me + mi + n, n)), rng.choice([-1.0, 1.0], me + mi + n)
    rows[me + mi :] = np.eye(n)
    weights = rng.uniform(0.5, 2.0, me + mi + n) * signs
    weights[me + mi :] *= rng.random(n) < 0.4
    rows[me] = -(np.delete(weights, me) @ np.delete(rows, me, axis=0)) / weights[me]
    room = rng.normal(size=weights.size)
    room -= weights * (weights @ room + 1.0) / (weights @ weights)  # weights @ ends is now -1
    ends = rows @ rng.normal(size=n) + room
    low, up = np.where(weights < 0.0, ends, -np.inf), np.where(weights > 0.0, ends, np.inf)
    parts = slice(me), slice(me, me + mi), slice(me + mi, None)
    eq, ineq, box = parts
    qp = QP.build(np.eye(n), np.zeros(n), A=rows[eq], b=ends[eq], C=rows[ineq], l=low[ineq],
                  u=up[ineq], lower=low[box], upper=up[box])  # fmt: skip
    return qp, tuple(weights[part] for part in parts)


def without_unknowns_left(rng: Rng, gap: float) -> QP:
    """Equalities that leave one point, which a bound forbids."""
    n = int(rng.integers(1, 10))
    A, x, k = rng.normal(size=(n, n)), rng.normal(size=n), int(rng.integers(n))
    lower = np.full(n, -np.inf)
    lower[k] = x[k] + gap
    return QP.build(np.eye(n), rng.normal(size=n), A=A, b=A @ x, lower=lower)


def equalities_alone(rng: Rng, gap: float) -> QP:
    """Equalities, in any order, of which some combination contradicts another."""
    n = int(rng.integers(2, 20))
    k = int(rng.integers(1, n))
    A, x = _rows(rng, n, k), rng.normal(size=n)
    lengths = np.maximum(np.linalg.norm(A, axis=1), 1e-9)
    row = (rng.normal(size=k) * (rng.random(k) < 0.6) / lengths) @ A
    order = rng.permutation(k + 1)
    A, b = np.vstack((A, row)), np.append(A @ x, row @ x + gap * max(np.linalg.norm(row), 1.0))
    return QP.build(np.eye(n), rng.normal(size=n), A=A[order], b=b[order])


def feasible(rng: Rng) -> QP:
    """A known point meets all: rows twice and combined, corners of many rows, hardly any room."""
    n, me, mi = (int(rng.integers(low, high)) for low, high in ((2, 25), (0, 8), (0, 25)))
    me = min(me, n // 2)
    x, A, C = rng.normal(size=n), _rows(rng, n, me), _rows(rng, n, mi)
    if mi > 2 and rng.random() < 0.5:
        C[-1], C[-2] = C[0], -C[1]
    if mi > 4 and me and rng.random() < 0.5:
        C[2] = rng.normal(size=me) @ A
    if mi > 5 and rng.random() < 0.5:
        C[3] = 0.3 * C[4] + 0.7 * C[5]
    if me > 2 and rng.random() < 0.4:
        A[-1] = rng.normal(size=me - 1) @ A[:-1]
    tight, scale = rng.choice([0.1, 0.5, 1.0]), rng.choice([1.0, 1e-6, 1e-9])
    bounded = rng.random(n) < 0.5
    below, above = (_room(rng, n, tight, scale) for _ in range(2))
    P, g = _cost(rng, n)
    return QP.build(
        P, g, A=A, b=A @ x, C=C,
        l=C @ x - _room(rng, mi, tight, scale), u=C @ x + _room(rng, mi, tight, scale),
        lower=np.where(bounded, x - below, -np.inf), upper=np.where(bounded, x + above, np.inf),
    )  # fmt: skip
