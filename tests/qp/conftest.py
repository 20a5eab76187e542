"""QPs that several test files need. Nothing here calls the code under test, except its QP type."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from wbc.qp import QP, Labels

Factory = Callable[..., QP]


def recorded(name: str) -> QP:
    """Return a QP of a run, kept because solvers stall or err on it: file, and its number there."""
    file, *number = name.split()
    fields = ("P", "g", "A", "b", "C", "l", "u", "lower", "upper")
    with np.load(Path(__file__).parent / f"{file}.npz") as kept:
        found = {field: kept[key] for field in fields if (key := field + "".join(number)) in kept}
    P = found.pop("P")
    return QP.build((P + P.T) / 2.0, **found)  # one was recorded with rounding


def _solvable(
    rng: np.random.Generator, n: int = 8, me: int = 2, mi: int = 4, tight: float = 0.3
) -> QP:
    """Return a strictly convex QP that a known point meets, a share ``tight`` of it exactly."""
    J = rng.normal(size=(2 * n, n)) * 10.0 ** rng.uniform(-1.0, 1.0, size=(2 * n, 1))
    point = rng.normal(size=n)
    A, C = rng.normal(size=(me, n)), rng.normal(size=(mi, n))

    def room(size: int) -> np.ndarray:
        return np.where(rng.uniform(size=size) < tight, 0.0, rng.exponential(size=size))

    lower, upper = point - room(n), point + room(n) + 0.1
    unbounded = rng.uniform(size=n) < 0.3
    lower[unbounded], upper[unbounded] = -np.inf, np.inf
    l, u = C @ point - room(mi) - 0.1, C @ point + room(mi)  # noqa: E741
    l[rng.uniform(size=mi) < 0.5] = -np.inf
    return QP(
        P=J.T @ J + 1e-3 * np.eye(n),
        g=J.T @ rng.normal(size=2 * n),
        A=A,
        b=A @ point,
        C=C,
        l=l,
        u=u,
        lower=lower,
        upper=upper,
        labels=Labels.numbered(n, me, mi),
    )


def _ticks(seed: int, count: int, mi: int = 0, speed: float = 1.0) -> Iterator[QP]:
    """Yield a smooth sequence of controller-like QPs: n = 35, 12 equalities, box on 29 unknowns."""
    rng = np.random.default_rng(seed)
    n, me, rows = 35, 12, 30
    sizes = {"J": (rows, n), "r": (rows,), "A": (me, n), "C": (mi, n), "u": (mi,)}
    parts = {key: rng.normal(size=(3, *size)) for key, size in sizes.items()}
    weight = 10.0 ** rng.uniform(-1.5, 0.5, size=(rows, 1))
    limit = np.concatenate((np.full(6, np.inf), rng.uniform(0.05, 0.8, size=29)))
    labels = Labels.numbered(n, me, mi)
    for tick in range(count):
        t = 0.005 * speed * tick
        now = {k: v[0] + 0.3 * (v[1] * np.sin(t) + v[2] * np.cos(2 * t)) for k, v in parts.items()}
        J = weight * now["J"]
        yield QP(
            P=J.T @ J + 1e-4 * np.eye(n),
            g=-J.T @ (weight[:, 0] * now["r"]),
            A=now["A"],
            b=np.zeros(me),
            C=now["C"],
            l=np.full(mi, -np.inf),
            u=0.05 + np.abs(now["u"]),
            lower=-limit,
            upper=limit,
            labels=labels,
        )


@pytest.fixture(scope="session")
def solvable() -> Factory:
    return _solvable


@pytest.fixture(scope="session")
def ticks() -> Callable[..., Iterator[QP]]:
    return _ticks
