"""How far a loop is open where a command leads, by the core, against the state there."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.loops.ankle import fixed
from tests.urdf import joint, link, robot
from wbc import KinematicController, PostureTask, Robot

# A tree of two arms, one of which slides, to be closed where both hands are at first.
ARMS = robot(
    "arms",
    *(link(name, moment=1e-4, at="0.01 0.02 0.03") for name in "abcde"),
    joint("swing", "a", "b", at="0.1 0 0.2", axis="0.6 0.8 0"),
    joint("slide", "b", "c", kind="prismatic", at="0 0.1 0.1", axis="1 0 0"),
    joint("turn", "a", "d", at="-0.1 0 0.2", axis="0 0 1"),
    joint("bend", "d", "e", at="0.1 0.1 0", axis="1 0 0"),
    fixed("hand", "c", (0.3, 0.1, -0.2)),
    fixed("grip", "e", (0.4, 0.1, -0.1)),
)


@pytest.mark.parametrize("kind", ["point", "pose"])
@pytest.mark.parametrize("dt", [0.002, 0.2])  # with angles below and above 0.1 rad
def test_gaps_where_a_command_leads_are_those_of_the_state_there(kind: str, dt: float) -> None:
    loops = {"hands": {"frames": ["hand", "grip"], "kind": kind}}
    arms = Robot.load(ARMS, loops=loops, feet={})
    rng = np.random.default_rng(3)
    q = arms.integrate(arms.postures["standing"], rng.normal(0.0, 0.4, arms.nv), 1.0)
    v = rng.normal(0.0, 1.0, arms.nv)
    controller = KinematicController(arms, [PostureTask(arms, q)], contacts=(), dt=dt)
    found = controller._core.memory.gaps(arms.snapshot(q, v), v)
    there = arms.snapshot(arms.integrate(q, v, dt))
    R = there.rotation("grip")
    apart = R.T @ (there.position("hand") - there.position("grip"))
    turn = Rotation.from_matrix(R.T @ there.rotation("hand")).as_rotvec()
    right = apart if kind == "point" else np.concatenate((apart, turn))
    np.testing.assert_allclose(found, right, rtol=0.0, atol=1e-14)  # rounding
