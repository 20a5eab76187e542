"""The paper's independent coordinates and step; contacts on one link lose only what follows.

Oracle: eqs. 30-37 by Pinocchio's body Jacobians and adjoints on fresh data, twists linear first,
and NumPy's pseudo-inverse of the reduced Jacobian.
"""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.conftest import random_state
from tests.constraints.test_mechanics import arm
from tests.standing import commanded
from wbc.constraints import (
    ComSupport,
    Contact,
    FrictionCone,
    IndependentCoordinates,
    Limits,
    PointContact,
    TiltLimit,
    support,
)
from wbc.constraints.independent_rows import independent_rows
from wbc.controllers import KinematicController
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.robot import Robot, Snapshot
from wbc.tasks import ComTask, InertiaTask, PostureTask

HUMANOIDS = ("hoap2_like", "g1_27", "talos")
# Inverses of matrices whose condition is some thousand, and 1e-16 of rounding.
EXACT = 1e-9


def near(robot: Robot, posture: str, rng: np.random.Generator, size: float = 0.05) -> Snapshot:
    step = size * rng.normal(size=robot.nv)
    return robot.snapshot(robot.integrate(robot.postures[posture], step, 1.0))


def star(here: Snapshot, side: str) -> np.ndarray:
    """J_f* (6, nv - 6) = Ad_{G_f} J_f: body Jacobian of the foot by the joints, at the base."""
    robot = here.robot
    model, data = robot.model, robot.model.createData()
    frame = robot.frame_id(robot.feet[side].frame)
    pin.computeJointJacobians(model, data, here.q)
    pin.updateFramePlacements(model, data)
    body = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL)
    return (data.oMi[1].actInv(data.oMf[frame])).action @ body[:, 6:]


def leg(robot: Robot, side: str) -> list[int]:
    """Places in v of the joints that move this foot alone: a waist between them is of q_t."""
    moved = [
        {
            6 + int(k)
            for k in np.flatnonzero(np.abs(star(robot.snapshot(robot.posture()), s)).sum(0))
        }
        for s in (side, {"left": "right", "right": "left"}[side])
    ]
    return sorted(moved[0] - moved[1])


def of_paper(here: Snapshot, J: np.ndarray, mode: str) -> tuple[list[int], np.ndarray, np.ndarray]:
    """Independent places in v, J by them (30, 34, 36), and v by them (33 and J_l* q_l = J_r* q_r).

    Columns of J are J_0, J_q; of eqs. 34 and 36 they are in the order of v here.
    """
    nv, J_0, J_q = here.robot.nv, J[:, :6], J[:, 6:]
    if mode == "floating":
        return list(range(nv)), J, np.eye(nv)
    if mode in ("left", "right"):
        return (
            list(range(6, nv)),
            J_q - J_0 @ star(here, mode),
            np.concatenate((-star(here, mode), np.eye(nv - 6))),
        )
    l_star, r_star = star(here, "left"), star(here, "right")
    right = [k - 6 for k in leg(here.robot, "right")]
    kept = [k for k in range(nv - 6) if k not in right]
    # A waist between base and legs moves both feet alike.
    follows = np.linalg.inv(r_star[:, right]) @ (l_star - r_star)[:, kept]
    v = np.zeros((nv, len(kept)))
    v[:6] = -l_star[:, kept]
    v[[6 + k for k in right]] = follows
    v[[6 + k for k in kept], np.arange(len(kept))] = 1.0
    reduced = J_q[:, kept] + J_q[:, right] @ follows - J_0 @ l_star[:, kept]
    return [6 + k for k in kept], reduced, v


@pytest.mark.parametrize("mode", ["floating", "left", "right", "double"])
@pytest.mark.parametrize("name", HUMANOIDS)
def test_jacobian_and_step_are_eqs_30_to_38(name: str, mode: str, robot_named, rng) -> None:
    robot = robot_named(name)
    for _ in range(3):
        here = near(robot, "standing", rng)
        task = InertiaTask(robot, near(robot, "standing", rng).inertia)
        residual = task.residual(here)
        independent, reduced, back = of_paper(here, residual.jacobian, mode)
        found = IndependentCoordinates.of(here, mode)
        assert found.independent.tolist() == independent
        size = np.abs(residual.jacobian).max()
        np.testing.assert_allclose(found.jacobian(residual.jacobian), reduced, atol=EXACT * size)
        np.testing.assert_allclose(found.basis, back, atol=EXACT * np.abs(back).max())
        expected = back @ (np.linalg.pinv(reduced) @ -residual.error)
        step = found.step(residual.jacobian, -residual.error)
        # By the condition of the reduced Jacobian once more.
        np.testing.assert_allclose(step, expected, atol=1e-7 * np.abs(expected).max())


