"""Standing up and going down along a path of postures, by joint position control."""

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

CROUCH_DEPTH = 0.25  # of the CoM in a crouch, by its height over the soles
DEPTH_TOLERANCE = 0.1  # error of a crouch's depth, by the depth
PATH_POSTURES = 31
SEARCH_TICKS, SEARCH_DT = 300, 0.02  # of the velocity controller that finds the path [s]


@dataclass(frozen=True, eq=False)
class CrouchPath:
    """Postures from standing to a crouch, the CoM over the same point between the feet."""

    joints: Array  # (m, n) [rad or m]; the first stands
    torques: Array  # (m, n) that bear the weight on the feet [N m or N]
    lowest: Array  # configuration (nq,) of the crouch

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
        depth = CROUCH_DEPTH * (float(start.com[2]) - sole)
        com = ComTask(robot, start.com, weight=10.0)
        tasks = [
            com,
            OrientationTask(robot, BASE, start.rotation(BASE), name="trunk", weight=3.0),
            PostureTask(robot, start.q, weight=0.3),
        ]
        controller = KinematicController(
            robot, tasks, contacts=contacts, limits=Limits(robot), dt=SEARCH_DT
        )
        snapshots = [start]
        for now in closed_loop(controller, start.q, SEARCH_TICKS):
            share = minimum_jerk(min((len(snapshots) + 1) / (0.7 * SEARCH_TICKS), 1.0))
            com.set_target(start.com - [0.0, 0.0, share * depth])
            snapshots.append(robot.snapshot(now.q))
        reached = float(start.com[2] - snapshots[-1].com[2])
        if abs(reached - depth) > DEPTH_TOLERANCE * depth:
            raise InvalidInputError(
                f"{robot.name} cannot crouch by {depth:.3f} m from this posture, only by"
                f" {reached:.3f} m; begin with bent knees"
            )
        heights = np.array([one.com[2] for one in snapshots])
        path_heights = np.linspace(heights[0], heights[-1], PATH_POSTURES)
        selected = [snapshots[int(np.abs(heights - height).argmin())] for height in path_heights]
        return cls(
            np.stack([one.joint_positions for one in selected]),
            np.stack([standing_torque(one, frames) for one in selected]),
            snapshots[-1].q,
        )

    def nearest(self, joints: Array) -> int:
        """Return the index of the posture nearest to joints (n,)."""
        return int(np.square(self.joints - joints).sum(axis=1).argmin())


def standing_torque(snapshot: Snapshot, frames: Sequence[str]) -> Array:
    """Return the joint torques (n,) of a robot at rest that stands on frames."""
    needed, borne = bearing_forces(snapshot.robot.snapshot(snapshot.q), frames)
    return (needed - borne)[BASE_NV:]


def bearing_forces(rest: Snapshot, frames: Sequence[str]) -> tuple[Array, Array]:
    """Return the forces (nv,) that a robot at rest needs, and what frames it stands on give.

    The contact wrenches f are the least-norm ones that bear the weight: S' tau = g - J' f, where g
    is less what springs give.
    """
    needed = rest.bias - rest.robot.passive_forces_at(rest)
    J = np.vstack([rest.jacobian(frame) for frame in frames])
    wrenches = np.linalg.lstsq(J[:, :BASE_NV].T, needed[:BASE_NV], rcond=None)[0]
    return needed, J.T @ wrenches


class PostureMotion:
    """Moves joints from where they are onto a crouch path, and along it to one of its ends.

    Parameters
    ----------
    path:
        The postures.
    up:
        Whether to the standing posture; else to the crouch.
    kp, kd:
        Gains (n,).
    onto, along:
        Durations of the two parts [s]: to the first posture of the path, and along it. Standing up
        begins with the crouch, going down with the nearest posture.
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
        self._start_time: float | None = None
        self._start: Array = path.joints[0]
        self._start_torque: Array = np.zeros(len(kp))
        self._first_posture = 0.0

    @property
    def has_begun(self) -> bool:
        """Whether :meth:`begin` was called since :meth:`end`."""
        return self._start_time is not None

    def begin(self, now: float, joints: Array, torque: Array) -> None:
        """Begin at the present joint positions and torques (n,), so that neither jumps."""
        path, n = self._path, len(self._path.joints)
        self._start_time = now
        self._start, self._start_torque = joints, torque
        self._first_posture = float(n - 1 if self._up else path.nearest(joints))

    def end(self) -> None:
        """Reset the motion."""
        self._start_time = None

    def is_over(self, now: float) -> bool:
        """Return whether the last posture is reached."""
        return self._start_time is not None and now - self._start_time >= self.onto + self.along

    def command(self, now: float) -> Command:
        """Return the command for this time."""
        start = now if self._start_time is None else self._start_time
        onto = minimum_jerk(min(max((now - start) / self.onto, 0.0), 1.0))
        along = minimum_jerk(min(max((now - start - self.onto) / self.along, 0.0), 1.0))
        last = 0.0 if self._up else len(self._path.joints) - 1.0
        position = self._first_posture + along * (last - self._first_posture)
        k = min(int(position), len(self._path.joints) - 2)
        fraction = position - k
        posture = (1.0 - fraction) * self._path.joints[k] + fraction * self._path.joints[k + 1]
        torque = (1.0 - fraction) * self._path.torques[k] + fraction * self._path.torques[k + 1]
        target = (1.0 - onto) * self._start + onto * posture
        torque = (1.0 - onto) * self._start_torque + onto * torque
        return Command(0, target, np.zeros(len(target)), torque, self._kp, self._kd)


class Motions(NamedTuple):
    """The motions without a controller."""

    up: PostureMotion
    down: PostureMotion
