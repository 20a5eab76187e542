"""Projection onto the hard constraints of all frames, and the violations that remain."""

from itertools import pairwise

import coal
import numpy as np
import pinocchio as pin
import pytest

import wbc
from tests.retargeting.humans import trajectory_problem
from wbc.retargeting.constraint_projection import project_onto_constraints, update_footprints
from wbc.retargeting.pipeline import evaluate
from wbc.retargeting.robot_setup import robot_setup
from wbc.robot import Robot
from wbc.robot.collision.bodies import named_shapes
from wbc.validate import Array


def disturbed(motion: wbc.Retargeted, joint: str, by: float, first: int, end: int) -> Array:
    """Return the configurations with a joint turned [rad] in some frames."""
    robot, q = motion.robot, motion.q.copy()
    d = np.zeros(robot.nv)
    d[6 + robot.joint_names.index(joint)] = by
    for k in range(first, end):
        q[k] = robot.integrate(q[k], d, 1.0)
    return q


def joint_ratios(robot: Robot, q: Array, dt: float) -> tuple[float, float, float]:
    """Return the violation of limits [rad], and speeds and accelerations by the joints' own."""
    joints = q[:, 7:]
    steps = np.array([pin.difference(robot.model, a, b) for a, b in pairwise(q)])
    limits = robot.limits
    mass = np.abs(robot.snapshot(robot.postures["standing"]).mass_matrix[6:, 6:])
    max_accelerations = (limits.effort[:, None] / np.maximum(mass, 1e-12)).min(axis=0)
    past = np.maximum(limits.lower - joints, joints - limits.upper).max()
    speed = (np.abs(steps[:, 6:]) / dt / limits.velocity).max()
    return past, speed, (np.abs(np.diff(steps[:, 6:], axis=0)) / dt**2 / max_accelerations).max()


def sole_displacement(motion: wbc.Retargeted, q: Array) -> float:
    """Return how far a level sole moves at most while it stands [m], by Pinocchio."""
    data, worst = motion.robot.model.createData(), 0.0
    for number, foot in enumerate(motion.robot.feet.values()):
        frame = motion.robot.model.getFrameId(foot.frame)
        where: list[Array] = []
        for k, one in enumerate(q):
            if not motion.contacts[k, number]:
                where = []
                continue
            pin.framesForwardKinematics(motion.robot.model, data, one)
            where.append(data.oMf[frame].translation.copy())
            worst = max(worst, float(np.linalg.norm(where[-1] - where[0])))
    return worst


def margins_kept(robot: Robot, q: Array) -> bool:
    """Whether bodies keep their margins in all frames by the files' shapes, measured by Coal."""
    collision = wbc.SelfCollision(robot, margin=0.01, pairs=10_000)
    model, data = robot.collision_model, robot.model.createData()
    placed = pin.GeometryData(model)
    index = {name: model.getGeometryId(shape.name) for name, _, shape in named_shapes(robot)}
    for one in q:
        clearance = collision.distances(robot.snapshot(one)).clearance
        pin.updateGeometryPlacements(robot.model, data, model, placed, one)
        for k in np.flatnonzero(clearance < 0.0):  # fitted shapes contain those of the files
            solids: list[object] = []
            for name in collision.model.labels[k].split(" vs "):
                number = index[name.partition("/")[0]]
                T = placed.oMg[number]
                solids += [model.geometryObjects[number].geometry]
                solids += [coal.Transform3s(T.rotation, T.translation)]
            distance = coal.distance(*solids, coal.DistanceRequest(), coal.DistanceResult())
            if distance < collision.margins[k] - 1e-6:
                return False
    return True


@pytest.mark.parametrize(
    ("joint", "by"),
    [
        ("left_knee", 0.1),
        ("right_hip_yaw", 0.2),
        ("left_shoulder_pitch", 0.15),
        ("right_hip_roll", -0.1),  # 4 mm off after 14 iterations
    ],
)
def test_disturbed_motion_is_feasible_after_projection(step, joint, by) -> None:
    robot, dt = step.robot, step.targets.dt
    (name,) = (one for one in robot.joint_names if one.startswith(joint))
    q = disturbed(step, name, by, 12, 15)
    ratios = joint_ratios(robot, q, dt)[1:]
    assert max(*ratios, 1e3 * sole_displacement(step, q)) > 1.0  # joints too fast, or a sole moves
    found = project_onto_constraints(trajectory_problem(step), q)
    assert found.feasible
    past, speed, force = joint_ratios(robot, found.q, dt)
    assert past <= 1e-9 and speed <= 1.0 + 1e-9 and force <= 1.0 + 1e-9
    assert sole_displacement(step, found.q) < 1e-3
    assert margins_kept(robot, found.q)


