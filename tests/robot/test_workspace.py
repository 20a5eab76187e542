"""Scratch memory: one for each thread, so that threads may share a robot."""

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


def test_a_thread_keeps_its_workspace_and_reads_snapshots_of_others():
    robot = Robot.load("hoap2_like")
    mine, snapshot, found = robot.workspace, robot.snapshot(robot.posture()), []

    def elsewhere():
        found.extend((robot.workspace, robot.workspace, snapshot.jacobian("base")))

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert robot.workspace is mine
    assert found[0] is found[1] is not mine
    np.testing.assert_array_equal(found[2], robot.snapshot(robot.posture()).jacobian("base"))
