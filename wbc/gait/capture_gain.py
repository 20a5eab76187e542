"""Gain scheduling of the capture point of a standing robot: soles first, then angular momentum.

The law of :meth:`wbc.laws.AccelerationLaw.capture_point` asks for the centroidal moment pivot at
r = xi + k (xi - xi_ref). Inside the soles the centre of pressure can be there. Beyond them the body
has to take up angular momentum, which tilts the trunk and has to be given back: needed where soles
alone do not stop xi. A gain that is high everywhere throws the trunk for errors, noise and delays
that the CoP could correct, and keeps doing so when the push is over.

So k is chosen in each tick:

    inside      at most ``gain``, and such that r stays in the inner part of the soles
    at an edge  up to ``spin``, as xi is near the edge or moves towards it

(a reserve and a share beyond it, as in the pendulum's law of :mod:`wbc.rmp.balance.capture`).
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

# Width of the zone along the edges in which momentum helps: in heights of the CoM, and at most as a
# part of the target's distance from the edge. At FULL_SPIN of that width the gain is ``spin``. The
# CoP stays SOLE_RESERVE of it from the edges: nearer, a small error tips the soles.
EDGE_ZONE, EDGE_ZONE_OF_TARGET = 0.082, 0.64
FULL_SPIN, SOLE_RESERVE = 0.4, 0.6
# In units of 1/omega: preview of xi, and time constant of the filter for its rate.
PREVIEW, RATE_TIME = 0.4, 0.022
MIN_LENGTH = 1e-3  # m, of the zone, for a target at an edge or beyond it


class _Soles(NamedTuple):
    """The support polygon ``normals @ p <= offsets``."""

    corners: Array  # (n, 3) [m]
    normals: Array  # (k, 2), outwards
    offsets: Array  # (k,) [m]
    height: float  # mean of the corners [m]


class CaptureGain:
    """Sets the law of a CoM task before each tick of a robot that stands.

    Parameters
    ----------
    controller:
        Its contacts bear the robot; the state is predicted over its ``delay``.
    task:
        For the CoM along x, y or both; its ``acceleration_law`` is set, its target may move.
    gain:
        How far beyond the capture point the pivot goes, by its error, where it is inside the soles.
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
        soles = self._standing_soles()
        height = max(float(snapshot.com[2]) - soles.height, MIN_LENGTH) if soles else 0.0
        if soles is None or height <= MIN_LENGTH:  # in the air, or lying
            self._last = None
            self._set_law(self.gain, max(float(snapshot.com[2]), MIN_LENGTH))
            return
        point, omega = capture_point(snapshot, height)
        self._update_rate(point, omega)
        self._set_law(self._gain_for(soles, point, omega, height), height)

    def _standing_soles(self) -> _Soles | None:
        """Return the support polygon, cached while contacts stay; None if it has no area."""
        soles, before = standing_soles(self.controller.contacts), self._soles
        if not soles:
            return None
        corners = np.concatenate([one.anchored for one in soles])
        if before is not None and np.array_equal(before.corners, corners):
            return before
        hull = convex_hull(corners[:, :2])
        if len(hull) < 3 or polygon_area(hull) < MIN_LENGTH**2:
            return None
        self._soles = _Soles(corners, *half_planes(hull), float(corners[:, 2].mean()))
        self._last = None
        return self._soles

    def _update_rate(self, point: Array, omega: float) -> None:
        """Update the filtered rate of the capture point (2,)."""
        dt = self.controller.dt
        if self._last is None:
            self._rate = np.zeros(2)
        else:
            share = -math.expm1(-omega * dt / RATE_TIME)
            self._rate = self._rate + share * ((point - self._last) / dt - self._rate)
        self._last = point

    def _gain_for(self, soles: _Soles, point: Array, omega: float, height: float) -> float:
        """Return the gain for a capture point (2,) [m]."""
        task, normals = self.task, soles.normals
        goal = np.where(self._driven, task.target[:2] + task.target_rate[:2] / omega, point)
        inside = soles.offsets - normals @ point
        approach = np.maximum(normals @ self._rate, 0.0) * (PREVIEW / omega)
        of_target = EDGE_ZONE_OF_TARGET * (soles.offsets - normals @ goal)
        zone = np.clip(of_target, MIN_LENGTH, EDGE_ZONE * height)
        spin_shares = (zone - (inside - approach)) / ((1.0 - FULL_SPIN) * zone)
        outwards = normals @ (point - goal)
        reserve = np.maximum(inside - SOLE_RESERVE * zone, 0.0)
        approaching = outwards > 0.0
        inner_gain = float(np.min(reserve[approaching] / outwards[approaching], initial=self.gain))
        return inner_gain + min(max(float(spin_shares.max()), 0.0), 1.0) * (self.spin - inner_gain)

    def _set_law(self, gain: float, height: float) -> None:
        self.value = gain
        gravity = self.controller.robot.gravity
        self.task.acceleration_law = AccelerationLaw.capture_point(height, gain, gravity)
