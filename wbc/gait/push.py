"""Estimates external pushes: the motion that the forces on the soles do not explain."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple, Self

from wbc.gait.phases import GaitState
from wbc.robot import Snapshot
from wbc.validate import Array

# In units of 1/omega: time constant of the observer, and how long a push is expected to go on. A
# person pushes for some tenths of a second.
OBSERVER_TIME, PUSH_DURATION = 0.1, 0.25


class PushObserver(NamedTuple):
    """Luenberger observer of the acceleration that the forces on the soles do not explain.

    With forces f on the soles and their moment tau about the CoM, the velocity of the DCM (see
    :class:`~wbc.gait.phases.GaitState`), s = c' + (k_y, -k_x) / (M h), has the rate

        s' = f / M + (tau_y, -tau_x) / (M h) + a,

    whatever the height and the swing leg do. Only a push adds an a, which is observed with two
    equal poles (Luenberger 1971). Noise and wrong masses give 0.2 m/s^2 in a G1's walk; a push of
    100 N gives 3.

    ``omega``, ``height``: of the pendulum [1/s, m].
    ``expected``: s, as x + i y, or None before the first forces [m/s].
    ``push``: a, likewise [m/s^2].
    """

    omega: float
    height: float
    expected: complex | None = None
    push: complex = 0j

    def update(
        self, snapshot: Snapshot, now: GaitState, wrenches: Mapping[str, Array], dt: float
    ) -> Self:
        """Return the observer ``dt`` later.

        ``wrenches`` (6,) on the soles by foot [N, N m]; without any it is reset.
        """
        cx, cy, cz = snapshot.com.tolist()
        velocity = self.omega * (now.dcm - complex(cx, cy))
        if not wrenches or self.expected is None:
            return type(self)(self.omega, self.height, velocity if wrenches else None)
        total_x = total_y = 0.0  # M s', of the forces and of their moments about the CoM
        for foot, wrench in wrenches.items():
            fx, fy, fz, mx, my, _ = wrench.tolist()
            x, y, z = now.places[foot]
            x, y, z = x - cx, y - cy, z - cz
            total_x += fx + (my + z * fx - x * fz) / self.height
            total_y += fy - (mx + y * fz - z * fy) / self.height
        rate = complex(total_x, total_y) / snapshot.robot.mass
        expected = self.expected + (rate + self.push) * dt
        error, pole = velocity - expected, math.exp(-self.omega * dt / OBSERVER_TIME)
        push = self.push + (1.0 - pole) ** 2 / dt * error
        return type(self)(self.omega, self.height, expected + (1.0 - pole**2) * error, push)

    def predict(self, now: GaitState, delay: float = 0.0) -> GaitState:
        """Return a state with the DCM predicted for the end of the push.

        A push is half over when it is observed: footstep and pressure that react to the measured
        DCM only come too late.

        ``delay``: over which the state was already predicted, without the push [s].
        """
        dcm = now.dcm + (PUSH_DURATION / self.omega**2 + delay / self.omega) * self.push
        return GaitState(dcm, now.places, now.rotations, now.pressure_offset)
