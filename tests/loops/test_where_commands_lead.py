"""How far a loop is open where a command leads, by the core, against the state there."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.loops.ankle import _fixed, _joint, _link
from wbc import KinematicController, PostureTask, Robot


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A tree of two arms, one of which slides, to be closed where both hands are at first."""
    parts = [_link(name, 1.0, np.array([0.01, 0.02, 0.03])) for name in ("a", "b", "c", "d", "e")]
    parts += [
        _joint("swing", "a", "b", np.array([0.1, 0.0, 0.2]), "0.6 0.8 0"),
        _joint("slide", "b", "c", np.array([0.0, 0.1, 0.1]), "1 0 0").replace(
            "revolute", "prismatic"
        ),
        _joint("turn", "a", "d", np.array([-0.1, 0.0, 0.2]), "0 0 1"),
        _joint("bend", "d", "e", np.array([0.1, 0.1, 0.0]), "1 0 0"),
        *_fixed("hand", "c", np.array([0.3, 0.1, -0.2])),
        *_fixed("grip", "e", np.array([0.4, 0.1, -0.1])),
    ]
    (tmp_path / "arms.urdf").write_text(f"<robot name='arms'>{''.join(parts)}</robot>")
    return tmp_path


@pytest.mark.parametrize("kind", ["point", "pose"])
@pytest.mark.parametrize("dt", [0.002, 0.2])  # with angles below and above 0.1 rad
def test_gaps_where_a_command_leads_are_those_of_the_state_there(
    folder: Path, kind: str, dt: float
) -> None:
    loops = {"hands": {"frames": ["hand", "grip"], "kind": kind}}
    robot = Robot.load(folder / "arms.urdf", loops=loops, feet={})
    rng = np.random.default_rng(3)
    q = robot.integrate(robot.postures["standing"], rng.normal(0.0, 0.4, robot.nv), 1.0)
    v = rng.normal(0.0, 1.0, robot.nv)
    controller = KinematicController(robot, [PostureTask(robot, q)], contacts=(), dt=dt)
    found = controller._core.memory.gaps(robot.snapshot(q, v), v)
    there = robot.snapshot(robot.integrate(q, v, dt))
    R = there.rotation("grip")
    apart = R.T @ (there.position("hand") - there.position("grip"))
    turn = Rotation.from_matrix(R.T @ there.rotation("hand")).as_rotvec()
    right = apart if kind == "point" else np.concatenate((apart, turn))
    np.testing.assert_allclose(found, right, rtol=0.0, atol=1e-14)  # rounding
