"""What pushes a robot: seen in its motion, where the forces on its soles do not explain it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from wbc.gait.phases import GaitState
from wbc.robot import Snapshot
from wbc.validate import Array

# In units of 1/omega: how soon a push is seen, and how long it is expected to go on. Someone who
# pushes does so for some tenths of a second.
SEEN, LASTS = 0.1, 0.25


class PushObserver(NamedTuple):
    """Observes the acceleration that is left when that by the soles is taken away.

    With forces f on the soles and their moment tau about the CoM, the velocity of the DCM (see
    :class:`~wbc.gait.phases.GaitState`), s = c' + (k_y, -k_x) / (M h), has the rate

        s' = f / M + (tau_y, -tau_x) / (M h) + a,

    whatever the height and the leg that swings do. Only what pushes adds an a: observed with two
    equal poles (Luenberger 1971). What noise and wrong masses leave in a G1's walk is 0.2 m/s^2; a
    push of 100 N is 3.

    Attributes
    ----------
    omega, height:
        Of the pendulum [1/s, m].
    expected:
        s, as x + i y, or None before anything was felt [m/s].
    push:
        a, likewise [m/s^2].
    """

    omega: float
    height: float
    expected: complex | None = None
    push: complex = 0j

    def seen(
        self, snapshot: Snapshot, now: GaitState, felt: Mapping[str, Array], dt: float
    ) -> PushObserver:
        """Return it ``dt`` later.

        ``felt`` are the wrenches (6,) on the soles by foot [N, N m]; if none are, it begins anew.
        """
        cx, cy, cz = snapshot.com.tolist()
        velocity = self.omega * (now.dcm - complex(cx, cy))
        if not felt or self.expected is None:
            return self._replace(expected=velocity if felt else None, push=0j)
        total_x = total_y = 0.0  # of the forces, with what their moments about the CoM stand for
        for foot, wrench in felt.items():
            fx, fy, fz, mx, my, _ = wrench.tolist()
            x, y, z = now.places[foot].tolist()
            x, y, z = x - cx, y - cy, z - cz
            total_x += fx + (my + z * fx - x * fz) / self.height
            total_y += fy - (mx + y * fz - z * fy) / self.height
        rate = complex(total_x, total_y) / snapshot.robot.mass
        expected = self.expected + (rate + self.push) * dt
        off, pole = velocity - expected, math.exp(-self.omega * dt / SEEN)
        push = self.push + (1.0 - pole) ** 2 / dt * off
        return PushObserver(self.omega, self.height, expected + (1.0 - pole**2) * off, push)

    def ahead(self, now: GaitState, delay: float = 0.0) -> GaitState:
        """Return a state with the DCM that the push will have made of it.

        A push is half done when it is seen. A footstep that waits for the rest of it is decided too
        late, and the pressure meets it only then.

        Parameters
        ----------
        delay:
            Over which the state was predicted, without the push [s].
        """
        dcm = now.dcm + (LASTS / self.omega**2 + delay / self.omega) * self.push
        return GaitState(dcm, now.places, now.rotations)
