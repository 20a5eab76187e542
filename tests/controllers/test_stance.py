"""Static torques against Pinocchio's gravity and moments in closed form; bad input of torques."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import qpsolvers
from scipy.sparse import csc_matrix

import wbc
from tests.conftest import MIXED
from tests.standing import standing
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.robot import Robot, Snapshot
from wbc.robot.passive import PassiveForces, Spring

Load = Callable[[str], Robot]


@pytest.fixture
def here(g1: Robot) -> Snapshot:
    return standing(g1)


@pytest.mark.parametrize("name", ["g1", "talos", "hoap2_like", "icub", "romeo", "sprung"])
def test_torques_and_forces_balance_gravity(name: str, robot_named: Load) -> None:
    """Oracle: Pinocchio's generalized gravity; forces inside exact cones; springs give -k x."""
    robot = robot_named("hoap2_like" if name == "sprung" else name)
    if name == "sprung":
        knee = {"left_knee_pitch": Spring(8.0, (0.0, 0.0), rest=0.3)}
        robot = replace(robot, passive=PassiveForces(knee))
    here = standing(robot)
    stance = wbc.stance_torques(here, iter(wbc.support(here, "double")))
    assert stance.ok and stance.report() == "can stand"
    model, data = robot.model, robot.model.createData()
    needed = pin.computeGeneralizedGravity(model, data, here.q)
    if name == "sprung":
        knee_entry = robot.joint_index("left_knee_pitch")
        needed[knee_entry] += 8.0 * (here.joint_positions[knee_entry - 6] - 0.3)
    pin.computeJointJacobians(model, data, here.q)
    pin.updateFramePlacements(model, data)
    for frame, wrench in stance.forces.items():
        J = pin.getFrameJacobian(model, data, model.getFrameId(frame), pin.LOCAL_WORLD_ALIGNED)
        needed -= J.T @ wrench
        assert np.hypot(*wrench[:2]) <= 0.6 * wrench[2] + 1e-6 * robot.mass
    size = 9.81 * robot.mass
    # The base's balance is a cost of 1e7 beside torques of 1: it is missed by their ratio.
    np.testing.assert_allclose(needed[:6], 0.0, atol=1e-4 * size)
    np.testing.assert_allclose(needed[6:], stance.torque, atol=1e-9 * size)


def test_joints_that_are_too_weak_are_named(robot_named: Load) -> None:
    robot = Robot.load("g1", effort={"*knee*": 5.0})
    here = standing(robot)
    stance = wbc.stance_torques(here, wbc.support(here, "double"))
    assert not stance.ok and stance.held
    assert set(stance.overloaded) == {"left_knee_joint", "right_knee_joint"}
    needed, most = stance.overloaded["left_knee_joint"]
    assert most == 5.0 and abs(needed) > 5.0
    assert "left_knee_joint needs" in stance.report() and "has 5" in stance.report()
    strong = wbc.stance_torques(here, wbc.support(here, "double"), torque_limits=3.0)
    assert strong.ok


def test_a_com_beyond_the_sole_cannot_be_borne(g1: Robot, here: Snapshot) -> None:
    """At most the weight times the distance from the CoM to the sole is left as a moment."""
    stance = wbc.stance_torques(here, wbc.support(here, "left"))
    assert not stance.held and "no forces of left_sole" in stance.report()
    assert f"and {np.linalg.norm(stance.unheld[3:]):.4g} N m on its base" in stance.report()
    reach = np.linalg.norm(here.com[:2] - here.position("left_sole")[:2])
    assert 0.0 < np.linalg.norm(stance.unheld[3:]) < 9.81 * g1.mass * reach
    floating = wbc.stance_torques(here, ())
    assert np.linalg.norm(floating.unheld[:3]) == pytest.approx(9.81 * g1.mass)


def test_contacts_in_the_air_are_said(g1: Robot, here: Snapshot) -> None:
    contacts = wbc.support(here, "double")
    q = here.q.copy()
    q[2] += 0.05
    there = g1.snapshot(q, np.zeros(g1.nv))
    stance = wbc.stance_torques(there, contacts)
    assert stance.displaced == pytest.approx({"left_sole": 0.05, "right_sole": 0.05})
    assert not stance.ok and "50 mm from its anchor" in stance.report()
    tasks = [wbc.PostureTask(g1, here.q)]
    controller = wbc.TorqueController(g1, tasks, contacts=contacts)
    tick = controller.step(there)
    assert tick.displaced == pytest.approx(stance.displaced)
    assert "'left_sole' is 50 mm from its anchor" in tick.report()
    assert np.isfinite(tick.torque).all()
    assert not controller.step(here).displaced


