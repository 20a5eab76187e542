"""The CoM's way whose CoP is inside the soles: against a QP solver on dense rows."""

import numpy as np
import pytest
import qpsolvers

from wbc.retargeting.balanced import SHIFTED, SupportedFrames, least_moved, pressing
from wbc.validate import Array

DT, COUNT = 0.02, 60
SOLE = np.array([(-0.1, -0.05, 0.0), (0.1, -0.05, 0.0), (0.1, 0.05, 0.0), (-0.1, 0.05, 0.0)])
FIRST, END = 20, 40  # frames in which the other foot stands


def stands() -> tuple[SupportedFrames, ...]:
    frames = np.arange(COUNT)
    other = (frames >= FIRST) & (frames < END)
    aside = SOLE + (0.05, 0.2, 0.0)
    return (
        SupportedFrames(frames[~other], ((0, SOLE),)),
        SupportedFrames(frames[other], ((1, aside),)),
    )


def pressed(square: Array) -> Array:
    """Return the matrix (n, n) of CoPs by CoMs along one axis: e - h/(g + z'') e''."""
    D = np.eye(COUNT)
    for k in range(1, COUNT - 1):
        D[k, k - 1 : k + 2] -= square[k] / DT**2 * np.array((1.0, -2.0, 1.0))
    return D


@pytest.fixture
def cop() -> Array:
    t = DT * np.arange(COUNT)
    step = np.where((t >= DT * FIRST) & (t < DT * END), 0.2, 0.0)
    return np.column_stack((0.15 * np.sin(6.0 * t), step + 0.08 * np.cos(9.0 * t)))


def test_the_com_is_moved_as_little_as_a_qp_says(cop: Array, rng: np.random.Generator) -> None:
    square = 0.07 + 0.01 * rng.uniform(size=COUNT)
    off, found = least_moved(cop, square, DT, stands())
    D, rows, most = pressed(square), [], []
    np.testing.assert_allclose(found, cop + D @ off, atol=1e-12)
    np.testing.assert_allclose(pressing(off, square, DT), D @ off, atol=1e-12)
    for one in stands():
        low, high = one.inner.min(axis=0), one.inner.max(axis=0)  # upright rectangles
        for k in one.frames[(one.frames > 0) & (one.frames < COUNT - 1)]:
            for axis in range(2):
                row = np.zeros((COUNT, 2))
                row[:, axis] = D[k]
                rows += [row.ravel(), -row.ravel()]
                most += [high[axis] - cop[k, axis], cop[k, axis] - low[axis]]
    both = np.kron(D, np.eye(2))
    P = np.eye(2 * COUNT) + SHIFTED * both.T @ both
    G, h = np.array(rows), np.array(most)
    best = qpsolvers.solve_qp(P, np.zeros(2 * COUNT), G, h, solver="proxqp", eps_abs=1e-9)
    assert best is not None
    # What is outside is weighted, not forbidden: by 1000 times as much as the CoM.
    np.testing.assert_allclose(off, best.reshape(COUNT, 2), atol=1e-3)


def test_a_cop_that_is_inside_already_moves_nothing() -> None:
    off, found = least_moved(np.zeros((COUNT, 2)), np.full(COUNT, 0.07), DT, stands()[:1])
    assert not off.any() and not found.any()


def test_in_the_air_nothing_is_asked(cop: Array) -> None:
    flying = cop.copy()
    flying[10:50] = np.nan
    off, found = least_moved(flying, np.full(COUNT, 0.07), DT, stands())
    assert np.isfinite(off).all() and np.isnan(found[10:50]).all()
    assert np.abs(found[51:-1]).max() < 0.1  # where it lands it is inside
