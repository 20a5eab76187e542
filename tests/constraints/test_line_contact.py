"""Contacts along a line: what they hold, where their forces act, and when feet make them."""

import casadi as ca
import numpy as np
import pytest

from wbc.constraints import Contact, Limits, LineContact, PointContact, support
from wbc.constraints.independent_rows import independent_rows
from wbc.controllers.torque import TorqueController
from wbc.errors import InvalidInputError
from wbc.problem.support import ContactSpec, contacts_of
from wbc.robot import Robot, Snapshot
from wbc.robot.symbolic import SymbolicPosture
from wbc.tasks import ComTask, PostureTask
from wbc.validate import Array

ENDS = np.array(((-0.04, -0.02, 0.0), (0.06, 0.03, 0.0)))  # on a line through the sole's origin


@pytest.fixture
def here(hoap2: Robot) -> Snapshot:
    """A humanoid turned, leaning and moving."""
    robot, rng = hoap2, np.random.default_rng(4)
    step = np.concatenate((rng.normal(size=6), 0.2 * rng.normal(size=robot.nv - 6)))
    q = robot.integrate(robot.posture(), step, 1.0)
    return robot.snapshot(q, rng.normal(size=robot.nv))


def end_rows(here: Snapshot, frame: str, ends: Array) -> Array:
    """Return the Jacobians (6, nv) of two points fixed to a frame, by Pinocchio's of the frame."""
    J, R = here.jacobian(frame), here.rotation(frame)
    arms = ends @ R.T
    return np.concatenate([J[:3] + np.cross(J[3:], arm, axis=0) for arm in arms])


def test_its_rows_hold_the_ends_of_the_line_and_nothing_else(here: Snapshot) -> None:
    contact = LineContact.hold(here, "left_sole", corners=ENDS)
    J, ends = contact.residual(here).jacobian, end_rows(here, "left_sole", ENDS)
    assert np.linalg.matrix_rank(J, tol=1e-8) == np.linalg.matrix_rank(ends, tol=1e-8) == 5
    both = np.concatenate((J, ends))
    assert np.linalg.matrix_rank(both, tol=1e-8) == 5  # rounding is 1e-15


def test_its_drift_is_the_rate_of_its_rows(here: Snapshot) -> None:
    robot, v, h = here.robot, here.v, 1e-6
    contact = LineContact.hold(here, "left_sole", corners=ENDS)

    def rate(time: float) -> Array:
        there = robot.snapshot(robot.integrate(here.q, v, time), v)
        return contact.residual(there).jacobian @ v

    expected = (rate(h) - rate(-h)) / (2.0 * h)
    # central differences: h^2 and rounding over h, of numbers of 10
    np.testing.assert_allclose(contact.drift(here), expected, atol=1e-6)


def test_what_turns_about_the_line_is_no_error(here: Snapshot) -> None:
    robot = here.robot
    contact = LineContact.hold(here, "left_sole", corners=ENDS)
    J = here.jacobian("left_sole")
    line = here.rotation("left_sole") @ (ENDS[1] - ENDS[0])
    about, across = (
        np.linalg.lstsq(J, np.concatenate((np.zeros(3), way)), rcond=None)[0]
        for way in (line, np.cross(line, here.rotation("left_sole")[:, 2]))
    )
    for way, least, most in ((about, 0.0, 1e-4), (across, 0.9, 1.1)):
        step = 0.02 / np.linalg.norm(J[3:] @ way) * way
        turned = robot.snapshot(robot.integrate(here.q, step, 1.0))
        error = contact.residual(turned).error
        # of second order in 0.02 rad
        assert 0.02 * least - 1e-4 <= np.linalg.norm(error[3:]) <= 0.02 * most + 1e-4
        q = ca.SX.sym("q", robot.nq)
        symbolic = contact.symbolic_error(SymbolicPosture.at(robot, q))
        found = np.array(ca.Function("error", [q], [symbolic])(turned.q)).ravel()
        np.testing.assert_allclose(found, error, atol=1e-3 * 0.02)  # in the target's axes


@pytest.mark.parametrize("points", [(), ("left_sole",)])
def test_rows_that_follow_from_others_are_left_out(here: Snapshot, points: tuple[str, ...]) -> None:
    line = LineContact.hold(here, "left_sole")
    held = independent_rows([line, *(PointContact.hold(here, one) for one in points)])
    assert len(held.labels) == 5


def test_the_line_of_a_sole_is_where_its_x_axis_leaves_it() -> None:
    triangle = [[-0.06, 0.0], [0.03, -0.04], [0.03, 0.02]]
    feet = {side: {"link": f"{side}_sole", "polygon": triangle} for side in ("left", "right")}
    robot = Robot.load("hoap2_like", feet=feet)
    here = robot.snapshot(robot.posture())
    sole = robot.feet["left"]
    contact = LineContact.hold(here, sole.frame)
    # The centroid is at (0, -0.02/3); the lower edge from (-0.06, 0) has y = -4/9 (x + 0.06).
    shift = np.array((0.0, -0.02 / 3.0))
    np.testing.assert_allclose(sole.polygon.mean(axis=0), 0.0, atol=1e-12)
    behind = -0.06 + (0.02 / 3.0) * 9.0 / 4.0
    np.testing.assert_allclose(
        sorted(contact.corners[:, 0]), sorted((behind, 0.03)) + shift[0], atol=1e-9
    )
    np.testing.assert_allclose(contact.corners[:, 1:], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("more", "match"),
    [
        ({"corners": [[0.0, 0.0]]}, "on a line through the origin of 'left_sole'"),
        ({"corners": [[-0.1, 0.02], [0.1, 0.02]]}, "on a line through the origin"),
        ({"corners": [[-0.008, 0.0, -0.1], [0.008, 0.0, 0.1]]}, "across its z axis"),
        ({"friction": None}, "friction: what pulls and twists holds all six rows; use Contact"),
    ],
)
def test_what_is_no_line_is_refused(here: Snapshot, more: dict[str, object], match: str) -> None:
    with pytest.raises(InvalidInputError, match=match):
        LineContact.hold(here, "left_sole", **more)  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match="on a line"):
        LineContact.hold(here, "left_hand")  # no sole, and no corners
    LineContact.hold(here, "left_sole", corners=[[-0.015, 0.0, -0.1], [0.015, 0.0, 0.1]])  # steep


def test_feet_that_are_lines_stand_on_them() -> None:
    """Forces have no moment about a line: five rows are all that two corners hold."""
    feet = {
        side: {"link": f"{side}_sole", "polygon": [[-0.04, 0.0], [0.05, 0.0]]}
        for side in ("left", "right")
    }
    robot = Robot.load("hoap2_like", feet=feet)
    start = robot.snapshot(robot.posture())
    contacts = support(start, "double")
    assert {type(one) for one in contacts} == {LineContact}
    tasks = [ComTask(robot, start.com), PostureTask(robot, start.q)]
    controller = TorqueController(robot, tasks, contacts=contacts, limits=Limits(robot))
    tick = controller.step(start)
    assert tick.ok
    wrenches = tick.reaction.wrenches()
    for contact in contacts:
        assert abs(wrenches[contact.name][3]) < 1e-9  # N m about x, along the line
        assert wrenches[contact.name][2] > 0.3 * robot.weight


def test_a_problem_file_names_it(here: Snapshot) -> None:
    spec = ["left", ContactSpec(frame="right_sole", type="line")]
    assert [type(one) for one in contacts_of(spec, here)] == [Contact, LineContact]