def test_a_controller_says_at_once_of_contacts_that_are_elsewhere(g1, here, caplog) -> None:
    """At the velocity level the base is commanded there within a tick or two, at 100 m/s."""
    q = here.q.copy()
    q[0] += 1.0
    there, tasks = g1.snapshot(q, np.zeros(g1.nv)), [wbc.PostureTask(g1, here.q)]
    for make in (wbc.KinematicController, wbc.TorqueController):
        make(g1, tasks, contacts=wbc.support(there, "double")).step(there)
        assert not caplog.messages
        make(g1, tasks, contacts=wbc.support(here, "double")).step(there)
        (said,) = caplog.messages
        assert "'left_sole' by 1e+03 mm, 'right_sole' by 1e+03 mm" in said
        caplog.clear()


def test_missing_effort_limits_are_said_by_name(caplog, tmp_path) -> None:
    path = tmp_path / "weak.urdf"
    path.write_text(re.sub('effort="[^"]*"', 'effort="0"', MIXED.read_text()))
    robot = Robot.load(path)
    without = robot.limits.without_effort
    q = robot.postures["neutral"]
    assert without
    with caplog.at_level(logging.WARNING):
        wbc.TorqueController(robot, [wbc.PostureTask(robot, q)], contacts=())
    assert ", ".join(without) in caplog.text
    assert f"effort={{'{without[0]}': N m}}" in caplog.text
    caplog.clear()
    wbc.TorqueController(robot, [wbc.PostureTask(robot, q)], contacts=(), torque_limits=None)
    assert not caplog.text


def test_a_robot_without_feet_is_told_so() -> None:
    robot = Robot.load(MIXED)
    here = robot.snapshot(robot.postures["neutral"])
    assert not robot.feet
    with pytest.raises((UnknownNameError, InvalidInputError), match=r"f(oo|ee)t"):
        wbc.support(here, "double")


