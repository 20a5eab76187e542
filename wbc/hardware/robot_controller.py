"""From a reading to a command: estimate the state, update the supervisor, tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from wbc.controllers.torque_tick import TorqueTick
from wbc.errors import InvalidInputError, WbcError
from wbc.estimation import ImuMount, ImuReading, Measurement, StateEstimator
from wbc.estimation.estimate import count_notes, frequent_notes
from wbc.gait.phases import Standing
from wbc.gait.scheduled_walk import ScheduledWalk
from wbc.gait.swing import turned
from wbc.hardware.bus import Command, Reading
from wbc.hardware.postures import bearing_forces
from wbc.robot import Robot
from wbc.robot.limits import BASE_NQ, BASE_NV
from wbc.rotations import quaternion_from, rotation_from
from wbc.run.supervisor import BEFORE_START, Supervisor
from wbc.validate import Array

STIFFNESS_FADE = 0.3  # s in which the stiffness of standing up fades
USABLE_POLICIES = (None, "relax")


class EstimateError(WbcError):
    """There is no estimate of the base for a reading."""


class StateUncertainty(NamedTuple):
    """Uncertainty of the base's state."""

    # standard deviations (4,) of tilt and heading [rad], velocity [m/s] and position [m]
    deviations: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    feet: tuple[str, ...] = ()  # the contacts that the estimate uses


EXACT = StateUncertainty()


class BaseEstimator(Protocol):
    """An estimator for the loop; ``sure`` is the uncertainty of its last answer."""

    name: str
    sure: StateUncertainty

    @property
    def notes(self) -> Sequence[str]:
        """What it rejected or guessed so far, in words."""

    def reset(self) -> None:
        """Restart: the robot stands still on its feet."""

    def update(self, reading: Reading) -> tuple[Array, Array]:
        """Return configuration (nq,) and velocity (nv,) at a reading.

        Raises EstimateError: there is none.
        """


class TruthEstimator:
    """The base's true state, from a simulated robot that sends it: for tests."""

    name = "the simulated robot's true base"
    sure = EXACT
    notes = ()

    def __init__(self, robot: Robot) -> None:
        self._robot = robot

    def reset(self) -> None:
        """Nothing to reset."""

    def update(self, reading: Reading) -> tuple[Array, Array]:
        """Return the true base with the measured joints."""
        truth = reading.base_truth
        if truth is None:
            raise EstimateError("the robot does not send its base's true state (base_truth)")
        q = configuration(self._robot, truth.pose, reading.position)
        return q, np.concatenate((truth.velocity, reading.velocity))


class SensorEstimator:
    """IMU, encoders and motor torques, by a :class:`~wbc.estimation.StateEstimator`.

    Parameters
    ----------
    imu:
        Mount of the IMU whose readings come; None: at the base, with its axes.
    """

    name = "IMU, encoders and torques"

    def __init__(self, robot: Robot, imu: ImuMount | None = None) -> None:
        self._robot, self._told = robot, dict[str, int]()
        self._estimator = StateEstimator(robot, imu or ImuMount())
        self.sure = EXACT
        self._last: tuple[Reading, Array, Array] | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """What the estimator rejected or guessed, and how often."""
        return frequent_notes(self._told)

    def reset(self) -> None:
        """Restart: the robot stands still, from now on for half a second."""
        self._estimator.reset()
        self._last = None

    def update(self, reading: Reading) -> tuple[Array, Array]:
        """Return the estimate at a reading, after the robot stood still for a while."""
        if self._last is not None and self._last[0] is reading:  # the controller begins with it
            return self._last[1:]
        name = self._estimator.imus[0].name
        imu = ImuReading(name, reading.angular_velocity, reading.specific_force)
        measurement = Measurement(
            reading.time, reading.position, reading.velocity, reading.torque, (imu,)
        )
        e = self._estimator.update(measurement)
        if e is None:
            raise EstimateError(f"the estimator: {self._estimator.kept_by}")
        count_notes(self._told, e.notes)
        deviations = e.tilt_deviation, e.yaw_deviation, e.velocity_deviation, e.position_deviation
        self.sure = StateUncertainty(deviations, e.contacts)
        self._last = reading, e.q, e.v
        return e.q, e.v


def configuration(robot: Robot, pose: Array, joints: Array) -> Array:
    """Return the configuration (nq,) of a base's pose (7,) and joint positions (nv-6,)."""
    q = np.empty(robot.nq)
    q[:BASE_NQ] = pose
    robot.limits.write_positions(q, joints)
    return q


@dataclass(frozen=True, eq=False)
class ControllerAnswer:
    """The controller's answer to a reading."""

    command: Command | None  # for the robot; None: only an estimate was requested
    # the estimate, in the problem's world
    q: Array
    v: Array
    ok: bool = True  # whether the tick has a solution
    report: str = ""  # why not
    # whether the robot stands on both feet; True for problems that are no walks
    at_rest: bool = True
    sure: StateUncertainty = EXACT  # uncertainty of the estimate
    load: float = 0.0  # part of the weight that the feet bear, until the problem begins


