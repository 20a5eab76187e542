"""What a walking robot is doing: standing, on both feet between steps, or on one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from wbc.gait.adaptation import Multipliers
from wbc.gait.command import Velocity
from wbc.gait.crossing import Crossing
from wbc.gait.dcm import in_plane
from wbc.gait.foothold import Foothold
from wbc.gait.footsteps import other
from wbc.gait.prescribed_steps import Footstep
from wbc.gait.settings import GaitSettings
from wbc.gait.swing import SwingFoot, yaw_of
from wbc.robot import Snapshot
from wbc.validate import Array

# A foot that does not find the ground goes on down at this speed, in units of height times omega:
# what is 3 % of the height lower is found within 0.2/omega, in which the capture point's error
# grows by a fifth; at half the speed it grows by a half, beyond what a sole can do.
DESCENT = 0.16


class GaitState(NamedTuple):
    """What a gait knows of the robot.

    With the centre of pressure at p and the angular momentum k about the CoM, the horizontal motion
    at height h is c'' = omega^2 (c - p) - d/dt (k_y, -k_x) / (M h). So the DCM of the velocity
    c' + (k_y, -k_x) / (M h) obeys xi' = omega (xi - p) - (k_y, -k_x) / (M h): what disturbs it is
    the momentum, small and of zero mean while walking, and not its rate, which would ask for more
    than the length of a sole.

    Attributes
    ----------
    dcm:
        Of the CoM, with the velocity that the angular momentum stands for, as x + i y [m].
    places, rotations:
        Of the soles, by foot: (3,) [m] and (3, 3).
    ahead:
        Of the soles' middles the pressure is led [m], and of what :attr:`dcm` says the DCM is: so
        a walk is planned as if it were led to their middles.
    """

    dcm: complex
    places: dict[str, Array]
    rotations: dict[str, Array]
    ahead: float = 0.0

    @classmethod
    def of(cls, snapshot: Snapshot, frames: dict[str, str], omega: float, height: float) -> Self:
        """Return it of a snapshot; ``frames`` are those of the soles by foot."""
        lx, ly, _, kx, ky, _ = snapshot.momentum.tolist()
        x, y, _ = snapshot.com.tolist()
        velocity = complex(lx + ky / height, ly - kx / height) / snapshot.robot.mass
        places: dict[str, Array] = {}
        rotations: dict[str, Array] = {}
        for foot, frame in frames.items():
            places[foot], rotations[foot] = snapshot.placement(frame)
        return cls(complex(x, y) + velocity / omega, places, rotations)

    def place(self, foot: str) -> complex:
        """Return where a foot stands, as x + i y [m]."""
        return in_plane(self.places[foot])

    def pose(self, foot: str) -> Array:
        """Return x, y, yaw and z of a foot (4,) [m, rad]."""
        return sole_pose(self.places[foot], self.rotations[foot])

    @property
    def middle(self) -> Array:
        """Between the feet (3,) [m]."""
        return np.asarray(0.5 * (self.places["left"] + self.places["right"]))

    @property
    def normal(self) -> Array:
        """Of both soles, on average (3,); no unit vector."""
        return np.asarray(0.5 * (self.rotations["left"] + self.rotations["right"])[:, 2])


@dataclass(frozen=True)
class Standing:
    """On both feet, at rest."""


class DoubleSupport(NamedTuple):
    """On both feet, the pressure on its way."""

    support: str  # the foot that will bear
    start: complex  # where the VRP began, x + i y [m]
    duration: float  # [s]
    left: float  # [s]
    halts: bool = False  # whether it comes to rest between the feet
    unloading: bool = False  # whether the other foot is being relieved
    level: float | None = None  # as of the single support before


class SingleSupport(NamedTuple):
    """On one foot."""

    support: str  # the foot that bears
    swing: SwingFoot  # the other one
    elapsed: float  # since it began [s]
    left: float  # until the other foot lands; below zero if that is late [s]
    goal: complex  # where it lands, x + i y [m]
    # That the DCM should have from there, when that foot alone begins to bear [m].
    offset: complex
    foothold: Foothold  # of the foot that bears
    # The footstep that it is asked to make, and those after it, if any.
    given: tuple[Footstep, ...] = ()
    # Height of the ground that both legs reach as the foot lands [m], if its own was given.
    level: float | None = None
    adapted: bool = True  # whether the QP of the footstep was solved
    # Its multipliers: see wbc.gait.adaptation.held_back_by.
    multipliers: Multipliers | None = None

    @classmethod
    def begun(
        cls,
        foot: str,
        now: GaitState,
        normal: Array,
        gait: GaitSettings,
        half: Array,
        given: tuple[Footstep, ...] = (),
        crossing: Crossing | None = None,
    ) -> Self:
        """Return the phase in which ``foot`` leaves the ground, whose ``normal`` is (3,).

        ``half`` (2,) are half the sizes of the sole that bears [m]; ``crossing`` is how the foot
        goes over edges, if it does.
        """
        pose, stands = now.pose(foot), float(now.places[other(foot)][2])
        descent = DESCENT * gait.height * gait.omega
        lands, sole, level, single = normal, None, None, gait.single
        if given:
            step = given[0]
            single = step.single(gait)
            level = None if step.z is None else min(stands, step.z)
            if step.normal is not None:
                lands, sole = step.normal, now.rotations[foot][:, 2]
        swing = SwingFoot.begun(
            pose[:3],
            float(pose[3]),
            lands,
            gait.clearance,
            gait.single,
            descent,
            sole=sole,
            crossing=crossing,
        )
        hold = Foothold.whole(now.rotations[other(foot)], normal, half)
        return cls(other(foot), swing, 0.0, single, in_plane(pose), 0j, hold, given, level)

    def felt(self, now: GaitState, wrench: Array, weight: float) -> Self:
        """Return it with what is known of the foothold now; ``wrench`` (6,) is on its sole [N]."""
        known = self.foothold.felt(now.rotations[self.support], wrench, weight)
        return self if known is self.foothold else self._replace(foothold=known)


Phase = Standing | DoubleSupport | SingleSupport


def sole_pose(place: Array, rotation: Array) -> Array:
    """Return x, y, yaw and z (4,) [m, rad]."""
    return np.array((place[0], place[1], yaw_of(rotation), place[2]))


def sole_poses(snapshot: Snapshot) -> dict[str, Array]:
    """Return x, y, yaw and z of the soles (4,) [m, rad], by foot."""
    frames = {foot: sole.frame for foot, sole in snapshot.robot.feet.items()}
    return {
        foot: sole_pose(snapshot.position(frame), snapshot.rotation(frame))
        for foot, frame in frames.items()
    }


def next_foot(phase: Phase) -> str | None:
    """Return the foot that makes the next step that is not begun; None if both can."""
    if isinstance(phase, SingleSupport):
        return phase.support
    if isinstance(phase, DoubleSupport) and not phase.halts:
        return other(phase.support)
    return None


def landing_pose(phase: SingleSupport, heading: float, velocity: Velocity) -> Array:
    """Return x, y [m] and yaw [rad] with which the foot in the air lands (3,)."""
    turned = heading + velocity.yaw_rate * max(phase.left, 0.0)
    x, y = phase.goal.real, phase.goal.imag
    return np.array((x, y, phase.given[0].yaw if phase.given else turned))


def feet_after(
    phase: Phase, now: GaitState, heading: float, velocity: Velocity
) -> dict[str, Array]:
    """Return x, y, yaw and z of both feet (4,) [m, rad], of one in the air where it lands."""
    feet = {foot: now.pose(foot) for foot in now.places}
    if isinstance(phase, SingleSupport):
        lands = landing_pose(phase, heading, velocity)
        height = feet[phase.support][3]
        if phase.given and phase.given[0].z is not None:
            height = phase.given[0].z
        feet[other(phase.support)] = np.append(lands, height)
    return feet
