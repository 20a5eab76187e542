"""A proximal step that rounding throws far away ends the search, in place of posing the next QP."""

import numpy as np
import pytest

from wbc.qp import QP
from wbc.qp.active_set import proximal
from wbc.qp.core import CoreSolution, solve_in_core


def test_proximal_step_beyond_all_rows_leaves_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    box = {"lower": np.zeros(2), "upper": np.ones(2)}
    qp = QP.build(np.zeros((2, 2)), np.ones(2), C=[[1.0, 1.0]], l=[1.0], u=[2.0], **box)

    def thrown(qp: QP, eps: float, most: int, give: np.ndarray | None) -> CoreSolution:
        found = solve_in_core(qp, eps, most, give)
        far = found.residuals._replace(primal=1e22)
        return found._replace(x=np.full(2, 1e200), residuals=far)

    assert proximal(qp, 1e-8, 100) is not None
    monkeypatch.setattr("wbc.qp.active_set.solve_in_core", thrown)
    assert proximal(qp, 1e-8, 100) is None
