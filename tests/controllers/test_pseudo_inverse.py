"""The eq. 38 baseline against NumPy's least squares, and what it does at limits."""

import numpy as np
import pytest

from wbc.constraints import Limits, support
from wbc.controllers import KinematicController
from wbc.errors import InvalidInputError
from wbc.qp import QP, make_backend
from wbc.tasks import ComTask, InertiaTask


def test_it_is_the_pseudo_inverse(hoap2, rng) -> None:
    """Floating, nothing active: J'(JJ' + damping)^-1 (-k e), the minimum-norm form of eq. 38."""
    here = hoap2.snapshot(hoap2.posture("standing", {"*elbow*": -0.5}))
    task = InertiaTask(hoap2, here.inertia * 1.001, gain=0.1)
    tick = KinematicController(
        hoap2, [task], dt=0.005, damping=1e-12, solver="pseudo_inverse"
    ).step(here)
    residual = task.residual(here)
    J, wanted = residual.jacobian, -0.1 / 0.005 * residual.error
    # the controller's, and gain/2 of the task's
    damping = np.diag(1e-12 + 0.05 * residual.curvature_bound())
    expected = np.linalg.solve(J.T @ J + damping, J.T @ wanted)
    np.testing.assert_allclose(tick.velocity, expected, atol=1e-6 * np.abs(expected).max())


def test_the_plain_step_of_the_paper(hoap2) -> None:
    """Eq. 38 as printed, J^+ (I_d - I) in one step, by NumPy; twice the inertia."""
    here = hoap2.snapshot(hoap2.posture("standing", {"*elbow*": -0.5}))
    task = InertiaTask(hoap2, 2.0 * here.inertia, gain=1.0, curvature_damping=False)
    controller = KinematicController(hoap2, [task], dt=1.0, damping=1e-13, solver="pseudo_inverse")
    residual = task.residual(here)
    expected = np.linalg.pinv(residual.jacobian) @ -residual.error
    found = controller.step(here).velocity
    # The damping of 1e-13 beside least singular values squared of 1e-8.
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("mode", ["floating", "left", "double"])
def test_without_active_limits_it_is_the_qp(mode: str, g1_27, rng) -> None:
    here = g1_27.snapshot(g1_27.posture("standing"))
    tasks = [ComTask(g1_27, here.com + [0.001, 0, 0]), InertiaTask(g1_27, here.inertia, weight=0.1)]
    same = {"contacts": support(here, mode), "limits": Limits(g1_27), "damping": 1e-3}
    by_qp = KinematicController(g1_27, tasks, **same).step(here)
    baseline = KinematicController(g1_27, tasks, solver="pseudo_inverse", **same).step(here)
    np.testing.assert_allclose(baseline.velocity, by_qp.velocity, atol=1e-6)
    assert baseline.solution.residuals.dual < 1e-6


@pytest.mark.parametrize("rows", [1, 3])
def test_rows_that_repeat_others_to_rounding_count_once(rows: int, rng) -> None:
    """Oracle: the least cost in the null space of the rows without the last, by SVD."""
    A, g = rng.normal(size=(rows, 6)), rng.normal(size=6)
    b = A @ rng.normal(size=6)
    near = np.vstack((A, A[0] + 1e-11 * rng.normal(size=6)))
    qp = QP.build(np.eye(6), g, A=near, b=np.append(b, b[0]))
    null = np.linalg.svd(A)[2][rows:].T
    point = np.linalg.pinv(A) @ b
    expected = point - null @ null.T @ (g + point)
    found = make_backend("pseudo_inverse").solve(qp)
    np.testing.assert_allclose(found.x, expected, atol=1e-8)


def test_clipping_is_not_the_optimum_and_says_so(hoap2) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))
    tasks = [ComTask(hoap2, here.com + [0.1, 0, 0.1])]
    same = {"contacts": support(here, "double"), "limits": Limits(hoap2), "damping": 1e-4}
    baseline = KinematicController(hoap2, tasks, solver="pseudo_inverse", **same).step(here)
    by_qp = KinematicController(hoap2, tasks, **same).step(here)
    residuals = baseline.solution.residuals
    assert max(residuals.primal, residuals.dual, residuals.complementarity) > 1e-3
    assert max(by_qp.solution.residuals.dual, by_qp.solution.residuals.primal) < 1e-6


def test_what_is_no_qp_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="QP"):
        make_backend("pseudo_inverse").solve(
            QP.build(np.eye(2), [1.0, 0.0])._replace(g=np.zeros(3))
        )
