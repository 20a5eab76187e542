"""Threads may share a robot: each has memory of its own."""

import sys
import threading

import numpy as np
import pytest

from wbc.robot import Robot

READ = (
    *("centroidal_map", "momentum", "momentum_drift", "com_drift", "inertia_jacobian"),
    *("inertia_drift", "joint_placements", "joint_twists", "mass_matrix", "bias"),
)


@pytest.fixture
def fast_switching():
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.usefixtures("fast_switching")
def test_threads_share_a_robot():
    robot, rng = Robot.load("hoap2_like"), np.random.default_rng(0)
    states = [
        (robot.integrate(robot.posture(), 0.3 * v, 1.0), v)
        for v in rng.standard_normal((40, robot.nv))
    ]

    def everything(k):
        snapshot = robot.snapshot(*states[k])
        found = [np.concatenate([np.ravel(p) for p in getattr(snapshot, name)]) for name in READ]
        found += [snapshot.jacobian("base").ravel(), snapshot.drift("base"), snapshot.com]
        return np.concatenate(found)

    expected = [everything(k) for k in range(len(states))]
    wrong = []

    def read(first):
        for k in 8 * [*range(first, len(states)), *range(first)]:
            try:
                if not np.array_equal(everything(k), expected[k]):
                    wrong.append(k)
            except Exception as error:  # an exception in a thread would only be printed
                wrong.append(error)

    threads = [threading.Thread(target=read, args=(first,)) for first in (0, 13, 26)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
