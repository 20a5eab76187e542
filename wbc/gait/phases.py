"""The phases of a walk: standing, double support, single support."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from wbc.gait.adaptation import Multipliers
from wbc.gait.crossing import Crossing
from wbc.gait.dcm import in_plane
from wbc.gait.foothold import Foothold, Rotation
from wbc.gait.footsteps import other
from wbc.gait.prescribed_steps import Footstep
from wbc.gait.settings import GaitSettings
from wbc.gait.swing import SwingFoot, yaw_of
from wbc.robot import Snapshot
from wbc.validate import Array

# Speed at which a late foot goes on down, in units of height times omega: ground that is 3 % of the
# height lower is found within 0.2/omega, in which the capture point's error grows by a fifth. At
# half the speed it grows by a half, more than the sole can correct.
DESCENT = 0.16

Place = Sequence[float]  # x, y, z [m]


class GaitState(NamedTuple):
    """The state that the gait is planned from.

    With the centre of pressure at p and the angular momentum k about the CoM, the horizontal motion
    at height h is c'' = omega^2 (c - p) - d/dt (k_y, -k_x) / (M h). So the DCM of the velocity
    c' + (k_y, -k_x) / (M h) obeys xi' = omega (xi - p) - (k_y, -k_x) / (M h): it is disturbed by
    the momentum, small and of zero mean while walking, and not by its rate, which would need more
    than the length of a sole.

    ``dcm``: with the velocity above, as x + i y [m].
    ``places``, ``rotations``: of the soles by foot, as numbers: x, y, z [m], and rows of (3, 3).
    ``pressure_offset``: offset of the CoP ahead of the soles' middles [m]. :attr:`dcm` is shifted
    back by it, so that a walk is planned as if the CoP were at their middles.
    """

    dcm: complex
    places: dict[str, Place]
    rotations: dict[str, Rotation]
    pressure_offset: float = 0.0

    @classmethod
    def of(cls, snapshot: Snapshot, frames: dict[str, str], omega: float, height: float) -> Self:
        """Return the state of a snapshot; ``frames`` are those of the soles by foot."""
        lx, ly, _, kx, ky, _ = snapshot.native_state.part("momentum", 6).tolist()
        x, y, _ = snapshot.com.tolist()
        velocity = complex(lx + ky / height, ly - kx / height) / snapshot.robot.mass
        places: dict[str, Place] = {}
        rotations: dict[str, Rotation] = {}
        for foot, pose in zip(frames, snapshot._poses(*frames.values()).tolist(), strict=True):
            places[foot], *rotations[foot] = pose
        return cls(complex(x, y) + velocity / omega, places, rotations)

    def place(self, foot: str) -> complex:
        """Return where a foot stands, as x + i y [m]."""
        x, y, _ = self.places[foot]
        return complex(x, y)

    def pose(self, foot: str) -> Array:
        """Return x, y, yaw and z of a foot (4,) [m, rad]."""
        return sole_pose(self.places[foot], self.rotations[foot])

    @property
    def middle(self) -> Array:
        """Between the feet (3,) [m]."""
        return np.asarray(0.5 * np.add(self.places["left"], self.places["right"]))

    @property
    def normal(self) -> Array:
        """Mean normal of both soles (3,), not normalised."""
        return np.asarray(0.5 * (self.upwards("left") + self.upwards("right")))

    def upwards(self, foot: str) -> Array:
        """Return the normal (3,) of a sole."""
        return np.array([row[2] for row in self.rotations[foot]])


@dataclass(frozen=True)
class Standing:
    """On both feet, at rest."""


class DoubleSupport(NamedTuple):
    """On both feet, the VRP moving from one to the other."""

    support: str  # the next stance foot
    start: complex  # where the VRP begins, x + i y [m]
    duration: float  # of the VRP's motion [s]
    left: float  # remaining time [s]
    halts: bool = False  # whether the robot comes to rest between the feet
    unloading: bool = False  # whether the other foot is being unloaded
    level: float | None = None  # of the single support before


class SingleSupport(NamedTuple):
    """On one foot."""

    support: str  # the stance foot
    swing: SwingFoot  # the other one
    elapsed: float  # since lift-off [s]
    left: float  # until touch-down; negative if that is late [s]
    goal: complex  # where the swing foot lands, x + i y [m]
    # Of the DCM from the goal, at the beginning of the next single support [m].
    offset: complex
    foothold: Foothold  # of the stance foot
    # The prescribed footstep and those after it, if any.
    given: tuple[Footstep, ...] = ()
    # Height of the ground that both legs reach at touch-down [m], if the footstep prescribes one.
    level: float | None = None
    adapted: bool = True  # whether the QP of the footstep was solved
    # Its multipliers: see wbc.gait.adaptation.held_back_by.
    multipliers: Multipliers | None = None

    @classmethod
    def lift_off(
        cls,
        foot: str,
        now: GaitState,
        normal: Array,
        gait: GaitSettings,
        half: Array,
        given: tuple[Footstep, ...] = (),
        crossing: Crossing | None = None,
    ) -> Self:
        """Return the phase in which ``foot`` leaves ground of a ``normal`` (3,).

        ``half`` (2,) are the half sizes of the stance sole [m]; ``crossing`` is the path over
        edges, if there are any.
        """
        pose, stands = now.pose(foot), now.places[other(foot)][2]
        descent = DESCENT * gait.height * gait.omega
        lands, sole, level, single = normal, None, None, gait.single
        if given:
            step = given[0]
            single = step.single(gait)
            level = None if step.z is None else min(stands, step.z)
            if step.normal is not None:
                lands, sole = step.normal, now.upwards(foot)
        swing = SwingFoot.lift_off(
            pose[:3],
            float(pose[3]),
            lands,
            gait.clearance,
            gait.single,
            descent,
            sole=sole,
            crossing=crossing,
        )
        hold = Foothold.whole(now.upwards(other(foot)), normal, half)
        return cls(other(foot), swing, 0.0, single, in_plane(pose), 0j, hold, given, level)

    def update(self, now: GaitState, wrench: Array, weight: float) -> Self:
        """Return it with the foothold updated; ``wrench`` (6,) is on the stance sole [N, N m]."""
        known = self.foothold.update(now.rotations[self.support], wrench, weight)
        return self if known is self.foothold else self._replace(foothold=known)


Phase = Standing | DoubleSupport | SingleSupport


def sole_pose(place: Place | Array, rotation: Rotation | Array) -> Array:
    """Return x, y, yaw and z (4,) [m, rad]."""
    return np.array((place[0], place[1], yaw_of(rotation), place[2]))


def sole_poses(snapshot: Snapshot) -> dict[str, Array]:
    """Return x, y, yaw and z of the soles (4,) [m, rad], by foot."""
    feet = snapshot.robot.feet.items()
    return {foot: sole_pose(*snapshot.placement(sole.frame)) for foot, sole in feet}


def next_foot(phase: Phase) -> str | None:
    """Return the foot of the next step that has not begun; None if either can make it."""
    if isinstance(phase, SingleSupport):
        return phase.support
    if isinstance(phase, DoubleSupport) and not phase.halts:
        return other(phase.support)
    return None
