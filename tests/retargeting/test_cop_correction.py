"""The CoM's path whose CoP is inside the soles: against a QP solver on dense rows."""

import numpy as np
import pytest
import qpsolvers

from wbc.retargeting.cop_correction import (
    COP_WEIGHT,
    OUTSIDE_WEIGHT,
    SupportedFrames,
    cop_displacement,
    least_com_displacement,
)
from wbc.validate import Array

DT, COUNT = 0.02, 60
SOLE = np.array([(-0.1, -0.05, 0.0), (0.1, -0.05, 0.0), (0.1, 0.05, 0.0), (-0.1, 0.05, 0.0)])
FIRST, END = 20, 40  # frames in which the other foot stands


def supports() -> tuple[SupportedFrames, ...]:
    frames = np.arange(COUNT)
    other = (frames >= FIRST) & (frames < END)
    aside = SOLE + (0.05, 0.2, 0.0)
    return (
        SupportedFrames(frames[~other], ((0, SOLE),)),
        SupportedFrames(frames[other], ((1, aside),)),
    )


def cop_matrix(time_constant_sq: Array) -> Array:
    """Return the matrix (n, n) of CoPs by CoMs along one axis: e - h/(g + z'') e''."""
    D = np.eye(COUNT)
    for k in range(1, COUNT - 1):
        D[k, k - 1 : k + 2] -= time_constant_sq[k] / DT**2 * np.array((1.0, -2.0, 1.0))
    return D


@pytest.fixture
def cop() -> Array:
    t = DT * np.arange(COUNT)
    step = np.where((t >= DT * FIRST) & (t < DT * END), 0.2, 0.0)
    return np.column_stack((0.15 * np.sin(6.0 * t), step + 0.08 * np.cos(9.0 * t)))


def test_com_displacement_is_as_small_as_a_qp_finds(cop: Array, rng: np.random.Generator) -> None:
    time_constant_sq = 0.07 + 0.01 * rng.uniform(size=COUNT)
    off, found = least_com_displacement(cop, time_constant_sq, DT, supports())
    D, rows, most = cop_matrix(time_constant_sq), [], []
    np.testing.assert_allclose(found, cop + D @ off, atol=1e-12)
    np.testing.assert_allclose(cop_displacement(off, time_constant_sq, DT), D @ off, atol=1e-12)
    for one in supports():
        hull = one.inset_polygon  # an upright rectangle
        low, high = hull.min(axis=0), hull.max(axis=0)
        for k in one.frames[(one.frames > 0) & (one.frames < COUNT - 1)]:
            for axis in range(2):
                row = np.zeros((COUNT, 2))
                row[:, axis] = D[k]
                rows += [row.ravel(), -row.ravel()]
                most += [high[axis] - cop[k, axis], cop[k, axis] - low[axis]]
    both = np.kron(D, np.eye(2))
    P = np.eye(2 * COUNT) + COP_WEIGHT * both.T @ both
    G, h = np.array(rows), np.array(most)
    best = qpsolvers.solve_qp(P, np.zeros(2 * COUNT), G, h, solver="proxqp", eps_abs=1e-9)
    assert best is not None
    # What is outside is weighted, not forbidden: by 1000 times as much as the CoM.
    np.testing.assert_allclose(off, best.reshape(COUNT, 2), atol=1e-3)


def test_cop_inside_the_sole_displaces_nothing() -> None:
    inside, constant = np.zeros((COUNT, 2)), np.full(COUNT, 0.07)
    off, found = least_com_displacement(inside, constant, DT, supports()[:1])
    assert not off.any() and not found.any()


def test_frames_in_flight_leave_the_cop_undefined(cop: Array) -> None:
    flying = cop.copy()
    flying[10:50] = np.nan
    off, found = least_com_displacement(flying, np.full(COUNT, 0.07), DT, supports())
    assert np.isfinite(off).all() and np.isnan(found[10:50]).all()
    assert np.abs(found[51:-1]).max() < 0.1  # where it lands it is inside


@pytest.mark.parametrize("seed", [1, 22, 24])
def test_a_trembling_cop_over_feet_that_roll_is_brought_as_near_as_a_qp_brings_it(
    seed: int,
) -> None:
    """The active set cycled: CoMs were off by up to 116 mm, those of recorded people by 45."""
    rng = np.random.default_rng(seed)
    cop = 0.02 * rng.normal(size=(COUNT, 2)).cumsum(axis=0)
    touching = SOLE, SOLE[1:3] + (0.05, 0.2, 0.0)  # a sole, and the front edge of another
    own = tuple(
        SupportedFrames(np.arange(10 * k, 10 * k + 10), ((k % 2, touching[k % 2]),))
        for k in range(6)
    )
    time_constant_sq = 0.03 + 0.01 * rng.uniform(size=COUNT)
    off, _ = least_com_displacement(cop, time_constant_sq, DT, own)
    both, rows, most = np.kron(cop_matrix(time_constant_sq), np.eye(2)), [], []
    for one in own:
        for k in one.frames[(one.frames > 0) & (one.frames < COUNT - 1)]:
            rows += [normal @ both[2 * k : 2 * k + 2] for normal in one.edges[:, :2]]
            most += [edge[2] - edge[:2] @ cop[k] for edge in one.edges]
    A, b = np.array(rows), np.array(most)  # A e - s <= b with s >= 0, whose squares are weighted
    n, m = 2 * COUNT, len(b)
    P = np.eye(n + m)
    P[:n, :n] += COP_WEIGHT * both.T @ both
    P[n:, n:] *= OUTSIDE_WEIGHT
    lower = np.concatenate((np.full(n, -np.inf), np.zeros(m)))
    G = np.hstack((A, -np.eye(m)))
    best = qpsolvers.solve_qp(
        P, np.zeros(n + m), G, b, lb=lower, solver="proxqp", eps_abs=1e-10, max_iter=20000
    )
    assert best is not None
    np.testing.assert_allclose(off, best[:n].reshape(COUNT, 2), atol=1e-6)