@pytest.mark.parametrize("mode", ["left", "double"])
@pytest.mark.parametrize("name", HUMANOIDS)
def test_a_damped_step_is_the_damped_pseudo_inverse(name: str, mode: str, robot_named, rng) -> None:
    robot = robot_named(name)
    here = near(robot, "standing", rng)
    J, change = here.inertia_jacobian, rng.normal(size=6)
    _, reduced, back = of_paper(here, J, mode)
    inverse = reduced.T @ np.linalg.inv(reduced @ reduced.T + 0.01 * np.eye(6))
    expected = back @ inverse @ change
    step = IndependentCoordinates.of(here, mode).step(J, change, damping=0.01)
    np.testing.assert_allclose(step, expected, atol=EXACT * np.abs(expected).max())


@pytest.mark.parametrize("name", HUMANOIDS)
def test_straight_knees_leave_a_step_that_holds_the_feet(name: str, robot_named, rng) -> None:
    """J_r* has no inverse there (asserted); the feet still stand, and the step is least.

    Oracles: rank and null space by the SVD of the contacts' Jacobian, Pinocchio's by ``support``.
    """
    robot = robot_named(name)
    here = robot.snapshot(robot.postures["neutral"])
    singular = star(here, "right")[:, [k - 6 for k in leg(robot, "right")]]
    assert np.linalg.cond(singular) > 1e6  # files round angles to 1e-6
    A = np.concatenate([one.residual(here).jacobian for one in support(here, "double")])
    found = IndependentCoordinates.of(here, "double")
    rank = np.linalg.matrix_rank(A, tol=1e-5)
    assert found.independent.size == robot.nv - rank == len(found.names)
    assert np.abs(found.basis).max() < 100.0
    np.testing.assert_allclose(A @ found.basis, 0.0, atol=1e-12)
    joints = set(range(6, robot.nv)) - set(found.independent.tolist())
    right = set(leg(robot, "right"))
    assert len(joints & right) == np.linalg.matrix_rank(singular, tol=1e-5)
    task = InertiaTask(robot, here.inertia * 1.05)
    residual = task.residual(here)
    step = found.step(residual.jacobian, -residual.error)
    np.testing.assert_allclose(residual.jacobian @ step, -residual.error, atol=1e-10)
    # No motion that the feet and the goal leave free makes the independent part shorter.
    free = np.linalg.svd(np.concatenate((A, residual.jacobian)))[2]
    free = free[np.linalg.matrix_rank(np.concatenate((A, residual.jacobian)), tol=1e-8) :].T
    kept = found.independent
    np.testing.assert_allclose(free[kept].T @ step[kept], 0.0, atol=1e-8 * np.abs(step).max())


@pytest.mark.parametrize("mode", ["left", "double"])
@pytest.mark.parametrize("name", HUMANOIDS)
def test_the_solver_pseudo_inverse_is_another_step(name: str, mode: str, robot_named, rng) -> None:
    """It makes least the norm of all of v, the base's metres and radians among them.

    Oracle: the null space of the contacts by SVD, and NumPy's pseudo-inverse. Weights of the joints
    that all but leave the dependent ones out bring it to the paper's.
    """
    robot = robot_named(name)
    here = near(robot, "standing", rng, size=0.01)
    task = InertiaTask(robot, here.inertia * 1.02, gain=1.0, curvature_damping=False)
    residual = task.residual(here)
    J, change, contacts = residual.jacobian, -residual.error, support(here, mode)
    A = np.concatenate([one.residual(here).jacobian for one in contacts])
    null = np.linalg.svd(A)[2][np.linalg.matrix_rank(A, tol=1e-8) :].T
    damping = 1e-8 * np.linalg.norm(J, 2) ** 2  # far above the rounding of J'J in the QP
    free = J @ null
    of_all = null @ free.T @ np.linalg.solve(free @ free.T + damping * np.eye(6), change)
    own = IndependentCoordinates.of(here, mode)
    paper = own.step(J, change, damping)
    same = {"contacts": contacts, "dt": 1.0, "solver": "pseudo_inverse"}
    found = KinematicController(robot, [task], damping=damping, **same).step(here).velocity
    # The condition of J'J + damping is 1e8.
    np.testing.assert_allclose(found, of_all, atol=1e-6 * np.abs(of_all).max())
    assert np.linalg.norm(of_all - paper) > 0.03 * np.linalg.norm(paper)
    assert np.linalg.norm(of_all) < np.linalg.norm(paper)
    kept = own.independent
    assert np.linalg.norm(of_all[kept]) > np.linalg.norm(paper[kept])
    weights = np.full(robot.nv, 1e-4)
    weights[kept] = 1.0
    near_paper = KinematicController(robot, [task], damping=damping, joint_weights=weights, **same)
    off = near_paper.step(here).velocity - paper
    assert np.abs(off).max() < 5e-3 * np.abs(paper).max()


