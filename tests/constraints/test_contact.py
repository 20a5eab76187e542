"""Contacts on one link: rows that follow from others are left out, and nothing else."""

import numpy as np
import pytest

from tests.standing import commanded
from wbc.constraints import (
    ComSupport,
    Contact,
    FrictionCone,
    Limits,
    PointContact,
    TiltLimit,
    support,
)
from wbc.constraints.independent_rows import independent_rows
from wbc.controllers import KinematicController
from wbc.errors import InvalidInputError
from wbc.robot import Robot, Snapshot
from wbc.tasks import ComTask, PostureTask

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
