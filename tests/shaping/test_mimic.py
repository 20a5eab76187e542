"""The global search drives mimic joints by their gears, as the arm's own mechanics do."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize

from wbc.constraints import Limits, support
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.shaping import GlobalShaping
from wbc.tasks import PositionTask, PostureTask

BODY = (
    '<inertial><mass value="2"/><origin xyz="0 0 0.1"/>'
    '<inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial>'
)
# c follows b at -2 b + 0.1, d follows c at 0.5 c, so at -b + 0.05.
GEARS = {
    "c": '<mimic joint="b" multiplier="-2" offset="0.1"/>',
    "d": '<mimic joint="c" multiplier="0.5"/>',
}


def arm(folder: Path, c: str = 'lower="-2" upper="2"') -> Robot:
    parts = [f'<link name="world">{BODY}</link>']
    parent = "world"
    for name in "abcd":
        limit = c if name == "c" else 'lower="-2" upper="2"'
        parts.append(
            f'<link name="link_{name}">{BODY}</link><joint name="{name}" type="revolute">'
            f'<parent link="{parent}"/><child link="link_{name}"/><origin xyz="0 0 0.2"/>'
            f'<axis xyz="0 1 0"/><limit {limit} effort="9" velocity="2"/>'
            f"{GEARS.get(name, '')}</joint>"
        )
        parent = f"link_{name}"
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm">{"".join(parts)}</robot>')
    return Robot.load(path)


@pytest.mark.parametrize(
    ("target", "most"),
    [((0.3, 0.0, 0.5), 2.0), ((-0.5, 0.0, 0.1), 2.0), ((2.0, 0.0, 0.3), 2.0)]
    + [((-0.5, 0.0, 0.1), 0.15)],  # as far as c goes
)
def test_the_best_posture_keeps_the_gears(
    tmp_path: Path, target: tuple[float, ...], most: float
) -> None:
    """Oracle: SciPy over the two joints that are driven, from a grid, through Robot.posture."""
    robot = arm(tmp_path, c=f'lower="-{most}" upper="{most}"')
    q = robot.posture()
    # In weights and gains as the search's cost counts them: gain / 2 of squared errors.
    tasks = [
        PositionTask(robot, "link_d", target, gain=1.0),
        PostureTask(robot, q, weight=0.1, gain=1.0),
    ]
    names, rest = robot.joint_names, robot.limits.joint_positions(q)
    # b so that c = -2 b + 0.1 stays in range, which is the tighter.
    box = [(-2.0, 2.0), ((0.1 - most) / 2, (0.1 + most) / 2)]

    def cost(x: np.ndarray) -> float:
        joints = {"a": x[0], "b": x[1], "c": -2 * x[1] + 0.1, "d": -x[1] + 0.05}
        there = np.array([joints[name] for name in names])
        step = np.concatenate((np.zeros(6), there - rest))
        place = robot.snapshot(robot.integrate(q, step, 1.0)).position("link_d")
        off = place - target
        return 0.5 * float(off @ off) + 0.005 * float((there - rest) @ (there - rest))

    starts = [np.array([a, b]) for a in np.linspace(-2, 2, 5) for b in np.linspace(-0.9, 1, 5)]
    found = [minimize(cost, x, bounds=box, method="L-BFGS-B").fun for x in starts]
    contacts = support(robot.snapshot(q), "floating")  # the base is bolted
    outcome = GlobalShaping(robot, tasks, contacts=contacts).solve(q, starts=16, workers=1)
    best = outcome.best
    assert best.cost == pytest.approx(min(found), rel=1e-6)
    now = dict(zip(names, robot.limits.joint_positions(best.q), strict=True))
    assert now["c"] == pytest.approx(-2 * now["b"] + 0.1, abs=1e-12)
    assert now["d"] == pytest.approx(-now["b"] + 0.05, abs=1e-12)
    joints = robot.limits.joint_positions(best.q)
    assert (np.abs(joints) <= 2.0 + 1e-9).all()
    assert abs(now["c"]) <= most + 1e-9
    assert most == 2.0 or abs(now["c"]) == pytest.approx(most, abs=1e-6)


def test_the_way_there_keeps_them_too(tmp_path: Path) -> None:
    robot = arm(tmp_path)
    q = robot.posture()
    tasks = [PositionTask(robot, "link_d", (0.3, 0.0, 0.5))]
    contacts = support(robot.snapshot(q), "floating")
    shaping = GlobalShaping(robot, tasks, contacts=contacts)
    motion = shaping.reach(q, shaping.solve(q, starts=8, workers=1))
    assert motion.arrived, motion.attempts
    for at in motion.q:
        now = dict(zip(robot.joint_names, robot.limits.joint_positions(at), strict=True))
        assert now["c"] == pytest.approx(-2 * now["b"] + 0.1, abs=1e-6)


def test_gears_that_leave_no_range_are_named(tmp_path: Path) -> None:
    robot = arm(tmp_path, c='lower="4" upper="5"')  # for b from -2 to -1.95
    q = robot.postures["neutral"]
    tasks = [PositionTask(robot, "link_d", (0.3, 0.0, 0.5))]
    with pytest.raises(InvalidInputError, match="no position of joint 'b' leaves 'c'"):
        shaping = GlobalShaping(robot, tasks, limits=Limits(robot, margin=0.1))
        shaping.solve(q, starts=2, workers=1)
