"""A simulated robot behind a bus: physics, motors at 1 kHz, messages, its own watchdog."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from wbc.hardware.bus import BaseTruth, Command, Reading, RobotBus
from wbc.hardware.gantry import Gantry
from wbc.hardware.real_time import CycleClock, now, real_time
from wbc.robot.limits import BASE_NQ, BASE_NV
from wbc.robot.names import BASE
from wbc.rotations import exp_rotation, quaternion_from, rotation_from
from wbc.run.saving import plain
from wbc.simulation import Plant
from wbc.validate import Array, check_fields, finite_array, finite_number

STEP = 0.001  # s: of physics and motors
MAX_CATCH_UP = 100  # largest number of steps made up for after a delay of the process
AMBIENT, HEATING, COOLING = 25.0, 60.0, 120.0  # degrees C, C at full torque, s


@dataclass(frozen=True)
class RobotSettings:
    """Settings of a simulated robot.

    Attributes
    ----------
    period:
        Between readings [s].
    patience:
        Of the watchdog [s]: without a command for longer it brakes, until it is commanded to.
    encoder:
        Resolution of the joints' positions [rad or m].
    velocity_noise, gyroscope_noise, accelerometer_noise, orientation_noise:
        Standard deviations [rad/s], [rad/s], [m/s^2], [rad].
    truth:
        Whether readings have the base's true state.
    gantry:
        Whether the robot hangs in straps at its crouch; see :class:`Gantry`.
    seed:
        Of the noise.
    """

    period: float = 0.002
    patience: float = 0.017
    encoder: float = 2.0 * np.pi / 2**16
    velocity_noise: float = 0.01
    gyroscope_noise: float = 0.003
    accelerometer_noise: float = 0.05
    orientation_noise: float = 0.0005
    truth: bool = False
    gantry: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        check_fields(self, "robot settings, ", "period", "patience", "encoder", above=0.0)


class RobotEvent(NamedTuple):
    """An event of the simulated robot, by the clock of the loop [s]."""

    time: float
    what: str


@dataclass
class RobotReport:
    """The report of a simulated robot.

    Attributes
    ----------
    events:
        Beginnings and ends of braking, and reasons.
    commands, damaged:
        Numbers of commands taken, and dropped.
    steps, late:
        Numbers of physics steps, and of those made up for later.
    latest:
        Largest lateness of a step [s].
    tilt:
        Largest [rad].
    path:
        Time [s], position of the base and height of the CoM (k, 5), ten a second.
    """

    events: list[RobotEvent] = field(default_factory=list)
    commands: int = 0
    damaged: int = 0
    steps: int = 0
    late: int = 0
    latest: float = 0.0
    tilt: float = 0.0
    path: list[tuple[float, ...]] = field(default_factory=list)

    @property
    def fell(self) -> bool:
        """Whether the trunk tilted by more than 1 rad."""
        return self.tilt > 1.0

    def to_data(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {**plain(self), "fell": self.fell}


class SimulatedRobot:
    """A robot in MuJoCo behind a bus.

    Parameters
    ----------
    plant:
        With a control period of 1 ms.
    bus:
        The robot's end.
    start:
        Configuration (nq,) at which it begins, in its gantry.
    damping:
        Gains (n,) of braking [N m s/rad].
    settings:
        Of its behaviour.
    imu:
        Frame of its IMU.
    """

    def __init__(
        self,
        plant: Plant,
        bus: RobotBus,
        start: Array,
        damping: Array,
        settings: RobotSettings | None = None,
        imu: str = BASE,
    ) -> None:
        self.plant, self.bus, self._imu = plant, bus, imu
        self.settings = settings or RobotSettings()
        self.report = RobotReport()
        self._brake = Command.damping(damping)
        self._command = Command.damping(damping, enabled=False)
        self._heard_at = -np.inf
        self._watchdog_tripped = False
        self._random = np.random.default_rng(self.settings.seed)
        self._sent, self._count = -np.inf, 0
        self._pushes = list[tuple[float, str, tuple[float, ...], float]]()
        self._temperature = np.full(len(damping), AMBIENT)
        plant.reset(start)
        self._gantry = Gantry(plant.robot, start) if self.settings.gantry else None
        q, v = plant.state()
        self._state = q, v
        self._velocity = self._imu_motion()[1]
        self._force_time = 0.0
        self._note(now(), "motors off")

    def run(
        self,
        duration: float = np.inf,
        *,
        cancelled: Callable[[], bool] = lambda: False,
        priority: int = 50,
        say: Callable[[str], None] = lambda text: None,
    ) -> RobotReport:
        """Run for a duration [s], by the clock, or until ``cancelled``."""
        with real_time(priority) as not_granted:
            for note in not_granted:
                say(note)
            clock = CycleClock(STEP)
            until = clock.due + duration
            while not cancelled():
                beat = clock.wait()
                catch_up = min(beat.missed, MAX_CATCH_UP)
                self.report.late += catch_up
                self.report.latest = max(self.report.latest, beat.lateness)
                for _ in range(1 + catch_up):
                    self.step(now())
                if beat.time >= until:
                    break
        self.bus.close()
        return self.report

    def push(self, at: float, body: str, force: Sequence[float], duration: float) -> None:
        """Push a body by (3,) [N], world axes, from ``at`` [s of the robot's clock] on."""
        self.plant.robot.frame_id(body)
        at = finite_number("simulated robot, push, at", at)
        duration = finite_number("simulated robot, push, duration", duration, above=0.0)
        force_ = finite_array("simulated robot, push, force", force, (3,))
        self._pushes.append((at, body, tuple(force_.tolist()), duration))
        self._pushes.sort()

    def step(self, now: float) -> None:
        """Take commands, make one step of the physics, send a reading when it is due."""
        self._take_command(now)
        q, v = self._state
        joints = self.plant.robot.limits.joint_positions(q)
        # Motors that are off brake as well: their windings are shorted.
        command = self._command if self._command.enabled else self._brake
        torque = command.motor_torque(joints, v[BASE_NV:])
        while self._pushes and self.plant.time >= self._pushes[0][0]:
            _, body, force, duration = self._pushes.pop(0)
            self.plant.push(body, force, duration=duration)
            self._note(now, f"pushed: {force} N on {body} for {duration:g} s")
        if self._gantry is not None:
            self._gantry.pull(self.plant, q, v)
        self.plant.step(torque)
        self._state = self.plant.state()
        load = self.plant.torque / self.plant.robot.limits.effort
        self._temperature += STEP / COOLING * (AMBIENT + HEATING * load**2 - self._temperature)
        self.report.steps += 1
        if self.plant.time - self._sent > self.settings.period - 0.5 * STEP:
            self._sent = self.plant.time
            self.bus.send(self._reading())
        self._update_report()

    # ------------------------------------------------------------------ commands

    def _take_command(self, now: float) -> None:
        command = self.bus.receive()
        report = self.report
        if command is not None and not _is_finite(command):
            report.damaged += 1
            command = None
        if command is not None:
            report.commands += 1
            self._heard_at = now
            if self._watchdog_tripped and command.is_passive:
                self._watchdog_tripped = False
                self._note(now, "braking as commanded")
            if not self._watchdog_tripped:
                self._note_change(now, command)
                self._command = command
        silent = now - self._heard_at > self.settings.patience
        if silent and not self._watchdog_tripped and self._command.enabled:
            self._watchdog_tripped = True
            self._command = self._brake
            self._note(now, f"damping: no command for {1e3 * (now - self._heard_at):.1f} ms")

    def _note_change(self, now: float, command: Command) -> None:
        """Note when motors are switched on, and when a command does more than brake."""
        before = self._command
        if command.enabled != before.enabled:
            self._note(now, "motors on" if command.enabled else "motors off")
        if command.is_passive != before.is_passive and command.enabled:
            self._note(now, "braking as commanded" if command.is_passive else "commanded")

    def _note(self, now: float, what: str) -> None:
        self.report.events.append(RobotEvent(now, what))

    # ------------------------------------------------------------------ what acts and is felt

    def _reading(self) -> Reading:
        (q, v), s, draw = self._state, self.settings, self._random.normal
        n, robot = len(self._temperature), self.plant.robot
        R, velocity, turning = self._imu_motion()
        elapsed = self.plant.time - self._force_time
        rate = (velocity - self._velocity) / elapsed if elapsed > 0.0 else np.zeros(3)
        self._velocity, self._force_time = velocity, self.plant.time
        force = R.T @ (rate - np.array(robot.model.gravity.linear))
        joints = robot.limits.joint_positions(q)
        w = s.orientation_noise * draw(size=3)
        self._count += 1
        return Reading(
            self._count,
            self.plant.time,
            np.round(joints / s.encoder) * s.encoder,
            v[BASE_NV:] + s.velocity_noise * draw(size=n),
            self.plant.torque.copy(),
            self._temperature.copy(),
            quaternion_from(R @ exp_rotation(w)),
            turning + s.gyroscope_noise * draw(size=3),
            force + s.accelerometer_noise * draw(size=3),
            base_truth=BaseTruth(q[:BASE_NQ].copy(), v[:BASE_NV].copy()) if s.truth else None,
        )

    def _imu_motion(self) -> tuple[Array, Array, Array]:
        """Return the IMU's rotation (3, 3), velocity (3,) [m/s], and angular velocity (3,) [rad/s].

        The last is in its own axes.
        """
        q, v = self._state
        if self._imu == BASE:
            R = rotation_from(q[3:7])
            return R, R @ v[:3], v[3:6]
        now = self.plant.robot.snapshot(q, v)
        R, twist = now.rotation(self._imu), now.jacobian(self._imu) @ v
        return R, twist[:3], R.T @ twist[3:]

    def _update_report(self) -> None:
        report, (q, _) = self.report, self._state
        x, y = float(q[3]), float(q[4])
        report.tilt = max(report.tilt, float(np.arccos(np.clip(1 - 2 * (x * x + y * y), -1, 1))))
        if report.steps % 100 == 0:
            height = float(self.plant.com[2])
            report.path.append((self.plant.time, *q[:3].tolist(), height))


def _is_finite(command: Command) -> bool:
    c = command
    return bool(np.isfinite(np.concatenate((c.position, c.velocity, c.torque, c.kp, c.kd))).all())
