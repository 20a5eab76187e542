"""Standing up and going down: joints led along a path of postures, without a controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wbc.constraints import Limits, support
from wbc.controllers import KinematicController
from wbc.controllers.closed_loop import closed_loop
from wbc.errors import InvalidInputError
from wbc.hardware.bus import Command
from wbc.minimum_jerk import minimum_jerk
from wbc.robot import Snapshot
from wbc.robot.limits import BASE_NV
from wbc.robot.names import BASE
from wbc.tasks import ComTask, OrientationTask, PostureTask
from wbc.validate import Array, finite_number

DEPTH = 0.25  # of the CoM's height over the soles: how far a crouch is down
GIVE = 0.1  # part of DEPTH by which a crouch may be missed
POSTURES = 31  # on the path
TICKS, TICK = 300, 0.02  # of the velocity controller that finds them


@dataclass(frozen=True, eq=False)
class CrouchPath:
    """Postures from standing to a crouch, the CoM over the same point between the feet.

    Attributes
    ----------
    joints:
        (m, n) [rad or m]; the first stands.
    torques:
        (m, n) that bear the weight on the feet there [N m or N].
    lowest:
        Configuration (nq,) of the crouch.
    """

    joints: Array
    torques: Array
    lowest: Array

    @classmethod
    def of(cls, start: Snapshot, feet: str | Sequence[str] = "double") -> CrouchPath:
        """Return the path down from a standing posture, found by a velocity controller.

        Raises
        ------
        InvalidInputError
            The robot cannot crouch so far on its feet.
        """
        robot = start.robot
        contacts = support(start, feet)
        frames = [contact.frame for contact in contacts]
        sole = float(np.mean([start.position(frame)[2] for frame in frames]))
        depth = DEPTH * (float(start.com[2]) - sole)
        com = ComTask(robot, start.com, weight=10.0)
        tasks = [
            com,
            OrientationTask(robot, BASE, start.rotation(BASE), name="trunk", weight=3.0),
            PostureTask(robot, start.q, weight=0.3),
        ]
        controller = KinematicController(
            robot, tasks, contacts=contacts, limits=Limits(robot), dt=TICK
        )
        found = [start]
        for now in closed_loop(controller, start.q, TICKS):
            share = minimum_jerk(min((len(found) + 1) / (0.7 * TICKS), 1.0))
            com.set_target(start.com - [0.0, 0.0, share * depth])
            found.append(robot.snapshot(now.q))
        sunk = float(start.com[2] - found[-1].com[2])
        if abs(sunk - depth) > GIVE * depth:
            raise InvalidInputError(
                f"{robot.name} cannot crouch by {depth:.3f} m from this posture, only by"
                f" {sunk:.3f} m; begin with bent knees"
            )
        heights = np.array([one.com[2] for one in found])
        wanted = np.linspace(heights[0], heights[-1], POSTURES)
        chosen = [found[int(np.abs(heights - height).argmin())] for height in wanted]
        return cls(
            np.stack([one.joint_positions for one in chosen]),
            np.stack([standing_torque(one, frames) for one in chosen]),
            found[-1].q,
        )

    def nearest(self, joints: Array) -> int:
        """Return the posture that is nearest to where joints (n,) are."""
        return int(np.square(self.joints - joints).sum(axis=1).argmin())


def standing_torque(snapshot: Snapshot, frames: Sequence[str]) -> Array:
    """Return the joint torques (n,) of a robot at rest that stands on frames.

    The wrenches on them are the least ones that bear the weight: S' tau = g - J' f.
    """
    rest = snapshot.robot.snapshot(snapshot.q)
    J = np.vstack([rest.jacobian(frame) for frame in frames])
    wrenches = np.linalg.lstsq(J[:, :BASE_NV].T, rest.bias[:BASE_NV], rcond=None)[0]
    return (rest.bias - J.T @ wrenches)[BASE_NV:]


class PostureMotion:
    """Leads joints from where they are onto a crouch path, and along it to one of its ends.

    Parameters
    ----------
    path:
        The postures.
    up:
        Whether to the standing one; else to the crouch.
    kp, kd:
        Gains (n,).
    onto, along:
        Times of the two parts [s]: to the first posture of the motion, and on. Standing up begins
        with the crouch, going down with the nearest posture.
    """

    def __init__(
        self,
        path: CrouchPath,
        kp: Array,
        kd: Array,
        *,
        up: bool,
        onto: float = 1.0,
        along: float = 2.5,
    ) -> None:
        self._path, self._kp, self._kd, self._up = path, kp, kd, up
        self.onto = finite_number("posture motion, onto", onto, above=0.0)
        self.along = finite_number("posture motion, along", along, above=0.0)
        self._began: float | None = None
        self._from: Array = path.joints[0]
        self._loaded: Array = np.zeros(len(kp))
        self._first = 0.0

    @property
    def has_begun(self) -> bool:
        """Whether :meth:`begin` was called since :meth:`end`."""
        return self._began is not None

    def begin(self, now: float, joints: Array, torque: Array) -> None:
        """Begin where joints (n,) are now, with the torque (n,) that they have: nothing jumps."""
        path, n = self._path, len(self._path.joints)
        self._began = now
        self._from, self._loaded = joints, torque
        self._first = float(n - 1 if self._up else path.nearest(joints))

    def end(self) -> None:
        """Forget that it began."""
        self._began = None

    def is_over(self, now: float) -> bool:
        """Return whether the last posture is commanded."""
        return self._began is not None and now - self._began >= self.onto + self.along

    def command(self, now: float) -> Command:
        """Return the command for this time."""
        began = now if self._began is None else self._began
        onto = minimum_jerk(min(max((now - began) / self.onto, 0.0), 1.0))
        along = minimum_jerk(min(max((now - began - self.onto) / self.along, 0.0), 1.0))
        last = 0.0 if self._up else len(self._path.joints) - 1.0
        at = self._first + along * (last - self._first)
        low = min(int(at), len(self._path.joints) - 2)
        part = at - low
        posture = (1.0 - part) * self._path.joints[low] + part * self._path.joints[low + 1]
        torque = (1.0 - part) * self._path.torques[low] + part * self._path.torques[low + 1]
        target = (1.0 - onto) * self._from + onto * posture
        torque = (1.0 - onto) * self._loaded + onto * torque
        return Command(0, target, np.zeros(len(target)), torque, self._kp, self._kd)


class Motions(NamedTuple):
    """The two ways that need no controller."""

    up: PostureMotion
    down: PostureMotion
