"""A robot as the pendulum that a motion is planned for: its mass, its start at rest, its soles."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.polygon import inset
from wbc.rmp.axes import track
from wbc.rmp.plan.schedule import Corners, State, at_rest
from wbc.rmp.solid import SolidRmp
from wbc.robot import Snapshot
from wbc.robot.model import check_snapshot
from wbc.tracking.plan_check import sole_polygon
from wbc.validate import finite_number


@dataclass(frozen=True, eq=False)
class RobotPendulum:
    """A robot's data for a :class:`~wbc.rmp.plan.PlanProblem`; made by :func:`pendulum_of`.

    The reaction masses' axes are named after the nearest world axes, so a plan's radii and
    rotations are about x, y, z as long as the robot's ellipsoid stands upright.

    Attributes
    ----------
    pendulum:
        Of the robot's mass, under its gravity.
    rest:
        The robot's CoM and radii, at rest.
    reference:
        Orientation of the masses' axes (x, y, z, w), to which a plan's rotations are relative.
    """

    pendulum: SolidRmp
    rest: State
    reference: tuple[float, float, float, float]
    start: Snapshot

    def soles(self, feet: Iterable[str], margin: float = 0.0) -> Corners:
        """Return the corners of the CoP's region: the hull of the soles, ``margin`` [m] inside.

        A plan up to the edge of the soles leaves no margin for corrections.

        Raises
        ------
        UnknownNameError
            The robot has no such foot.
        InvalidInputError
            Soles that are not on the ground, or too small for the margin.
        """
        polygon = sole_polygon(self.start, feet)
        margin = finite_number("soles, margin", margin, least=0.0)
        return tuple((float(x), float(y)) for x, y in inset(polygon, margin))


def pendulum_of(start: Snapshot) -> RobotPendulum:
    """Return a robot's reaction mass pendulum (paper 3), for planning.

    Parameters
    ----------
    start:
        The robot where the plan is to begin; its velocity does not matter.

    Raises
    ------
    InvalidInputError
        No snapshot.
    """
    check_snapshot("pendulum_of", start)
    robot = start.robot
    axes = track(start.inertia[None], previous=np.eye(3))
    radii = np.sqrt(3.0 * axes.second_moments[0] / robot.mass)
    x, y, z, w = Rotation.from_matrix(axes.axes[0]).as_quat().tolist()
    model = SolidRmp(robot.mass, robot.gravity)
    return RobotPendulum(model, at_rest(start.com.tolist(), radii.tolist()), (x, y, z, w), start)