def lowest(robot: Robot, q: Array) -> float:
    """Return how high a corner of a sole is at least [m], by Pinocchio."""
    data, found = robot.model.createData(), []
    for one in q:
        pin.framesForwardKinematics(robot.model, data, one)
        for foot in robot.feet.values():
            flat = np.column_stack((foot.polygon, np.zeros(len(foot.polygon))))
            placed = data.oMf[robot.model.getFrameId(foot.frame)]
            found.append((placed.translation + flat @ placed.rotation.T)[:, 2].min())
    return float(min(found))


@pytest.mark.parametrize("by", [0.5, -0.5])
def test_swinging_soles_in_the_ground_are_lifted_out_of_it(step: wbc.Retargeted, by: float) -> None:
    """In a run a G1's were up to 66 mm below it."""
    robot, air = step.robot, np.flatnonzero(~step.contacts[:, 0])
    q = disturbed(step, "left_ankle_pitch", by, air[2], air[-2])
    assert lowest(robot, q) < -5e-3
    found = project_onto_constraints(trajectory_problem(step), q)
    assert found.feasible and lowest(robot, found.q) > -1e-3


def test_footprints_of_a_displaced_robot_are_updated(step: wbc.Retargeted) -> None:
    """Footprints, corners and paths move with the whole robot."""
    turn, move = 0.2, np.array((0.03, -0.02, 0.0))
    R = np.array(((np.cos(turn), -np.sin(turn)), (np.sin(turn), np.cos(turn))))
    T = pin.SE3(pin.AngleAxis(turn, np.array((0.0, 0.0, 1.0))).matrix(), move)
    q = np.array([np.concatenate((pin.SE3ToXYZQUAT(T * pin.XYZQUATToSE3(one[:7])), one[7:]))
                  for one in step.q])  # fmt: skip
    feet, notes = update_footprints(step.targets.feet, step.robot, q, step.time)
    for before, after in zip(step.targets.feet.prints, feet.prints, strict=True):
        np.testing.assert_allclose(after.pose[:2], R @ before.pose[:2] + move[:2], atol=2e-3)
        assert after.pose[2] == pytest.approx(before.pose[2] + turn, abs=2e-3)
    for side, down in zip(("left", "right"), step.contacts.T, strict=True):
        old, new = step.targets.feet.paths[side], feet.paths[side]
        corners = old.corners[down][..., :2] @ R.T + move[:2]
        np.testing.assert_allclose(new.corners[down][..., :2], corners, atol=2e-3)
    assert len(notes) == len(feet.prints) and "0.00 to " in notes[0]


def test_violations_tell_size_time_and_place(step: wbc.Retargeted) -> None:
    robot = step.robot
    assert step.broken == ()
    (knee,) = (name for name in robot.joint_names if name.startswith("left_knee"))
    column = 7 + robot.joint_names.index(knee)
    q = step.q.copy()
    q[20:23, column] = robot.limits.upper[robot.joint_names.index(knee)] + 0.05
    setup = robot_setup(robot, None, 0.01)
    found = evaluate(robot, setup, "", step.scale, step.targets, q, 0.6, ())
    by = {one.what: one for one in found.broken if one.where == knee}
    passed = by["joint limit passed"]
    assert passed.by == pytest.approx(0.05, abs=1e-9)
    assert (passed.start, passed.end) == pytest.approx((step.time[20], step.time[22]))
    dt = step.targets.dt
    # Central differences of the joint, as everyone takes them.
    rate = np.gradient(q[:, column], dt)
    fastest = robot.limits.velocity[robot.joint_names.index(knee)]
    assert by["speed above the limit"].by == pytest.approx(np.abs(rate).max() / fastest - 1.0)
    assert "acceleration above the motor's" in by
    slides = [one for one in found.broken if one.what == "sole slides"]
    assert slides and slides[0].where == "left foot" and "mm" in str(slides[0])
