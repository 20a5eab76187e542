"""What phases and limits refuse; supports as half-planes."""

import numpy as np
import pytest

from wbc.errors import InvalidInputError
from wbc.rmp.plan import Limits, Phase, hull, rectangle
from wbc.rmp.plan.schedule import overlap, support_bounds

SQUARE = rectangle(0.0, 0.0, 0.2, 0.2)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Phase("a", -1.0, SQUARE), "duration"),
        (lambda: Phase("a", (1.0, 0.5), SQUARE), "crossed"),
        (lambda: Phase("a", 1.0, ((0, 0), (1, 0), (0.2, 0.2), (0, 1))), "convex"),
        (lambda: Phase("a", 1.0, SQUARE, 0), "intervals"),
        (lambda: Phase("", 1.0, SQUARE), "name"),
        (lambda: Limits(leg_length=(0.0, 1.0)), "leg_length"),
        (lambda: Limits(radius=(0.3, 0.1)), "radius"),
        (lambda: Limits(friction=-1.0), "friction"),
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
