"""A robot as a pendulum: mass, inertia and soles, against the robot itself."""

import numpy as np
import pytest

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.polygon import polygon_margin
from wbc.robot import Robot, Snapshot
from wbc.rotations import rotation_from
from wbc.tracking.pendulum import RobotPendulum, pendulum_of


def test_pendulum_has_mass_com_and_inertia_of_the_robot(
    start: Snapshot, own: RobotPendulum
) -> None:
    assert own.pendulum.mass == start.robot.mass
    assert own.pendulum.gravity == pytest.approx(9.81)
    np.testing.assert_array_equal(own.rest.com, start.com)
    assert own.rest.com_velocity == own.rest.momentum == own.rest.rotation == (0.0, 0.0, 0.0)
    # Six masses M/6 at +-r_k e_k, summed one by one: rounding of an eigen-decomposition.
    R, inertia = rotation_from(np.array(own.reference)), np.zeros((3, 3))
    for axis, radius in zip(R.T, own.rest.radii, strict=True):
        for place in (radius * axis, -radius * axis):
            inertia += (
                own.pendulum.mass / 6.0 * (place @ place * np.eye(3) - np.outer(place, place))
            )
    np.testing.assert_allclose(inertia, start.inertia, rtol=1e-9, atol=1e-12)


def test_axes_are_named_after_the_nearest_world_axes(own: RobotPendulum) -> None:
    R = rotation_from(np.array(own.reference))
    assert (np.abs(R).argmax(axis=0) == [0, 1, 2]).all() and (np.diag(R) > 0.9).all()
    # Of a standing humanoid the vertical pair is the longest.
    assert np.argmax(own.rest.radii) == 2


def test_soles_with_margin_are_inside_the_standing_ones(
    start: Snapshot, own: RobotPendulum
) -> None:
    whole = np.array(own.soles(("left", "right")))
    inner = np.array(own.soles(("left", "right"), 0.01))
    assert polygon_margin(whole, inner).min() == pytest.approx(0.01, abs=1e-9)
    left = np.array(own.soles(("left",)))
    np.testing.assert_array_equal(own.soles("left"), left)  # as PlanReference takes it; it was 'l'
    assert polygon_margin(whole, left).min() >= -1e-12
    assert left[:, 1].mean() > 0.0 > start.position(start.robot.foot("right").frame)[1]
    with pytest.raises(UnknownNameError, match=r"'lfet'.*'left'"):
        own.soles(("lfet",))
    with pytest.raises(InvalidInputError, match="nothing of it is 1 m inside"):
        own.soles(("left",), 1.0)


def test_soles_in_the_air_are_refused(own: RobotPendulum) -> None:
    robot: Robot = own.start.robot
    q = own.start.q.copy()
    q[2] += 0.02
    with pytest.raises(InvalidInputError, match=r"left foot is at z = 0\.02 m"):
        pendulum_of(robot.snapshot(q)).soles(("left", "right"))