def test_mimic_joints_follow_and_a_fixed_base_stays(tmp_path: Path) -> None:
    """c = -2 b + 0.1 and d = 0.5 c are no coordinates of their own, nor is a bolted base."""
    robot = Robot.load(arm(tmp_path))
    found = IndependentCoordinates.of(robot.snapshot(robot.posture()))
    assert robot.fixed_base and found.names == ("a", "b")
    expected = np.zeros((robot.nv, 2))
    expected[6:] = [[1, 0], [0, 1], [0, -2], [0, -1]]
    np.testing.assert_allclose(found.basis, expected, atol=1e-12)


def test_bad_input_is_named(hoap2, rng) -> None:
    here = hoap2.snapshot(random_state(hoap2, rng)[0])
    with pytest.raises(UnknownNameError, match="duoble"):
        IndependentCoordinates.of(here, "duoble")
    with pytest.raises(InvalidInputError, match="tolerance"):
        IndependentCoordinates.of(here, "double", tolerance=1.0)
    own = IndependentCoordinates.of(here, ["left_sole"])
    assert isinstance(Contact.hold(here, "left_sole"), Contact) and len(own.names) == hoap2.nv - 6
    for rows, change, damping, what in (
        (np.ones((2, 3)), [1, 1], 0.0, "rows"),
        (np.ones(hoap2.nv), [1], 0.0, "rows"),
        (np.zeros((0, hoap2.nv)), [], 0.0, "rows"),
        (1.0, [1], 0.0, "rows"),
        (np.ones((2, hoap2.nv)), [1, np.nan], 0.0, "change"),
        (np.ones((2, hoap2.nv)), [1, 1], -1.0, "damping"),
    ):
        with pytest.raises(InvalidInputError, match=f"independent coordinates, {what}"):
            own.step(rows, change, damping)


CASES = {  # frames held rigidly, frames held as points, rows that remain
    "toe and heel": (("left_toe", "left_heel"), (), 6),
    "sole and toe": (("left_sole",), ("left_toe",), 6),
    "toe and heel as points": ((), ("left_toe", "left_heel"), 5),
    "points on a line": ((), ("left_toe", "left_heel", "left_sole"), 5),
    "three points": ((), ("left_toe", "left_heel", "left_ball"), 6),
    "both feet": (("right_sole", "left_sole"), ("left_toe",), 12),
    "one contact": (("left_sole",), (), 6),
    "nothing": ((), (), 0),
}


FIXED = """<link name="{name}"/><joint name="{name}_joint" type="fixed"><parent link="{parent}"/>
<child link="{name}"/><origin xyz="{xyz}" rpy="0 0 0"/></joint>"""
POINTS = {"left_toe": "0.05 0 0", "left_heel": "-0.04 0 0", "left_ball": "0.02 0.03 0"}


@pytest.fixture
def here(hoap2, tmp_path) -> Snapshot:
    """A humanoid with more frames on its left foot, turned and leaning."""
    added = "".join(FIXED.format(name=n, parent="left_sole", xyz=p) for n, p in POINTS.items())
    path = tmp_path / "more_frames.urdf"
    path.write_text(hoap2.path.read_text().replace("</robot>", added + "</robot>"))
    robot = Robot.load(path)
    rng = np.random.default_rng(3)
    step = np.concatenate((rng.normal(size=6), 0.2 * rng.normal(size=robot.nv - 6)))
    return robot.snapshot(robot.integrate(robot.posture(), step, 1.0))


def contacts_of(here: Snapshot, case: str) -> list[Contact]:
    frames, points, _ = CASES[case]
    held = [Contact.hold(here, frame) for frame in frames]
    return held + [PointContact.hold(here, frame) for frame in points]


@pytest.mark.parametrize("case", CASES)
def test_rows_that_remain_are_independent_and_span_all(here, case) -> None:
    contacts = contacts_of(here, case)
    held = independent_rows(contacts)
    none = np.zeros((0, here.robot.nv))
    every = [c.residual(here).jacobian for c in held.contacts]
    kept = [J if k is None else J[k] for J, k in zip(every, held.row_selections, strict=True)]
    left = np.concatenate([none, *kept])
    everything = np.concatenate([none, *(c.residual(here).jacobian for c in contacts)])
    assert len(left) == len(held.labels) == CASES[case][2]
    # The oracle is the rank of the frames' Jacobians, from Pinocchio; 1e-8: rounding is 1e-15.
    assert np.linalg.matrix_rank(left, tol=1e-8) == len(left)
    assert np.linalg.matrix_rank(everything, tol=1e-8) == len(left)


