"""What a state refuses, and radii of given moments of inertia."""

import numpy as np
import pytest

from benchmarks.plan_examples import RADII
from wbc.errors import InvalidInputError
from wbc.rmp.plan import State, radii_for


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
def test_impossible_data_are_refused(build: object, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        build()


def test_radii_for_is_the_inverse_of_the_inertia() -> None:
    r = np.array(RADII)
    np.testing.assert_allclose(radii_for(30.0, 10.0 * ((r**2).sum() - r**2)), r, rtol=1e-13)
