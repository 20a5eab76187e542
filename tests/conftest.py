"""Robots and random states shared by the tests."""

import os
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from wbc.controllers.core_memory import CoreMemory
from wbc.robot import Robot, Snapshot
from wbc.robot.notes import _warn_once

MIXED = Path(__file__).parent / "models" / "mixed_joints.urdf"
# Humanoids of very different size, one with locked joints, and a robot of every joint type.
ROBOTS = ("hoap2_like", "g1_27", "talos", "icub", "romeo", "mixed_joints")


@cache
def load(name: str) -> Robot:
    return Robot.load(MIXED if name == "mixed_joints" else name)


def random_state(robot: Robot, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Joints uniform within 90% of their range (a turn where there is none), base anywhere."""
    limits = robot.limits
    lower, upper = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    middle, half = (upper + lower) / 2, 0.45 * (upper - lower)
    base = np.concatenate((rng.normal(size=3), rng.normal(size=3) * 2, np.zeros(robot.nv - 6)))
    step = base.copy()
    step[6:] = middle + half * rng.uniform(-1, 1, robot.nv - 6)
    q = robot.integrate(robot.postures["neutral"], step, 1.0)
    return q, rng.normal(size=robot.nv)


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep fitted shapes of tests out of the user's cache; a name that is set already stays."""
    if "WBC_CACHE" not in os.environ:
        os.environ["WBC_CACHE"] = str(tmp_path_factory.mktemp("cache"))
        yield
        del os.environ["WBC_CACHE"]
    else:
        yield


@pytest.fixture(scope="session", autouse=True)
def _coarse_pictures() -> Iterator[None]:
    """Draw with fewer pixels, where they do not matter: it saves time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wbc.view.style.DPI", 40)
        yield


@pytest.fixture(autouse=True)
def _notes_are_told_anew() -> None:
    """Notes on robots are logged once in a process; here, once in a test."""
    _warn_once.cache_clear()


@pytest.fixture(autouse=True)
def _no_tick_writes_behind_its_memory(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    put, behind = CoreMemory._put, list[np.ndarray]()

    def guarded(self: CoreMemory, name: str, array: np.ndarray) -> None:
        if name in ("scratch", "order"):
            whole = np.concatenate((array, np.full(4096, -54321, dtype=array.dtype)))
            array = whole[: array.size]
            behind.append(whole[array.size :])
        put(self, name, array)

    monkeypatch.setattr(CoreMemory, "_put", guarded)
    yield
    assert all((tail == -54321).all() for tail in behind)


@pytest.fixture(params=ROBOTS)
def robot(request: pytest.FixtureRequest) -> Robot:
    return load(request.param)


@pytest.fixture(scope="session")
def hoap2() -> Robot:
    return load("hoap2_like")


@pytest.fixture
def here(hoap2: Robot) -> Snapshot:
    return hoap2.snapshot(hoap2.posture("standing"), np.zeros(hoap2.nv))


@pytest.fixture(scope="session")
def g1() -> Robot:
    return load("g1")


@pytest.fixture(scope="session")
def g1_27() -> Robot:
    return load("g1_27")


@pytest.fixture
def robot_named() -> Callable[[str], Robot]:
    return load


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20261121)


@pytest.fixture
def random_snapshot() -> Callable[[Robot, np.random.Generator], Snapshot]:
    return lambda robot, rng: robot.snapshot(*random_state(robot, rng))
