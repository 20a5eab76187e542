"""What phases, limits and states refuse; supports as half-planes; radii of given moments."""

import numpy as np
import pytest

from tests.rmp.plan.conftest import RADII
from wbc.errors import InvalidInputError
from wbc.rmp.plan import PathLimits, PlanPhase, State, hull, radii_for, rectangle
from wbc.rmp.plan.schedule import overlap, support_bounds

SQUARE = rectangle(0.0, 0.0, 0.2, 0.2)


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
