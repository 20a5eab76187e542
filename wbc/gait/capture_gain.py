"""How hard the capture point of a standing robot is driven: by its soles, or by its trunk as well.

The law of :meth:`wbc.laws.AccelerationLaw.capture_point` asks for the centroidal moment pivot at
r = xi + k (xi - xi_ref). In the soles the centre of pressure can be there. Beyond them the body has
to take up angular momentum, which tilts the trunk and has to be given back: worth it where nothing
else stops xi, and a waste where soles do. A gain that is high everywhere throws the trunk for
errors, noise and delays that a little pressure corrects, and goes on when the push is caught.

So k is here, from tick to tick,

    inside      at most ``gain``, and no more than keeps r in what soles press well
    at an edge  up to ``spin``: xi is near it, or on its way to it

(a reserve and a share beyond it, as the pendulum's law of :mod:`wbc.rmp.balance.capture` has them).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from wbc.controllers import Controller, TorqueController
from wbc.controllers.checks import check_snapshot
from wbc.errors import InvalidInputError, shown
from wbc.gait.soles import capture_point, standing_soles
from wbc.laws import AccelerationLaw
from wbc.polygon import convex_hull, half_planes, polygon_area
from wbc.robot import Snapshot
from wbc.tasks import ComTask
from wbc.validate import Array, finite_number

# How near to an edge of the soles momentum begins to help: in heights of the CoM, and at most in
# parts of how far inside the target is. At FULL of that distance it helps all it can. Up to RESERVE
# of it soles are counted on: pressed nearer to their edges, a little error tips them.
NEAR, OF_TARGET = 0.082, 0.64
FULL, RESERVE = 0.4, 0.6
# In units of 1/omega: how far ahead xi is looked at, and how soon its speed is seen.
AHEAD, SEEN = 0.4, 0.022
LEAST = 1e-3  # m, for a target at an edge, or beyond it


class _Soles(NamedTuple):
    """What stands, seen from above: inside is ``normals @ p <= offsets``."""

    corners: Array  # (n, 3) [m]
    normals: Array  # (k, 2), outwards
    offsets: Array  # (k,) [m]
    height: float  # of the corners, in the mean [m]


class CaptureGain:
    """Sets the law of a CoM task before each tick of a robot that stands.

    Parameters
    ----------
    controller:
        Whose contacts bear the robot. A delay that it knows is predicted over.
    task:
        For the CoM along x, y or both; its ``acceleration_law`` is set, its target may move.
    gain:
        How far beyond the capture point the pivot goes, by its error, where soles can press that.
    spin:
        Likewise at their edges; at least ``gain``.

    Attributes
    ----------
    value:
        The gain that the last tick had.

    Raises
    ------
    InvalidInputError
        Not a torque controller or no task for a horizontal CoM; a gain out of range.
    """

    def __init__(
        self, controller: Controller, task: ComTask, *, gain: float = 3.0, spin: float = 20.0
    ) -> None:
        if not isinstance(controller, TorqueController):
            raise InvalidInputError(
                "capture gain: expected a TorqueController, whose contacts bear forces, got"
                f" {shown(controller)}"
            )
        if not isinstance(task, ComTask) or "z" in task.rows:
            raise InvalidInputError(
                "capture gain: a capture point is on the ground; expected a ComTask with axes"
                f" x and y, got {shown(task)}"
            )
        self.controller, self.task = controller, task
        self.gain = finite_number("capture gain, gain", gain, above=0.0)
        self.spin = finite_number("capture gain, spin", spin, least=self.gain)
        self.value = self.gain
        self._driven = np.array([float(axis in task.rows) for axis in "xy"])
        self._soles: _Soles | None = None
        self._last: Array | None = None  # capture point of the last tick (2,) [m]
        self._rate = np.zeros(2)  # of the capture point, filtered [m/s]

    def prepare(self, snapshot: Snapshot) -> None:
        """Set the task's law for the tick of a measured state.

        Raises
        ------
        InvalidInputError
            Not a snapshot, or one of another robot object.
        """
        check_snapshot(self.controller.robot, snapshot)
        snapshot = self.controller.predicted(snapshot)
        soles = self._standing()
        height = max(float(snapshot.com[2]) - soles.height, LEAST) if soles else 0.0
        if soles is None or height <= LEAST:  # in the air, or lying
            self._last = None
            self._set(self.gain, max(float(snapshot.com[2]), LEAST))
            return
        point, omega = capture_point(snapshot, height)
        self._see(point, omega)
        self._set(self._wanted(soles, point, omega, height), height)

    def _standing(self) -> _Soles | None:
        """Return what stands, worked out anew where that changes; None if it has no area."""
        soles, before = standing_soles(self.controller.contacts), self._soles
        if not soles:
            return None
        corners = np.concatenate([one.anchored for one in soles])
        if before is not None and np.array_equal(before.corners, corners):
            return before
        hull = convex_hull(corners[:, :2])
        if len(hull) < 3 or polygon_area(hull) < LEAST**2:
            return None
        self._soles = _Soles(corners, *half_planes(hull), float(corners[:, 2].mean()))
        self._last = None
        return self._soles

    def _see(self, point: Array, omega: float) -> None:
        """Take note of how the capture point (2,) moves."""
        dt = self.controller.dt
        if self._last is None:
            self._rate = np.zeros(2)
        else:
            share = -math.expm1(-omega * dt / SEEN)
            self._rate = self._rate + share * ((point - self._last) / dt - self._rate)
        self._last = point

    def _wanted(self, soles: _Soles, point: Array, omega: float, height: float) -> float:
        """Return the gain for a capture point (2,) [m]."""
        task, normals = self.task, soles.normals
        goal = np.where(self._driven, task.target[:2] + task.target_rate[:2] / omega, point)
        inside = soles.offsets - normals @ point
        coming = np.maximum(normals @ self._rate, 0.0) * (AHEAD / omega)
        of_target = OF_TARGET * (soles.offsets - normals @ goal)
        near = np.clip(of_target, LEAST, NEAR * height)
        shares = (near - (inside - coming)) / ((1.0 - FULL) * near)
        outwards = normals @ (point - goal)
        room = np.maximum(inside - RESERVE * near, 0.0)
        bound = outwards > 0.0
        low = float(np.min(room[bound] / outwards[bound], initial=self.gain))
        return low + min(max(float(shares.max()), 0.0), 1.0) * (self.spin - low)

    def _set(self, gain: float, height: float) -> None:
        self.value = gain
        gravity = self.controller.robot.gravity
        self.task.acceleration_law = AccelerationLaw.capture_point(height, gain, gravity)
