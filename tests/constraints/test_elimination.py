"""The reduced formulation against the paper's eliminations (eqs. 33-37) and the equality form."""

import numpy as np
import pytest

from wbc.constraints import support
from wbc.qp import make_backend
from wbc.qp.active_set import ActiveSet
from wbc.qp.elimination import eliminate, factorise
from wbc.qp.problem import QP
from wbc.qp.solution import Status
from wbc.robot import Robot

HUMANOIDS = ("hoap2_like", "g1_27", "talos")


def standing(robot: Robot, rng: np.random.Generator):
    q = robot.posture("standing")
    return robot.snapshot(robot.integrate(q, 0.05 * rng.normal(size=robot.nv), 1.0))


def contact_matrix(here, mode: str) -> np.ndarray:
    return np.concatenate([contact.residual(here).jacobian for contact in support(here, mode)])


def null_space_qp(A: np.ndarray) -> QP:
    n = A.shape[1]
    return QP.build(np.eye(n), np.zeros(n), A=A, b=np.zeros(len(A)))


@pytest.mark.parametrize("name", HUMANOIDS)
def test_single_support_is_eqs_33_to_35(name: str, robot_named, rng) -> None:
    """With the left foot held, J_I N = J_I,q - J_I,0 Ad_{G_l} J_l, and the CoM rows likewise."""
    robot = robot_named(name)
    here = standing(robot, rng)
    foot = robot.feet["left"].frame
    # Ad_{G_l} J_l (the paper's J_l*): twist that the leg's joints give the foot, seen at the base.
    R, p = here.rotation("base"), here.position("base")
    arm = here.position(foot) - p
    linear, angular = here.jacobian(foot)[:3, 6:], here.jacobian(foot)[3:, 6:]
    at_base = linear - np.cross(angular.T, arm).T  # velocity of the foot's body at the base origin
    star = np.concatenate((R.T @ at_base, R.T @ angular))
    reduced = eliminate(null_space_qp(contact_matrix(here, "left")))
    # The same subspace of v: the paper's basis has the joints as free unknowns.
    paper = np.concatenate((-star, np.eye(robot.nv - 6)))
    np.testing.assert_allclose(paper, reduced.basis @ paper[reduced.factors.free], atol=1e-9)
    for J in (here.inertia_jacobian, here.com_jacobian):
        expected = J[:, 6:] - J[:, :6] @ star
        actual = J @ reduced.basis @ paper[reduced.factors.free]
        np.testing.assert_allclose(actual, expected, atol=1e-9 * np.abs(J).max())


@pytest.mark.parametrize("name", HUMANOIDS)
def test_double_support_is_eqs_36_and_37(name: str, robot_named, rng) -> None:
    """J_l* ql' = J_r* qr' and the base follows: the paper's basis spans the same motions."""
    robot = robot_named(name)
    here = standing(robot, rng)
    A = contact_matrix(here, "double")
    reduced = eliminate(null_space_qp(A))
    legs = [int(np.flatnonzero(np.abs(here.jacobian(robot.feet[s].frame)[:, 6:]).sum(0))[-1]) + 6
            for s in ("left", "right")]  # fmt: skip
    right = [k for k in range(6, robot.nv) if legs[1] - 6 < k <= legs[1]]
    assert len(right) == 6
    dependent = [*range(6), *right]
    free = [k for k in range(robot.nv) if k not in dependent]
    paper = np.zeros((robot.nv, len(free)))
    paper[free, np.arange(len(free))] = 1.0
    paper[dependent] = -np.linalg.solve(A[:, dependent], A[:, free])
    np.testing.assert_allclose(A @ reduced.basis, 0.0, atol=1e-12)
    np.testing.assert_allclose(paper, reduced.basis @ paper[reduced.factors.free], atol=1e-7)


def test_straight_knees_do_not_break_it(robot_named) -> None:
    """At a straight knee the right leg's Jacobian is singular: solving for that leg blows up."""
    robot = robot_named("hoap2_like")
    here = robot.snapshot(robot.postures["neutral"])
    A = contact_matrix(here, "double")
    reduced = eliminate(null_space_qp(A))
    assert np.abs(reduced.basis).max() < 100.0
    np.testing.assert_allclose(A @ reduced.basis, 0.0, atol=1e-12)
    rank = np.linalg.matrix_rank(A, tol=1e-8)
    assert reduced.factors.dependent.size == rank


def test_redundant_rows_are_dropped_and_contradictions_measured(rng) -> None:
    A = rng.normal(size=(4, 9))
    A = np.vstack((A, A[0] + A[1]))
    x = rng.normal(size=9)
    factors = factorise(A, np.ones(9))
    assert factors.dependent.size == 4
    qp = QP.build(np.eye(9), rng.normal(size=9), A=A, b=A @ x)
    assert eliminate(qp).mismatch < 1e-12
    off = QP.build(np.eye(9), rng.normal(size=9), A=A, b=A @ x + np.eye(5)[4])
    assert eliminate(off).mismatch > 0.1