@pytest.mark.parametrize("solver", ["proxqp", "daqp"])
@pytest.mark.parametrize("case", ["toe and heel", "sole and toe", "three points", "both feet"])
def test_every_solver_holds_a_foot_by_several_frames(here, case, solver) -> None:
    """Before rows were left out, daqp called these contradictory as soon as the foot drifted."""
    robot, contacts = here.robot, contacts_of(here, case)
    tasks = [
        ComTask(robot, here.com + [0.03, 0.05, -0.03], weight=5.0),
        PostureTask(robot, robot.posture(), weight=0.5, gain=0.3),
    ]
    controller = KinematicController(
        robot, tasks, contacts=contacts, limits=Limits(robot), solver=solver
    )
    *_, (tick, q) = commanded(controller, here.q, 60)
    assert np.abs(tick.velocity).max() > 1e-3  # it did move
    end = robot.snapshot(q)
    # Second order of a tick, taken back by half each tick; also of the frames left out.
    assert max(contact.slip(end) for contact in contacts) < 1e-4


def test_what_is_left_out_changes_nothing(here) -> None:
    robot = here.robot
    tasks = [ComTask(robot, here.com + [0.01, 0.0, -0.01]), PostureTask(robot, here.q, weight=0.1)]
    velocities = [
        KinematicController(robot, tasks, contacts=contacts).step(here).velocity
        for contacts in (support(here, ["left_sole"]), contacts_of(here, "sole and toe"))
    ]
    # At the anchors the rows left out say nothing more: the same QP, to the solver's accuracy.
    np.testing.assert_allclose(velocities[0], velocities[1], atol=1e-6)


@pytest.mark.parametrize("case", ["toe and heel", "sole and toe", "toe and heel as points"])
def test_one_link_in_two_places_is_still_a_contradiction(here, case) -> None:
    """Only what drift explains is passed over: anchors 2 cm off keep all their rows."""
    contacts = contacts_of(here, case)
    along = contacts[1].position - contacts[0].position
    moved = contacts[1].position + 0.02 * along / np.linalg.norm(along)
    contacts[1] = type(contacts[1])(here.robot, contacts[1].frame, moved, contacts[1].rotation)
    contacts.append(contacts_of(here, "three points")[2])  # a third one, which agrees with one
    held = independent_rows(contacts)
    assert len(held.labels) == sum(len(contact.rows) for contact in contacts)
    tick = KinematicController(here.robot, [ComTask(here.robot, here.com)], contacts=contacts).step(
        here
    )
    assert not tick.ok
    assert contacts[1].frame in tick.report()


def test_corners_are_given_once(here) -> None:
    """Their forces are unknowns of the QP: others came to nothing, without a word."""
    contact = Contact.hold(here, "left_sole")
    with pytest.raises(InvalidInputError, match=r"corners: cannot be assigned; .* set_contacts"):
        contact.corners = [[0.0, 0.0], [0.01, 0.0], [0.0, 0.01]]
    assert len(contact.corners) == len(here.robot.feet["left"].polygon)


def test_friction_of_a_held_base_is_refused(here) -> None:
    """It was dropped, without a word."""
    contact = Contact.hold(here, "base")
    assert contact.friction is None
    with pytest.raises(InvalidInputError, match=r"friction: what holds the base also pulls"):
        Contact.hold(here, "base", friction=FrictionCone(0.5))
    with pytest.raises(InvalidInputError, match=r"friction: what holds the base also pulls"):
        contact.friction = FrictionCone(0.5)


def test_what_is_no_snapshot_is_named(here) -> None:
    robot = here.robot
    for make in (
        lambda: support(robot, "double"),
        lambda: Contact.hold(robot, "left_sole"),
        lambda: ComSupport.over(robot),
        lambda: TiltLimit.upright(robot.posture(), "base", 0.5),
    ):
        with pytest.raises(InvalidInputError, match=r"expected a snapshot of a robot, as robot\."):
            make()


def test_soles_that_face_upwards_are_warned_of(here, caplog: pytest.LogCaptureFixture) -> None:
    """A quaternion in the order w, x, y, z stands the robot on its head, and nothing said so."""
    robot = here.robot
    q = robot.posture()
    support(robot.snapshot(q), "double")
    assert not caplog.records
    q[3:7] = q[[6, 3, 4, 5]]
    support(robot.snapshot(q), "double")
    assert "face upwards" in caplog.text
    assert "x, y, z, w?" in caplog.text
