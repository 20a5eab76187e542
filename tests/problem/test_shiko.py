"""Shiko as the shipped problems run it, judged by code of its own: balance, heights, mirror image.

The true CoP comes from Pinocchio's rate of the centroidal momentum, the accelerations being the
differences of the commanded velocities; the polygons are hulls of the soles by scipy.
"""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull

from wbc.problem import Result, load_problem
from wbc.reduction import reduce
from wbc.robot import Robot

pytestmark = pytest.mark.slow
PROBLEMS = Path(__file__).parents[2] / "problems"
DT = 0.005  # s
# Of the CoM's projection, and of the true CoP: what must be left inside the soles [m].
STATIC = {"hoap2": 0.025, "g1": 0.02}
DYNAMIC = {"hoap2": 0.015, "g1": 0.009}


class Shiko:
    def __init__(self, name: str) -> None:
        self.name = name
        self.problem = load_problem(PROBLEMS / f"shiko_{name}.yaml")
        self.result: Result = self.problem.run()
        self.history = self.result.history
        self.robot: Robot = self.problem.parts.robot
        self.data = self.robot.model.createData()

    def soles(self, q: np.ndarray) -> dict[str, pin.SE3]:
        pin.framesForwardKinematics(self.robot.model, self.data, q)
        frames = {f: self.robot.model.getFrameId(f"{f}_sole") for f in ("left", "right")}
        return {foot: self.data.oMf[frame].copy() for foot, frame in frames.items()}

    def edges(self, k: int) -> np.ndarray:
        """Normals and offsets of the hull of the soles that stand at tick k; inside is negative."""
        soles = self.soles(self.history.q[k])
        corners = [
            soles[foot].act(np.array([*corner, 0.0]))[:2]
            for foot in self.history.support[k].split(",")
            for corner in self.robot.feet[foot].polygon
        ]
        return ConvexHull(np.array(corners)).equations

    def phase(self, name: str) -> np.ndarray:
        return np.flatnonzero(self.history.phase == name)


@pytest.fixture(scope="module", params=["hoap2", "g1"])
def shiko(request: pytest.FixtureRequest) -> Shiko:
    return Shiko(request.param)


def test_it_runs_as_a_whole(shiko: Shiko) -> None:
    result = shiko.result
    assert result.status == "accepted", result.reason
    assert not result.failures
    assert 15.0 <= len(shiko.history) * DT <= 25.0
    assert list(result.phases)[:5] == [
        "squat",
        "shift right",
        "lift left",
        "stomp left",
        "sink left",
    ]
    assert np.abs(shiko.history.v[-1]).max() < 0.02  # rad/s; it ends at rest, and where it began
    np.testing.assert_allclose(result.final.com, shiko.history.com[0], atol=1e-4)


def test_the_com_is_over_the_soles_all_along(shiko: Shiko) -> None:
    q, com = shiko.history.q, shiko.history.com
    margins = [
        -(edges[:, :2] @ com[k, :2] + edges[:, 2]).max()
        for k in range(0, len(q), 5)
        for edges in [shiko.edges(k)]
    ]
    assert min(margins) > STATIC[shiko.name]
    assert shiko.result.balance is not None
    assert shiko.result.balance.value == pytest.approx(min(margins), abs=1e-3)


def test_the_true_cop_is_inside_the_soles_all_along(shiko: Shiko) -> None:
    robot, q, v = shiko.robot, shiko.history.q, shiko.history.v
    g, mass, margins = 9.81, robot.mass, []
    for k in range(1, len(q)):  # every tick: also those at which a foot lands or is let go of
        rate = pin.computeCentroidalMomentumTimeVariation(
            robot.model, shiko.data, q[k], v[k - 1], (v[k] - v[k - 1]) / DT
        )
        force = rate.linear + [0.0, 0.0, mass * g]
        c, moment = shiko.data.com[0].copy(), rate.angular
        assert force[2] > 0.5 * mass * g
        # The point of the ground about which the push has no horizontal moment.
        cop = c[:2] - c[2] * force[:2] / force[2] + [-moment[1] / force[2], moment[0] / force[2]]
        edges = shiko.edges(k)
        margins.append(-(edges[:, :2] @ cop + edges[:, 2]).max())
        if k % 200 == 0:  # what the package itself says
            feet = shiko.history.support[k].split(",")
            state = reduce(robot.snapshot(q[k], v[k - 1]), (v[k] - v[k - 1]) / DT, feet=feet)
            assert state.cop_margin == pytest.approx(margins[-1], abs=1e-6)
    assert min(margins) > DYNAMIC[shiko.name]


