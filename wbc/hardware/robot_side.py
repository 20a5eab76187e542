"""A process that behaves as a robot does: physics, motors at 1 kHz, messages, its own watchdog."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from wbc.hardware.bus import BaseTruth, Command, Reading, RobotBus
from wbc.hardware.gantry import Gantry
from wbc.hardware.real_time import CycleClock, now, real_time
from wbc.robot.limits import BASE_NQ, BASE_NV
from wbc.rotations import exp_rotation, quaternion_from, rotation_from
from wbc.run.saving import plain
from wbc.simulation import Plant
from wbc.validate import Array, check_fields, finite_array, finite_number

STEP = 0.001  # s: of physics and motors
CATCH_UP = 100  # steps that are made up for at most, where the process was kept waiting
AMBIENT, HEATING, COOLING = 25.0, 60.0, 120.0  # degrees C, C at full torque, s


@dataclass(frozen=True)
class RobotSettings:
    """How a simulated robot behaves.

    Attributes
    ----------
    period:
        Between readings [s].
    patience:
        Without a command for longer it brakes [s], until it is told to brake.
    encoder:
        Resolution of the joints' positions [rad or m].
    velocity_noise, gyroscope_noise, accelerometer_noise, orientation_noise:
        Standard deviations [rad/s], [rad/s], [m/s^2], [rad].
    truth:
        Whether readings tell where the base really is.
    gantry:
        Whether the robot hangs in straps where it crouches; see :class:`Gantry`.
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
    """Something that the robot's side did, by the clock of the loop [s]."""

    time: float
    what: str


@dataclass
class RobotReport:
    """What a robot's side has to tell in the end.

    Attributes
    ----------
    events:
        When it began and ceased to brake, and why.
    commands, damaged:
        How many were taken, and thrown away.
    steps, late:
        Of the physics, and how many of them were made up for later.
    latest:
        The most that a step began late [s].
    fell:
        Whether the trunk tilted by more than 1 rad.
    tilt:
        The most [rad].
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
        Gains (n,) with which it brakes [N m s/rad].
    settings:
        How it behaves.
    """

    def __init__(
        self,
        plant: Plant,
        bus: RobotBus,
        start: Array,
        damping: Array,
        settings: RobotSettings | None = None,
    ) -> None:
        self.plant, self.bus = plant, bus
        self.settings = settings or RobotSettings()
        self.report = RobotReport()
        self._brake = Command.damping(damping)
        self._command = Command.damping(damping, enabled=False)
        self._heard = -np.inf
        self._tripped = False
        self._random = np.random.default_rng(self.settings.seed)
        self._sent, self._count = -np.inf, 0
        self._pushes = list[tuple[float, str, tuple[float, ...], float]]()
        self._temperature = np.full(len(damping), AMBIENT)
        plant.reset(start)
        self._gantry = Gantry(plant.robot, start) if self.settings.gantry else None
        q, v = plant.state()
        self._state = q, v
        self._velocity = rotation_from(q[3:7]) @ v[:3]
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
        """Live for so many seconds, by the clock, or until ``cancelled``."""
        with real_time(priority) as refused:
            for note in refused:
                say(note)
            clock = CycleClock(STEP)
            until = clock.due + duration
            while not cancelled():
                beat = clock.wait()
                extra = min(beat.missed, CATCH_UP)
                self.report.late += extra
                self.report.latest = max(self.report.latest, beat.lateness)
                for _ in range(1 + extra):
                    self.step(now())
                if beat.time >= until:
                    break
        self.bus.close()
        return self.report

    def push(self, at: float, body: str, force: Sequence[float], duration: float) -> None:
        """Push a body at a time of the robot's clock [s], for so long, by (3,) [N]; world axes."""
        self.plant.robot.frame_id(body)
        at = finite_number("simulated robot, push, at", at)
        duration = finite_number("simulated robot, push, duration", duration, above=0.0)
        pushed = finite_array("simulated robot, push, force", force, (3,))
        self._pushes.append((at, body, tuple(pushed.tolist()), duration))
        self._pushes.sort()

    def step(self, now: float) -> None:
        """Take commands, move by one step of the physics, send a reading when it is due."""
        self._listen(now)
        q, v = self._state
        joints = self.plant.robot.limits.joint_positions(q)
        # Motors that are off brake, too: their windings are shorted.
        acting = self._command if self._command.enabled else self._brake
        torque = acting.motor_torque(joints, v[BASE_NV:])
        while self._pushes and self.plant.time >= self._pushes[0][0]:
            _, body, force, duration = self._pushes.pop(0)
            self.plant.push(body, force, duration=duration)
            self._note(now, f"pushed: {force} N on {body} for {duration:g} s")
        if self._gantry is not None:
            self._gantry.pull(self.plant, q, v)
        self.plant.step(torque)
        self._state = self.plant.state()
        used = self.plant.torque / self.plant.robot.limits.effort
        self._temperature += STEP / COOLING * (AMBIENT + HEATING * used**2 - self._temperature)
        self.report.steps += 1
        if self.plant.time - self._sent > self.settings.period - 0.5 * STEP:
            self._sent = self.plant.time
            self.bus.send(self._reading())
        self._watch()

    # ------------------------------------------------------------------ commands

    def _listen(self, now: float) -> None:
        command = self.bus.receive()
        report = self.report
        if command is not None and not _is_finite(command):
            report.damaged += 1
            command = None
        if command is not None:
            report.commands += 1
            self._heard = now
            if self._tripped and command.is_passive:
                self._tripped = False
                self._note(now, "braking as commanded")
            if not self._tripped:
                self._changed(now, command)
                self._command = command
        silent = now - self._heard > self.settings.patience
        if silent and not self._tripped and self._command.enabled:
            self._tripped = True
            self._command = self._brake
            self._note(now, f"damping: no command for {1e3 * (now - self._heard):.1f} ms")

    def _changed(self, now: float, command: Command) -> None:
        """Note when motors are switched on, and when they begin to do more than brake."""
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
        R = rotation_from(q[3:7])
        velocity = R @ v[:3]
        passed = self.plant.time - self._force_time
        rate = (velocity - self._velocity) / passed if passed > 0.0 else np.zeros(3)
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
            v[3:6] + s.gyroscope_noise * draw(size=3),
            force + s.accelerometer_noise * draw(size=3),
            base_truth=BaseTruth(q[:BASE_NQ].copy(), v[:BASE_NV].copy()) if s.truth else None,
        )

    def _watch(self) -> None:
        report, (q, _) = self.report, self._state
        x, y = float(q[3]), float(q[4])
        report.tilt = max(report.tilt, float(np.arccos(np.clip(1 - 2 * (x * x + y * y), -1, 1))))
        if report.steps % 100 == 0:
            height = float(self.plant.com[2])
            report.path.append((self.plant.time, *q[:3].tolist(), height))


def _is_finite(command: Command) -> bool:
    parts: Sequence[Array] = (command.position, command.velocity, command.torque)
    return bool(np.isfinite(np.concatenate((*parts, command.kp, command.kd))).all())
