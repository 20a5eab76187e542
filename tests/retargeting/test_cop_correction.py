"""The CoM's path whose CoP is inside the soles, by a QP solver; a whole motion's least squares."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import qpsolvers

import wbc
from tests.retargeting.humans import crouching, stepping, trajectory_problem
from wbc.retargeting import pipeline, retries
from wbc.retargeting.constraint_projection import Projection
from wbc.retargeting.cop_correction import (
    COP_WEIGHT,
    OUTSIDE_WEIGHT,
    SupportedFrames,
    cop_displacement,
    least_com_displacement,
)
from wbc.retargeting.normal_equations import SPAN, NormalEquations
from wbc.robot import Robot
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
    guess = found + 0.1 * rng.normal(size=found.shape)
    again = least_com_displacement(cop, time_constant_sq, DT, supports(), guess)
    np.testing.assert_allclose(again, (off, found), atol=1e-12)  # wherever it begins
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
def test_a_trembling_cop_over_feet_that_roll_is_brought_as_near_as_a_qp_brings_it(seed) -> None:
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


def test_momentum_gradient_is_that_of_its_squares(step, rng) -> None:
    """By configurations and velocities of all frames, with a base that rotates at 1 rad/s.

    Central differences at 1e-6; of a base's displacement terms of order (v dt)^2/12 are left out.
    """
    problem = trajectory_problem(step, collision=False)
    turned = np.zeros((len(step.q), step.robot.nv))
    turned[:, 3:6] = np.sin(np.arange(len(step.q)) * step.targets.dt)[:, None]
    q = problem.apply_step(step.q, 0.3 * turned)
    normal = NormalEquations(*turned.shape)
    problem.add_momentum(problem.states(q), normal)

    def cost(d: Array) -> float:
        return problem.add_momentum(
            problem.states(problem.apply_step(q, d)), NormalEquations(*d.shape)
        )

    for _ in range(3):
        d = 1e-6 * rng.standard_normal(turned.shape)
        change = 0.5 * (cost(d) - cost(-d))
        assert 2.0 * float((normal.gradient * d).sum()) == pytest.approx(change, rel=1e-3)


def test_a_band_is_the_dense_least_squares(rng: np.random.Generator) -> None:
    count, nv, rows = 7, 4, 3
    normal, dense, errors = NormalEquations(count, nv), [], []

    def row(frames: dict[int, np.ndarray], off: float) -> None:
        one = np.zeros((count, nv))
        for k, part in frames.items():
            one[k] += part
        dense.append(one.ravel())
        errors.append(off)

    A, e = rng.normal(size=(count, rows, nv)), rng.normal(size=(count, rows))
    normal.add(A, errors=e)
    B, f = rng.normal(size=(count - 1, rows, nv)), rng.normal(size=(count - 1, rows))
    normal.add(-B, B, errors=f)
    after = rng.normal(size=(count - 1, rows, nv))
    normal.add(-B, after, errors=2.0 * f)
    g = rng.normal(size=(count - 2, rows))
    normal.add(B[:-1], -B[:-1] - B[1:], B[1:], errors=g)
    coefficients = (-1.0, 3.0, -3.0, 1.0)
    square, gradient = rng.uniform(1, 2, nv - 1), rng.normal(size=nv - 1)
    normal.add_differences(coefficients, square, np.tile(gradient, (count - SPAN, 1)), 1)
    for k in range(count):
        for r in range(rows):
            row({k: A[k, r]}, e[k, r])
            if k < count - 1:
                row({k: -B[k, r], k + 1: B[k, r]}, f[k, r])
                row({k: -B[k, r], k + 1: after[k, r]}, 2.0 * f[k, r])
            if k < count - 2:
                row({k: B[k, r], k + 1: -B[k, r] - B[k + 1, r], k + 2: B[k + 1, r]}, g[k, r])
        for c in range(1, nv) if k < count - SPAN else ():
            w = np.sqrt(square[c - 1])
            unit = np.eye(nv)[c]
            row({k + m: w * way * unit for m, way in enumerate(coefficients)}, gradient[c - 1] / w)
    more, pull = rng.uniform(size=(count, nv)), rng.normal(size=(count, nv))
    found = normal.solve(more, pull)
    M = np.array(dense)
    H = M.T @ M + np.diag(more.ravel())
    wanted = np.linalg.solve(H, -(M.T @ np.array(errors) + pull.ravel()))
    np.testing.assert_allclose(found.ravel(), wanted, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(normal.solve(more, pull), found)  # it may be asked again


def long_axis_error(found: wbc.Retargeted) -> float:
    """Return the largest angle of the ellipsoid's long axis from the human's [deg]."""
    return next(one.largest for one in found.reached if one.task == "principal axis 1")


@pytest.mark.slow
def test_first_attempt_with_higher_weights_follows_more_closely(monkeypatch) -> None:
    human, robot = stepping(), Robot.load("hoap2_like")
    higher = wbc.retarget(human, robot)
    monkeypatch.setattr(retries, "FIRST_ATTEMPT", dict.fromkeys(retries.FIRST_ATTEMPT, 1.0))
    plain = wbc.retarget(human, robot)
    off = [
        np.square(one.whole.momentum[:, 3:] - one.targets.angular_momentum).sum()
        for one in (higher, plain)
    ]
    assert long_axis_error(higher) < long_axis_error(plain) and off[0] < 1.05 * off[1]
    assert not higher.broken


def test_infeasible_attempts_return_the_least_infeasible(hoap2, monkeypatch) -> None:
    """Lower weights may be worse: the last attempt of a Unitree H1's kick slid by 36 mm."""
    feet, made = [0.03, 0.04, 0.002, 0.05, 0.01, 0.02, 0.04], list[Projection]()

    def project(problem: object, q: np.ndarray, *, stop_early: bool = False) -> Projection:
        made.append(Projection(q + len(made), feet[len(made)], 0.0, 0.0, 0.5, 0.5))
        return made[-1]

    monkeypatch.setattr(retries, "project_onto_constraints", project)
    monkeypatch.setattr(pipeline, "evaluate", lambda *given: given)
    q = wbc.retarget(crouching(2.0), hoap2, rounds=1)[5]
    assert len(made) == 7 and np.array_equal(q, made[2].q)


@pytest.mark.parametrize(("violations", "taken"), [((0.4, 0.3, 0.5, 0.6), 1), ((0.15, 0.16), 1)])
def test_iterations_that_diverge_give_the_one_nearest_to_the_constraints(
    monkeypatch: pytest.MonkeyPatch, violations: tuple[float, ...], taken: int
) -> None:
    """Others that end infeasible give the last one, whose tasks are nearer to their targets."""
    monkeypatch.setattr(retries, "interpolate", lambda robot, q, frames: q)
    iterates = [SimpleNamespace(violation=v, cost=1.0, actuator_ratio=1.0) for v in violations]
    turn = iter(iterates)
    targets = SimpleNamespace(time=np.zeros(1))
    tasks = SimpleNamespace(robot=None, targets=targets, set_inertia_targets=lambda *_: None)
    problem: Any = SimpleNamespace(
        tasks=tasks,
        collision=None,
        damping=1.0,
        states=lambda q: SimpleNamespace(inertia=None),
        linearize=lambda q, states: next(turn),
        step=lambda best: np.zeros((1, 7)),
    )
    q = np.zeros((1, 7))
    found: Any = retries.solve(problem, q, len(violations) - 1, False, None, q)
    assert found is iterates[taken]
