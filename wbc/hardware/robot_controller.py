"""From a reading to a command: estimate the state, lead, tick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from wbc.controllers.torque_tick import TorqueTick
from wbc.errors import InvalidInputError, WbcError
from wbc.estimation import ImuReading, Measurement, StateEstimator
from wbc.gait.phases import Standing
from wbc.gait.scheduled_walk import ScheduledWalk
from wbc.gait.swing import turned, yaw_of
from wbc.hardware.bus import Command, Reading
from wbc.robot import Robot
from wbc.robot.limits import BASE_NQ, BASE_NV
from wbc.rotations import quaternion_from, rotation_from
from wbc.run.supervisor import Supervisor
from wbc.validate import Array

FADE = 0.3  # s in which the stiffness of standing up goes
SOLVED_OR_RELAXED = (None, "relax")


class EstimateError(WbcError):
    """There is no estimate of the base for a reading."""


class Sureness(NamedTuple):
    """How surely the base's state is known.

    Attributes
    ----------
    deviations:
        Standard deviations (4,) of tilt and heading [rad], velocity [m/s] and position [m].
    feet:
        Those that are counted on to stand still.
    """

    deviations: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    feet: tuple[str, ...] = ()


CERTAIN = Sureness()


class BaseEstimator(Protocol):
    """What the loop needs of an estimator; ``sure`` is how surely it knows its last answer."""

    name: str
    sure: Sureness

    def reset(self) -> None:
        """Begin anew: the robot stands still on its feet."""

    def update(self, reading: Reading) -> tuple[Array, Array]:
        """Return configuration (nq,) and velocity (nv,) at a reading.

        Raises
        ------
        EstimateError
            There is none.
        """


class TruthEstimator:
    """The base's true state, which a simulated robot sends if it is told to: for tests."""

    name = "the simulated robot's true base"
    sure = CERTAIN

    def __init__(self, robot: Robot) -> None:
        self._robot = robot

    def reset(self) -> None:
        """Nothing is remembered."""

    def update(self, reading: Reading) -> tuple[Array, Array]:
        """Return the true base with the measured joints."""
        truth = reading.base_truth
        if truth is None:
            raise EstimateError("the robot does not send its base's true state (base_truth)")
        q = configuration(self._robot, truth.pose, reading.position)
        return q, np.concatenate((truth.velocity, reading.velocity))


class SensorEstimator:
    """IMU, encoders and motor torques, by a :class:`~wbc.estimation.StateEstimator`.

    Its IMU is at the base.
    """

    name = "IMU, encoders and torques"

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._estimator = StateEstimator(robot)
        self.sure = CERTAIN

    def reset(self) -> None:
        """Forget everything: the robot stands still, from now on for half a second."""
        self._estimator.reset()

    def update(self, reading: Reading) -> tuple[Array, Array]:
        """Return the estimate at a reading; until it stood still for a while, there is none."""
        imu = ImuReading("imu", reading.angular_velocity, reading.specific_force)
        measurement = Measurement(
            reading.time, reading.position, reading.velocity, reading.torque, (imu,)
        )
        estimate = self._estimator.update(measurement)
        if estimate is None:
            raise EstimateError(f"the estimator: {self._estimator.kept_by}")
        e = estimate
        deviations = e.tilt_deviation, e.yaw_deviation, e.velocity_deviation, e.position_deviation
        self.sure = Sureness(deviations, e.contacts)
        return estimate.q, estimate.v


def configuration(robot: Robot, pose: Array, joints: Array) -> Array:
    """Return the configuration (nq,) of a base's pose (7,) and joint positions (nv-6,)."""
    q = np.empty(robot.nq)
    q[:BASE_NQ] = pose
    robot.limits.write_positions(q, joints)
    return q


@dataclass(frozen=True, eq=False)
class ControllerAnswer:
    """What came of a reading.

    Attributes
    ----------
    command:
        For the robot; None: no tick was asked for.
    q, v:
        The estimate, in the problem's world.
    ok:
        Whether the tick has a solution.
    report:
        Why not.
    at_rest:
        Whether the robot stands on both feet; problems that are no walks always do.
    sure:
        How surely the estimate is known.
    """

    command: Command | None
    q: Array
    v: Array
    ok: bool = True
    report: str = ""
    at_rest: bool = True
    sure: Sureness = CERTAIN


