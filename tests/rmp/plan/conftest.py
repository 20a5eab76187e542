"""Plans of the examples, made once."""

from collections.abc import Callable
from functools import cache

import pytest

from benchmarks.plan_examples import EXAMPLES
from wbc.rmp.plan import Plan, solve


@pytest.fixture(scope="session")
def planned() -> Callable[[str], Plan]:
    return cache(lambda name: solve(EXAMPLES[name]()))
