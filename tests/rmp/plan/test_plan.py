"""The motion of a plan at any time."""

from collections.abc import Callable

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.rmp.plan import Plan, generalised

Planned = Callable[[str], Plan]


def test_at_meets_the_knots_and_refuses_what_lies_outside(planned: Planned) -> None:
    plan = planned("hop")
    k = plan.knots
    inside = np.flatnonzero(np.append(np.diff(k.phase) == 0, True))  # the later of two at a time
    inside = inside[k.time[inside] < plan.duration]
    m = plan.at(k.time[inside])
    np.testing.assert_allclose(m.com, k.com[inside], atol=1e-8)
    np.testing.assert_allclose(m.force, k.force[inside], atol=1e-6)
    with pytest.raises(InvalidInputError, match="within the plan"):
        plan.at(plan.duration + 0.1)
    with pytest.raises(InvalidInputError, match="in flight"):
        generalised(plan, plan.at(plan.starts[1] + 0.01))