class RobotController:
    """Estimates, leads and commands; serves one run.

    Parameters
    ----------
    supervisor:
        Of a problem of the torque level.
    estimator:
        Of the base.
    start:
        Configuration (nq,) at which the problem begins: the estimate is moved over the ground, and
        turned about the vertical, so that the robot is there when it begins to run.
    following:
        Gains kd (n,) of the joints about the velocities of each tick [N m s/rad].
    stiffness:
        Gains kp (n,) that fade when it begins.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        estimator: BaseEstimator,
        start: Array,
        following: Array,
        stiffness: Array,
    ) -> None:
        self.supervisor, self.estimator = supervisor, estimator
        self.robot: Robot = supervisor.controller.robot
        self.dt = supervisor.controller.dt
        self._start, self._kd, self._kp = start, following, stiffness
        self._ticks, self._began = 0, 0.0
        self._turn: Array = np.eye(3)
        self._shift = np.zeros(3)
        self._held: Array = start[BASE_NQ:]

    def stand(self) -> None:
        """Begin to estimate: the robot stands still, on its feet."""
        self.estimator.reset()

    def observe(self, reading: Reading) -> ControllerAnswer:
        """Estimate only, before it runs."""
        q, v = self.estimator.update(reading)
        return ControllerAnswer(None, q, v, sure=self.estimator.sure)

    def begin(self, reading: Reading) -> None:
        """Begin to run: the robot stands, on its feet."""
        self._ticks, self._began = 0, reading.time
        q, _ = self.estimator.update(reading)
        there, here = (yaw_of(rotation_from(one[3:7])) for one in (self._start, q))
        self._turn = turned(there - here)
        soles = self._soles(q) - self._soles(self._start)
        moved = self._turn @ q[:3]
        self._shift = np.array((*(self._start[:2] - moved[:2]), -soles))
        self._held = reading.position

    def command(self, reading: Reading) -> ControllerAnswer:
        """Return the command for a reading.

        Raises
        ------
        EstimateError
            There is no estimate.
        WbcError
            The controller refuses it.
        """
        q, v = self.estimator.update(reading)
        q = q.copy()
        q[:3] = self._turn @ q[:3] + self._shift
        q[3:7] = quaternion_from(self._turn @ rotation_from(q[3:7]))
        snapshot = self.robot.snapshot(q, v)
        # By the robot's clock: ticks that were not made in time are left out, not made up for.
        self._ticks = max(round((reading.time - self._began) / self.dt), self._ticks)
        controller = self.supervisor.update(self._ticks, snapshot)
        if controller is None:
            raise WbcError(self.supervisor.complaint or "the problem has come to its end")
        tick = controller.step(snapshot)
        if not isinstance(tick, TorqueTick):
            raise InvalidInputError(
                f"hardware: a {type(controller).__name__} commands no torques; a problem for a"
                " robot is one of the torque level (controller: {level: torque}, or a gait)"
            )
        left = max(1.0 - self._ticks * self.dt / FADE, 0.0)
        self._ticks += 1
        rates = tick.velocity[BASE_NV:]
        command = Command(0, self._held, rates, tick.torque, left * self._kp, self._kd)
        ok = tick.ok or tick.policy in SOLVED_OR_RELAXED
        report = "" if ok else tick.report()
        return ControllerAnswer(command, q, v, ok, report, self.is_at_rest, self.estimator.sure)

    def come_to_rest(self) -> None:
        """Stop walking; other problems go on."""
        if isinstance(self.supervisor, ScheduledWalk):
            self.supervisor.stop()

    @property
    def is_at_rest(self) -> bool:
        """Whether it stands on both feet."""
        if not isinstance(self.supervisor, ScheduledWalk):
            return True
        return isinstance(self.supervisor.walker.phase, Standing)

    @property
    def notes(self) -> Sequence[str]:
        """What the supervisor has to say in the end."""
        return self.supervisor.notes

    def _soles(self, q: Array) -> float:
        """Return the height of the lowest sole [m]."""
        s = self.robot.snapshot(q)
        frames = [foot.frame for foot in self.robot.feet.values()]
        return min(float(s.position(frame)[2]) for frame in frames) if frames else 0.0