def test_no_equalities_is_the_identity(rng) -> None:
    qp = QP.build(np.eye(3), rng.normal(size=3), lower=-np.ones(3), upper=np.ones(3))
    reduced = eliminate(qp)
    np.testing.assert_array_equal(reduced.basis, np.eye(3))
    np.testing.assert_array_equal(reduced.reduced.P, qp.P)


@pytest.mark.parametrize("rows", [1, 2])
def test_few_equalities_are_eliminated_and_come_back(rows: int, rng) -> None:
    """Oracle: the KKT system of the full QP, solved at once."""
    n = 4
    root, A = rng.normal(size=(n, n)), rng.normal(size=(rows, n))
    P, g, b = root.T @ root + np.eye(n), rng.normal(size=n), rng.normal(size=rows)
    system = np.block([[P, A.T], [A, np.zeros((rows, rows))]])
    expected = np.linalg.solve(system, np.concatenate((-g, b)))
    found = eliminate(QP.build(P, g, A=A, b=b))
    assert found.basis.shape == (n, n - rows) and found.mismatch < 1e-12
    solution = found.lift(ActiveSet().solve(found.reduced))
    np.testing.assert_allclose(solution.x, expected[:n], atol=1e-9)
    np.testing.assert_allclose(solution.y, expected[n:], atol=1e-8)
    assert found.admits(solution)


def test_equalities_of_zeros_fix_nothing_and_what_they_ask_for_is_missed() -> None:
    qp = QP.build(np.eye(3), np.ones(3), A=np.zeros((2, 3)), b=[0.25, -4.0])
    found = eliminate(qp)
    np.testing.assert_array_equal(found.basis, np.eye(3))
    assert found.mismatch == 4.0
    solution = found.lift(ActiveSet().solve(found.reduced))
    np.testing.assert_allclose(solution.x, -1.0, atol=1e-9)
    assert not found.admits(solution)
    assert eliminate(qp._replace(b=np.zeros(2))).mismatch == 0.0


@pytest.mark.parametrize("solver", ["proxqp", "daqp"])
def test_bounds_of_unknowns_that_are_fixed_do_not_hold_the_free_one(solver: str, rng) -> None:
    """Levels fix joints at their bounds by mixed rows; what they free is found all the same.

    Rounding left rows of 1e-20 for those bounds in the reduced QP. ProxQP "met" them far away, with
    multipliers of 1e26, and KKT residuals relative to such terms were small: floating robots were
    commanded 1e7 rad/s with the status "solved".
    """
    n = 8
    for _ in range(20):
        fixed = rng.normal(size=n - 2)
        rows = np.zeros((n - 1, n))  # x_k = fixed_k and x_6 = x_7
        rows[: n - 2, : n - 2] = np.eye(n - 2)
        rows[n - 2, n - 2 :] = 1.0, -1.0
        mix = np.linalg.qr(rng.normal(size=(n - 1, n - 1)))[0]
        lower = np.concatenate((fixed, (-np.inf, -np.inf)))
        qp = QP.build(
            0.3 * np.eye(n),
            np.concatenate((rng.normal(size=n - 2), (-0.3, 0.0))),
            A=mix @ rows,
            b=mix @ np.concatenate((fixed, [0.0])),
            lower=lower,
            upper=np.concatenate((fixed + 1.0, (np.inf, np.inf))),
        )
        elimination = eliminate(qp)
        solution = elimination.lift(make_backend(solver).solve(elimination.reduced))
        assert solution.status is Status.SOLVED
        np.testing.assert_allclose(solution.x[-2:], 0.5, atol=1e-9)
        assert solution.residuals.dual < 1e-9  # absolute: relative to its multipliers all is small


@pytest.mark.parametrize("mi", [0, 3])
def test_what_is_found_without_the_equalities_solves_the_whole(mi: int, rng) -> None:
    """Bounds on both sides, on one, or none; oracle: the whole QP, by the same solver."""
    for _ in range(30):
        n = 7
        J, A, C, x = (rng.normal(size=size) for size in ((9, n), (3, n), (mi, n), n))
        lower, upper = x - rng.uniform(0.0, 0.3, n), x + rng.uniform(0.0, 0.3, n)
        lower[rng.uniform(size=n) < 0.5], upper[rng.uniform(size=n) < 0.5] = -np.inf, np.inf
        qp = QP.build(J.T @ J, 5.0 * rng.normal(size=n), A=A, b=A @ x, C=C, l=C @ x - 0.1,
                      lower=lower, upper=upper)  # fmt: skip
        expected, elimination = ActiveSet().solve(qp), eliminate(qp)
        assert elimination.reduced.g.size == n - 3 and not elimination.reduced.b.size
        assert elimination.reduced.A.shape == (0, n - 3)
        found = elimination.lift(ActiveSet().solve(elimination.reduced))
        assert elimination.admits(found)
        for part in ("x", "y", "z", "z_box"):
            scale = 1.0 + np.abs(getattr(expected, part)).max(initial=0.0)
            np.testing.assert_allclose(
                getattr(found, part), getattr(expected, part), atol=1e-6 * scale, err_msg=part
            )
