"""Contradictions in a planning problem are refused."""

from dataclasses import replace

import numpy as np
import pytest

from tests.rmp.plan.conftest import HEIGHT, LIMITS, RADII
from wbc.errors import InvalidInputError
from wbc.rmp.plan import PlanPhase, PlanProblem, State, at_rest, rectangle
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import EulerSolidRmp, SolidRmp

STAND = PlanPhase("stand", 1.0, rectangle(0.0, 0.0, 0.2, 0.2), 8)
FLY = PlanPhase("fly", 0.3, None, 8)
REST = at_rest((0.0, 0.0, HEIGHT), RADII)


def problem(**changed: object) -> PlanProblem:
    return PlanProblem(
        **{"pendulum": SolidRmp(30.0), "schedule": (STAND,), "start": REST} | changed
    )


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"schedule": ()}, "at least one phase"),
        ({"schedule": (STAND, STAND)}, "different names"),
        ({"schedule": (STAND, FLY)}, "ends in the flight 'fly'"),
        ({"schedule": (FLY, STAND), "start": State(radii=RADII)}, "begins in the flight"),
        ({"schedule": (FLY, replace(FLY, name="on"), STAND)}, "one flight"),
        ({"pendulum": SolidRmp(30.0, 0.0)}, "gravity"),
        ({"start": at_rest((3.0, 0.0, HEIGHT), RADII), "limits": LIMITS}, "no CoP is possible"),
        ({"start": at_rest((0.0, 0.0, 0.0), RADII)}, "above the ground"),
        ({"start": at_rest((0.0, 0.0, HEIGHT), (0.9, 0.2, 0.2)), "limits": LIMITS}, "0.9"),
        ({"goal": at_rest((0.0, 0.0, 1.6), RADII), "limits": LIMITS}, "goal"),
        ({"reference": (0.0, 0.0, 0.0, 2.0)}, "unit quaternion"),
        ({"degree": 1}, "degree"),
        ({"periodic": (np.nan, 0.0)}, "periodic"),
        ({"pendulum": PlanarRmp(30.0)}, "r_1 = r_3"),
        ({"pendulum": 30.0}, r"pendulum: expected SolidRmp\(mass\) or PlanarRmp\(mass\), got 30"),
        ({"pendulum": EulerSolidRmp(30.0)}, "pendulum: expected SolidRmp"),
        ({"schedule": STAND}, "schedule: expected a list of PlanPhase"),
        ({"start": {"com": (0.0, 0.0, HEIGHT)}}, "start: expected a State, such as"),
        ({"goal": None}, "goal: expected a State"),
        ({"limits": {"friction": 0.6}}, "limits: expected a PathLimits"),
        ({"weights": {"com": 2.0}}, "weights: expected a Weights"),
    ],
)
def test_contradictions_are_refused(changed: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        problem(**changed)