def test_feet_rise_high_and_come_back_to_where_they_were(shiko: Shiko) -> None:
    before = shiko.soles(shiko.history.q[0])
    for foot, hip in (("left", "left_hip"), ("right", "right_hip")):
        highest = shiko.soles(shiko.history.q[shiko.phase(f"stomp {foot}")[0]])
        rise = highest[foot].translation - before[foot].translation
        assert rise[2] > 0.5 * leg_length(shiko.robot, hip)
        assert abs(rise[1]) > 0.4 * leg_length(shiko.robot, hip)  # to the side
        landed = shiko.soles(shiko.history.q[shiko.phase(f"sink {foot}")[0]])[foot]
        error = before[foot].actInv(landed)
        assert np.linalg.norm(error.translation) < 1e-4
        assert np.linalg.norm(pin.log3(error.rotation)) < 1e-3  # 0.1 mm on 10 cm
    assert len(shiko.history.slip) == 2
    for frame, slip in shiko.history.slip.items():
        assert np.nanmax(slip) < 1e-4, frame


def leg_length(robot: Robot, hip: str) -> float:
    """Length of the straight leg from hip to sole [m]."""
    data, q = robot.model.createData(), robot.postures["neutral"]
    pin.framesForwardKinematics(robot.model, data, q)
    side, names = hip.split("_")[0], list(robot.model.names)
    joint = names.index(next(name for name in names if name.startswith(f"{hip}_pitch")))
    sole = data.oMf[robot.model.getFrameId(f"{side}_sole")]
    return float(data.oMi[joint].translation[2] - sole.translation[2])


def test_it_squats(shiko: Shiko) -> None:
    height = shiko.history.com[:, 2]
    assert height[shiko.phase("squat")[-1]] < 0.78 * height[0]
    knees = [k for k, name in enumerate(shiko.robot.joint_names) if "knee" in name]
    assert (shiko.history.q[shiko.phase("squat")[-1]][7:][knees] > 1.7).all()  # rad


def test_joint_limits_and_accelerations_are_respected(shiko: Shiko) -> None:
    limits, v = shiko.robot.limits, shiko.history.v[:, 6:]
    joints = shiko.history.q[:, 7:]
    assert (joints <= limits.upper + 1e-6).all()
    assert (joints >= limits.lower - 1e-6).all()
    assert (np.abs(v) <= limits.velocity + 1e-6).all()
    # Speeding up is bounded in every tick, also from rest the other way; slowing down is not.
    step = 20.0 * DT  # rad/s
    assert (v[1:] <= np.maximum(v[:-1], 0.0) + step + 1e-6).all()
    assert (v[1:] >= np.minimum(v[:-1], 0.0) - step - 1e-6).all()
    # Where the support changes both are.
    switches = np.flatnonzero(shiko.history.support[1:] != shiko.history.support[:-1])
    assert len(switches) == 4
    assert (np.abs(v[switches + 1] - v[switches]) <= step).all()


def test_the_right_side_is_the_left_in_a_mirror(shiko: Shiko) -> None:
    left, right = shiko.phase("shift right")[0], shiko.phase("shift left")[0]
    length = shiko.phase("sink left")[-1] + 1 - left
    com, q = shiko.history.com, shiko.history.q
    mirrored = com[right : right + length] * [1.0, -1.0, 1.0]
    # The second side begins where the first has left the robot, which is not quite in the middle.
    np.testing.assert_allclose(com[left : left + length], mirrored, atol=1e-3)
    height = {
        foot: np.array(
            [shiko.soles(one)[foot].translation[2] for one in q[first : first + length : 10]]
        )
        for foot, first in (("left", left), ("right", right))
    }
    np.testing.assert_allclose(height["left"], height["right"], atol=1e-3)


def test_the_ellipsoid_changes_visibly(shiko: Shiko) -> None:
    moments = np.array([np.linalg.eigvalsh(matrix) for matrix in inertias(shiko)])
    # Reaction masses M/6 are at +-r_k: r_k^2 = 3/M times the second moment along axis k.
    second = 0.5 * moments.sum(axis=1, keepdims=True) - moments
    radii = np.sqrt(3.0 * second / shiko.robot.mass)
    longest, middle = radii[:, 0], radii[:, 1]
    assert longest.max() > 1.2 * longest.min()
    assert middle.max() > 1.15 * middle.min()
    shape = longest / middle  # from upright and slender to squat and wide
    assert shape.max() > 1.4 * shape.min()


def inertias(shiko: Shiko) -> list[np.ndarray]:
    found = []
    for q in shiko.history.q[::10]:
        pin.ccrba(shiko.robot.model, shiko.data, q, np.zeros(shiko.robot.nv))
        found.append(shiko.data.Ig.inertia.copy())
    return found