class RobotController:
    """Estimates, supervises and commands; serves one run.

    Parameters
    ----------
    make_supervisor:
        Returns the supervisor of a problem of the torque level, at its start.
    estimator:
        Of the base.
    start:
        Configuration (nq,) at which the problem begins: the estimate is shifted and turned about
        the vertical, so that the soles are there when the controller begins to command.
    following:
        Gains kd (n,) about the velocities of each tick [N m s/rad].
    stiffness:
        Gains kp (n,) that fade at the beginning.
    """

    def __init__(
        self,
        make_supervisor: Callable[[], Supervisor],
        estimator: BaseEstimator,
        start: Array,
        following: Array,
        stiffness: Array,
    ) -> None:
        self._make_supervisor, self.estimator = make_supervisor, estimator
        self.supervisor = make_supervisor()
        self.robot: Robot = self.supervisor.controller.robot
        self.dt = self.supervisor.controller.dt
        self._notes, self._is_used = tuple[str, ...](), False
        self._start, self._kd, self._kp = start, following, stiffness
        self._ticks, self._start_time, self._begin_time, self._has_begun = 0, 0.0, 0.0, False
        self._rotation: Array = np.eye(3)
        self._shift = np.zeros(3)
        self._held_position: Array = start[BASE_NQ:]

    def stand(self) -> None:
        """Begin to estimate, and the problem anew: the robot stands still on its feet."""
        self.estimator.reset()
        if self._is_used:
            self._notes = (*self._notes, *self.supervisor.notes)
            self.supervisor, self._is_used = self._make_supervisor(), False

    def observe(self, reading: Reading) -> ControllerAnswer:
        """Estimate only."""
        q, v = self.estimator.update(reading)
        load = self._load(q, reading.torque)
        return ControllerAnswer(None, q, v, sure=self.estimator.sure, load=load)

    def begin(self, reading: Reading) -> None:
        """Begin to command: the robot stands on its feet."""
        self._ticks, self._begin_time, self._has_begun = 0, reading.time, False
        q, _ = self.estimator.update(reading)
        (goal, goal_yaw), (actual, yaw) = (stance_of(self.robot, one) for one in (self._start, q))
        self._rotation = turned(goal_yaw - yaw)
        self._shift = goal - self._rotation @ actual
        self._held_position, self._is_used = reading.position, True

    def command(self, reading: Reading, waits: bool = False) -> ControllerAnswer:
        """Return the command for a reading.

        Parameters
        ----------
        waits:
            The robot balances where the problem begins, which does not begin yet.

        Raises
        ------
        EstimateError
            There is no estimate.
        WbcError
            The controller refuses it.
        """
        if not self._is_used:  # as there was no estimate where it was to begin
            self.begin(reading)
        q, v = self.estimator.update(reading)
        load = self._load(q, reading.torque) if waits else 1.0
        q = q.copy()
        q[:3] = self._rotation @ q[:3] + self._shift
        q[3:7] = quaternion_from(self._rotation @ rotation_from(q[3:7]))
        snapshot = self.robot.snapshot(q, v)
        if not (waits or self._has_begun):
            self._has_begun, self._start_time = True, reading.time
        if not waits:  # by the robot's clock: missed ticks are skipped
            self._ticks = max(round((reading.time - self._start_time) / self.dt), self._ticks)
        controller = self.supervisor.update(BEFORE_START if waits else self._ticks, snapshot)
        if controller is None:
            raise WbcError(self.supervisor.complaint or "the problem has come to its end")
        tick = controller.step(snapshot)
        if not isinstance(tick, TorqueTick):
            raise InvalidInputError(
                f"hardware: a {type(controller).__name__} commands no torques; a problem for a"
                " robot is one of the torque level (controller: {level: torque}, or a gait)"
            )
        fade = max(1.0 - (reading.time - self._begin_time) / STIFFNESS_FADE, 0.0)
        self._ticks += not waits
        rates = tick.velocity[BASE_NV:]
        command = Command(0, self._held_position, rates, tick.torque, fade * self._kp, self._kd)
        ok = tick.ok or tick.policy in USABLE_POLICIES
        report = "" if ok else tick.report()
        sure, at_rest = self.estimator.sure, self.is_at_rest
        return ControllerAnswer(command, q, v, ok, report, at_rest, sure, load)

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
        """The supervisors' notes, and the estimator's."""
        return (*self._notes, *self.supervisor.notes, *self.estimator.notes)

    def _load(self, q: Array, torque: Array) -> float:
        """Return about which part of the weight the feet bear, by joints' torques (n,) at rest.

        That of the least wrenches that bear all of it. Wrenches by the torques themselves would be
        at the mercy of noise where legs are straight.
        """
        frames = [foot.frame for foot in self.robot.feet.values()]
        needed, borne = (part[BASE_NV:] for part in bearing_forces(self.robot.snapshot(q), frames))
        square = float(borne @ borne)
        return float(borne @ (needed - torque)) / square if square > 0.0 else 0.0


def stance_of(robot: Robot, q: Array) -> tuple[Array, float]:
    """Return the middle of the soles (3,) [m] and their heading [rad] at a configuration (nq,)."""
    s, frames = robot.snapshot(q), [foot.frame for foot in robot.feet.values()]
    ahead = np.sum([s.rotation(frame)[:, 0] for frame in frames], axis=0)
    middle = np.mean([s.position(frame) for frame in frames], axis=0)
    return middle, float(np.arctan2(ahead[1], ahead[0]))