def other_solvers_stance(here: Snapshot, most: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return torques, and torques beyond ``most``, of the documented costs by another solver.

    Unknowns: forces at the corners by the weight, and the excess. Rows are written out corner by
    corner, in the world's axes, from Pinocchio's point Jacobians.
    """
    robot = here.robot
    model, data = robot.model, robot.model.createData()
    weight = 9.81 * robot.mass
    gravity = pin.computeGeneralizedGravity(model, data, here.q) / weight
    pin.computeJointJacobians(model, data, here.q)
    pin.updateFramePlacements(model, data)
    columns, normals, cones = [], [], []
    for foot in robot.feet.values():
        frame = robot.frame_id(foot.frame)
        R = data.oMf[frame].rotation
        J = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
        for corner in foot.polygon:
            arm = R @ np.append(corner, 0.0)
            columns.append((J[:3] - pin.skew(arm) @ J[3:]).T @ R)
            normals.append([0.0, 0.0, 1.0])
            slope = 0.6 * np.cos(np.pi / 4)
            cones.append([[1, 0, -slope], [0, 1, -slope], [-1, 0, -slope], [0, -1, -slope]])
    by_force, count, n = np.hstack(columns), len(normals), robot.nv - 6
    k = 3 * count
    G = np.zeros((5 * count + 2 * n, k + n))
    for c, cone in enumerate(cones):
        G[4 * c : 4 * c + 4, 3 * c : 3 * c + 3] = cone
        G[4 * count + c, 3 * c + 2] = -1.0
    below = slice(5 * count, 5 * count + n)
    G[below, :k], G[below, k:] = -by_force[6:], -np.eye(n)
    G[5 * count + n :] = -G[below]
    h = np.concatenate(
        (np.zeros(5 * count), most / weight - gravity[6:], most / weight + gravity[6:])
    )
    base, joints = by_force[:6], by_force[6:]
    # A thousand times the costs; the base's, a million times that of torques, as equalities.
    P = np.zeros((k + n, k + n))
    P[:k, :k] = joints.T @ joints + 1e-3 * np.eye(k)
    P[k:, k:] = 1e6 * np.eye(n)
    g = np.concatenate((-joints.T @ gravity[6:], np.zeros(n)))
    A = csc_matrix(np.hstack((base, np.zeros((6, n)))))
    problem = csc_matrix(P), g, csc_matrix(G), h, A, gravity[:6]
    x = qpsolvers.solve_qp(*problem, solver="clarabel", tol_gap_abs=1e-12, tol_gap_rel=1e-12)
    return weight * (gravity[6:] - joints @ x[:k]), weight * x[k:]


@pytest.mark.parametrize("effort", [1e4, 8.0])
def test_torques_are_the_least_and_exceed_the_limits_least(robot_named, effort) -> None:
    """With limits out of the way, and with limits that some joints must exceed."""
    robot = Robot.load("g1", effort={"*": effort})
    here = standing(robot)
    stance = wbc.stance_torques(here, wbc.support(here, "double"))
    expected, beyond = other_solvers_stance(here, np.full(robot.nv - 6, effort))
    np.testing.assert_allclose(stance.torque, expected, rtol=0, atol=3e-2)
    lacking = set(np.flatnonzero(np.abs(beyond) > 0.05))
    assert {robot.joint_names[k] for k in lacking} == set(stance.overloaded)
    assert bool(lacking) == (effort < 10.0)


def test_what_is_beyond_a_limit_by_rounding_is_not(g1: Robot, here: Snapshot) -> None:
    """A thousandth of a limit, and a millionth of the weight at a metre: by hand."""
    stance = wbc.stance_torques(here, wbc.support(here, "double"))
    n, weight = g1.nv - 6, g1.weight
    for most, over, said in ((50.0, 1.0009, False), (50.0, 1.0011, True), (0.0, 0.0, False)):
        torque = np.zeros(n)
        torque[3] = -over * most
        found = replace(stance, torque=torque, most=np.full(n, most)).overloaded
        assert found == ({g1.joint_names[3]: (-over * most, most)} if said else {})
    for by, said in ((0.9e-6, False), (1.1e-6, True)):
        torque = np.full(n, by * weight)
        assert bool(replace(stance, torque=torque, most=np.zeros(n)).overloaded) is said
    for by, held in ((0.9e-3, True), (1.1e-3, False)):
        assert replace(stance, unheld=np.array([0, 0, 0, 0, -by * weight, 0])).held is held
    words = replace(stance, unheld=np.array([3.0, 0, 4.0, 0, 12.0, 5.0]) * weight).report()
    assert f"{5 * weight:.4g} N and {13 * weight:.4g} N m" in words
    assert "left_sole, right_sole" in words


def test_gears_bear_by_no_motor_of_their_own(geared: Robot) -> None:
    """The follower's torque is carried by its driver: virtual work over the gear's motion."""
    q = geared.postures["neutral"]
    here = geared.snapshot(q)
    stance = wbc.stance_torques(here, ())
    gravity = pin.computeGeneralizedGravity(geared.model, geared.model.createData(), q)
    name = next(iter(geared.couplings))
    follower, driver = (
        geared.joint_index(one) - 6 for one in (name, geared.couplings[name].driver)
    )
    assert stance.most[follower] == 0.0
    work = gravity[6 + driver] + geared.couplings[name].ratio * gravity[6 + follower]
    # What is beyond a limit costs 1e5 times as much as torque: that part of it is left.
    assert stance.torque[follower] == pytest.approx(0.0, abs=2e-3 * abs(work))
    assert stance.torque[driver] == pytest.approx(work, rel=2e-3)
    others = np.delete(np.arange(geared.nv - 6), (follower, driver))
    np.testing.assert_allclose(stance.torque[others], gravity[6 + others], atol=1e-3)


def test_limits_that_bind_are_kept_and_the_rest_is_the_least() -> None:
    """A weak knee: the other leg takes its load; by the other solver again."""
    weak = 9.0
    robot = Robot.load("g1", effort={"*": 1e4, "left_knee*": weak})
    here = standing(robot)
    contacts = wbc.support(here, "double")
    free = wbc.stance_torques(here, contacts, torque_limits=100.0)
    stance = wbc.stance_torques(here, contacts)
    knee = robot.joint_names.index("left_knee_joint")
    assert abs(free.torque[knee]) > weak + 1.0 and stance.ok
    assert abs(stance.torque[knee]) == pytest.approx(weak, abs=1e-3)
    expected, _ = other_solvers_stance(here, np.asarray(stance.most))
    np.testing.assert_allclose(stance.torque, expected, rtol=0, atol=2e-3)
