"""The G1 with rods on its ankles is measured as told, and walks without motors in its ankles."""

import numpy as np
import pytest

from benchmarks import parallel_ankles
from tests.conftest import load
from wbc.constraints.mechanics import mechanics_of
from wbc.gait import Walker
from wbc.gait.ability import bearing_torques
from wbc.robot import Robot, Snapshot

pytest.importorskip("mujoco")


@pytest.fixture(scope="module", autouse=True)
def _installed() -> None:
    load("g1")  # skips where it is not


def test_what_bears_it_goes_through_the_rods_to_the_motors() -> None:
    """Its power is that of the torques that a tree with motors everywhere would take."""
    robot = parallel_ankles.parallel()
    s = robot.snapshot(robot.posture("standing", parallel_ankles.JOINTS))
    torques = bearing_torques(s, robot.feet["left"].frame)
    by_name = dict(zip(robot.joint_names, torques.tolist(), strict=True))
    assert not any(by_name[name] for name in robot.unactuated)
    assert abs(by_name["left_in_motor"] + by_name["left_out_motor"]) > 5.0
    J = np.concatenate([one.residual(s).jacobian for one in mechanics_of(robot, ())])[:, 6:]
    free = np.linalg.svd(J)[2][np.linalg.matrix_rank(J, 1e-9) :].T
    whole = _as_a_tree(robot, s)
    np.testing.assert_allclose(free.T @ torques, free.T @ whole, atol=1e-9)
    assert Walker(robot, posture=s.q).notes == ()


def _as_a_tree(robot: Robot, s: Snapshot) -> np.ndarray:
    sole = robot.feet["left"].frame
    up = -robot.model.gravity.linear
    arm = s.com - s.position(sole)
    force = robot.mass * up[2] / arm[2] * arm
    rate = np.zeros(robot.nv)
    rate[:3] = s.rotation("base").T @ (force / robot.mass - up)
    return (s.mass_matrix @ rate + s.bias - s.jacobian(sole)[:3].T @ force)[6:]


@pytest.mark.slow
def test_it_walks_on_its_rods() -> None:
    seed, steps, said, ahead, _, gap, relaxed = parallel_ankles.walked(0, 6)
    assert (seed, steps, said) == ("0", "6", "walks")
    assert float(ahead) > 1.0 and float(gap) < 0.1 and relaxed.startswith("0 of")


@pytest.mark.slow
def test_ticks_are_timed_in_turns() -> None:
    rows = parallel_ankles.measured(50)
    assert [row[0] for row in rows] == [
        f"{of}, {name}"
        for of in ("velocity", "torque", "walking")
        for name in ("serial", "parallel")
    ]
    assert all(row[-1] == "0" for row in rows) and float(rows[1][5]) < 1e-9
