"""What problems, phases, limits and states refuse; supports as half-planes; radii by moments."""

from dataclasses import replace

import numpy as np
import pytest

from tests.rmp.plan.conftest import HEIGHT, LIMITS, RADII
from wbc.errors import InvalidInputError
from wbc.rmp.plan import (
    PathLimits,
    PlanPhase,
    PlanProblem,
    State,
    at_rest,
    hull,
    radii_for,
    rectangle,
)
from wbc.rmp.plan.schedule import overlap, support_bounds
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import EulerSolidRmp, SolidRmp

SQUARE = rectangle(0.0, 0.0, 0.2, 0.2)
STAND = PlanPhase("stand", 1.0, rectangle(0.0, 0.0, 0.2, 0.2), 8)
FLY = PlanPhase("fly", 0.3, None, 8)
REST = at_rest((0.0, 0.0, HEIGHT), RADII)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: PlanPhase("a", -1.0, SQUARE), "duration"),
        (lambda: PlanPhase("a", (1.0, 0.5), SQUARE), "crossed"),
        (lambda: PlanPhase("a", 1.0, ((0, 0), (1, 0), (0.2, 0.2), (0, 1))), "convex"),
        (lambda: PlanPhase("a", 1.0, SQUARE, 0), "intervals"),
        (lambda: PlanPhase("", 1.0, SQUARE), "name"),
        (lambda: PlanPhase("a", 1.0, SQUARE, limits={"friction": 0.6}), "'a': limits: expected"),
        (lambda: PlanPhase("a", 1.0, SQUARE, end=(0.0, 0.0, 0.7)), "'a': end: expected a State"),
        (lambda: PathLimits(leg_length=(0.0, 1.0)), "leg_length"),
        (lambda: PathLimits(radius=(0.3, 0.1)), "radius"),
        (lambda: PathLimits(friction=-1.0), "friction"),
        (lambda: PathLimits(torsion=-0.1), "torsion"),
        (lambda: PathLimits(force=np.array((500.0, 600.0))), "limits: force: expected a number"),
    ],
)
def test_impossible_data_are_refused(build: object, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        build()


def test_supports() -> None:
    left, right = rectangle(0.0, 0.1, 0.2, 0.1), rectangle(0.3, -0.1, 0.2, 0.1)
    both = hull(left, right)
    assert len(both) == 6 and overlap(left, both) and not overlap(left, right)
    for corners in (both, ((0.1, 0.2),), ((0.0, 0.0), (1.0, 2.0))):
        A, low, high = support_bounds(corners)
        inside = A @ np.mean(corners, axis=0)
        assert (inside >= low - 1e-12).all() and (inside <= high + 1e-12).all()
        outside = A @ (np.mean(corners, axis=0) + (3.0, 0.0))
        assert ((outside < low - 1e-3) | (outside > high + 1e-3)).any()


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: State(radii=(0.1, -0.1, 0.1)), "radii"),
        (lambda: State(rotation=(0.0, 0.0, 7.0)), "full turn"),
        (lambda: State(inertia=(1.0, 0.4, 0.5)), "triangle"),
        (lambda: State(inertia=(1.0, -0.4, 0.9)), "positive"),
        (lambda: State(inertia=(1.0, 1.0, 1.0), radii=RADII), "not both"),
        (lambda: radii_for(-1.0, (1.0, 1.0, 1.0)), "mass"),
    ],
)
def test_impossible_states_are_refused(build: object, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        build()


def test_radii_for_is_the_inverse_of_the_inertia() -> None:
    r = np.array(RADII)
    np.testing.assert_allclose(radii_for(30.0, 10.0 * ((r**2).sum() - r**2)), r, rtol=1e-13)


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
