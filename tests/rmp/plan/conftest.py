"""Plans of the examples, made once, and numbers of the first one."""

from collections.abc import Callable
from functools import cache

import pytest

from benchmarks.planner import example
from wbc.rmp.plan import Plan, solve

LIMITS = example("push").limits
RADII = (0.22, 0.2, 0.15)  # m
HEIGHT = 0.75  # m, of the CoM


@pytest.fixture(scope="session")
def planned() -> Callable[[str], Plan]:
    return cache(lambda name: solve(example(name)))
