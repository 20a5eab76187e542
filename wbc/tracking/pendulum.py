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
from wbc.tracking.fit import sole_polygon
from wbc.validate import finite_number


@dataclass(frozen=True, eq=False)
class RobotPendulum:
    """What a robot brings to a :class:`~wbc.rmp.plan.PlanProblem`; made by :func:`pendulum_of`.

    The reaction masses' axes are named after the world's axes that they are nearest to, so radii
    and rotations of plans are about x, y, z as long as the robot's ellipsoid stands upright.

    Attributes
    ----------
    pendulum:
        Of the robot's mass, under its gravity.
    rest:
        The robot's CoM and radii, at rest.
    reference:
        Orientation of the masses' axes (x, y, z, w), from which a plan's rotations are counted.
    """

    pendulum: SolidRmp
    rest: State
    reference: tuple[float, float, float, float]
    start: Snapshot

    def soles(self, feet: Iterable[str], margin: float = 0.0) -> Corners:
        """Return where the CoP may be: the hull of the soles of feet, ``margin`` [m] inside.

        A plan that goes to the edge of the soles leaves nothing to correct errors with.

        Raises
        ------
        UnknownNameError
            The robot has no such foot.
        InvalidInputError
            Soles that are not on the ground, or nothing of them so far inside.
        """
        polygon = sole_polygon(self.start, feet)
        margin = finite_number("soles, margin", margin, least=0.0)
        return tuple((float(x), float(y)) for x, y in inset(polygon, margin))


def pendulum_of(start: Snapshot) -> RobotPendulum:
    """Return a robot's reaction mass pendulum (paper 3), to plan for.

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
