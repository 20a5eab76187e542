"""The safety layer: limits on commands, and the reaction to faults.

It is independent of the controller. In each cycle it gets the measurements and faults
(:meth:`Safety.report`), judges by one table (:data:`RULES`), changes its mode by another
(:data:`TRANSITIONS`), and passes commands within limits only (:meth:`Safety.admit`).
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import replace
from enum import IntEnum, StrEnum
from types import MappingProxyType
from typing import NamedTuple, Self

import numpy as np

from wbc.errors import InvalidInputError, WbcError
from wbc.hardware.bus import Command, Reading, rows_of
from wbc.hardware.safety_limits import SafetyLimits
from wbc.kinds import check_kind
from wbc.rotations import rotation_from
from wbc.validate import Array, Bools, finite_array, finite_number

# ---------------------------------------------------------------------- modes


class Mode(StrEnum):
    """The mode of the robot."""

    IDLE = "idle"  # motors off
    DAMPING = "damping"  # joints brake
    STANDING_UP = "standing up"  # joints move to the posture at the start
    RUNNING = "running"  # the controller commands
    SOFT_STOP = "soft stop"  # joints move down to a crouch
    STOP = "stop"  # joints brake until a manual reset


TRANSITIONS: Mapping[Mode, frozenset[Mode]] = MappingProxyType(
    {
        Mode.IDLE: frozenset({Mode.DAMPING}),  # armed by hand
        Mode.DAMPING: frozenset({Mode.IDLE, Mode.STANDING_UP, Mode.STOP}),
        Mode.STANDING_UP: frozenset({Mode.RUNNING, Mode.SOFT_STOP, Mode.STOP}),
        Mode.RUNNING: frozenset({Mode.SOFT_STOP, Mode.STOP}),
        Mode.SOFT_STOP: frozenset({Mode.DAMPING, Mode.STOP}),  # once it is down
        Mode.STOP: frozenset({Mode.IDLE}),  # reset by hand
    }
)
"""The allowed transitions. All modes that move the robot lead to a soft stop or a stop."""

# ---------------------------------------------------------------------- faults


class Answer(IntEnum):
    """The answer to a fault, in order of severity."""

    NOTE = 0  # counted and logged
    SOFT_STOP = 1
    STOP = 2


class Rule(NamedTuple):
    """An answer, and how long a fault is tolerated before it [s]; meanwhile commands are held."""

    answer: Answer
    patience: float = 0.0


class Fault(StrEnum):
    """What can go wrong, and the rule for it."""

    rule: Rule

    def __new__(cls, text: str, answer: Answer, patience: float = 0.0) -> Self:
        """Make a fault of its words and its rule."""
        fault = str.__new__(cls, text)
        fault._value_, fault.rule = text, Rule(answer, patience)
        return fault

    # Dropped readings count as lost: they add to SILENT, which stops.
    SILENT = "no usable reading", Answer.STOP, 0.020
    NOT_FINITE = "reading with NaN", Answer.STOP, 0.020
    OUT_OF_ORDER = "reading repeated or out of order", Answer.NOTE
    OLD_READING = "reading too old", Answer.STOP, 0.020
    CLOCK_JUMPED = "the robot's clock jumped", Answer.STOP, 0.020
    IMPLAUSIBLE = "reading beyond the possible", Answer.STOP, 0.010
    JUMPED = "position jumped", Answer.STOP, 0.010
    # Sensors that contradict each other: which one is wrong is unknown.
    IMU_FROZEN = "IMU frozen", Answer.STOP, 0.020
    ENCODER_DISAGREES = "position and velocity of a joint disagree", Answer.STOP, 0.020
    IMU_DISAGREES = "gyroscope and orientation disagree", Answer.STOP, 0.040
    GRAVITY_DISAGREES = "accelerometer and orientation disagree", Answer.STOP, 0.050
    TORQUE_DISAGREES = "torque is not what was commanded", Answer.STOP, 0.100
    # The robot as measured.
    POSITION = "joint out of range", Answer.SOFT_STOP, 0.020
    VELOCITY = "joint too fast", Answer.STOP, 0.010
    OVERLOAD = "torque beyond the limit", Answer.SOFT_STOP, 0.100
    WARM = "motor warm", Answer.SOFT_STOP, 0.200
    HOT = "motor hot", Answer.STOP, 0.050
    TILT = "tilted", Answer.STOP, 0.006
    # The controller, which a crouch does not need.
    COMMAND_NOT_FINITE = "command with NaN", Answer.SOFT_STOP, 0.006
    CLIPPED = "command clipped", Answer.NOTE
    NO_COMMAND = "no command in time", Answer.SOFT_STOP, 0.030
    TICK_FAILED = "tick without solution", Answer.SOFT_STOP, 0.010
    CONTROLLER_RAISED = "controller raised", Answer.SOFT_STOP
    ESTIMATOR_FAILED = "no estimate", Answer.SOFT_STOP, 0.020
    # The machine.
    LATE_CYCLE = "late cycle", Answer.SOFT_STOP, 0.020
    STALLED = "process stalled", Answer.STOP
    BUS_FAILED = "command could not be sent", Answer.STOP, 0.020
    BUTTON = "stop button", Answer.STOP


RULES: Mapping[Fault, Rule] = MappingProxyType({fault: fault.rule for fault in Fault})
"""The answer to each fault. The tolerated time of an intermittent fault adds up: it decays at
half the rate at which it grows, and is at most the rule's patience."""


class Event(NamedTuple):
    """A change of mode, or the beginning of a fault."""

    time: float  # of the loop's clock [s]
    what: str
    mode: Mode  # afterwards
    answer: Answer = Answer.NOTE


REQUESTED = "asked to "  # beginning of the words of a requested change of mode


class ForbiddenTransition(WbcError):
    """The present mode does not lead to the requested one."""


# ---------------------------------------------------------------------- the layer

MAX_MAGNITUDE = 1e9  # rad or m, and per second, so that products with gains stay finite


class Safety:
    """Judges faults, has the mode, and limits commands.

    Parameters
    ----------
    limits:
        Of this robot.
    damping:
        Gains kd (n,) of braking [N m s/rad].
    dt:
        Period of the loop [s].

    Attributes
    ----------
    mode:
        The present one, idle at first.
    events:
        The last ones, in order.
    counts:
        Number of cycles with each fault.
    """

    def __init__(self, limits: SafetyLimits, damping: Array, dt: float) -> None:
        check_kind("safety, limits", limits, SafetyLimits, "SafetyLimits.of(robot, kp, kd)")
        self.damping = finite_array("safety, damping", damping, (len(limits.names),))
        if not (self.damping >= 0.0).all():
            raise InvalidInputError("safety, damping: must not be negative: joints would speed up")
        self.limits, self.dt = limits, finite_number("safety, dt", dt, above=0.0)
        self._endless = np.isinf(limits.lower) & np.isinf(limits.upper)
        self.mode = Mode.IDLE
        self.events = deque[Event](maxlen=1000)
        self.counts = Counter[Fault]()
        self._brake = Command.damping(np.minimum(self.damping, limits.kd))
        self._off = Command.damping(self.damping, enabled=False)
        self._reported = dict[Fault, str]()  # reported in this cycle
        self._fault_time = dict[Fault, float]()  # tolerated so far [s]
        self._measured: tuple[Array, Array] | None = None
        self._last = self._off

    # ------------------------------------------------------------------ modes

    def arm(self, now: float) -> None:
        """Power the motors, which brake: manually only."""
        self._change_mode(Mode.DAMPING, now, "armed by hand")

    def reset(self, now: float) -> None:
        """Switch the motors off: manually only."""
        self._change_mode(Mode.IDLE, now, "reset by hand")
        self._fault_time.clear()

    def stand_up(self, now: float) -> None:
        """Begin to stand up.

        Raises
        ------
        ForbiddenTransition
            Not from this mode, or while there is a fault.
        """
        faults = [f for f in self._fault_time if RULES[f].answer > Answer.NOTE]
        if faults or self._measured is None:
            why = ", ".join(faults) or "no reading yet"
            raise ForbiddenTransition(f"cannot stand up: {why}")
        self._change_mode(Mode.STANDING_UP, now, "asked to stand up")

    def run(self, now: float) -> None:
        """Pass the controller's commands from now on."""
        self._change_mode(Mode.RUNNING, now, "the controller commands")

    def soft_stop(self, now: float, why: str = "asked to stop") -> None:
        """Go down to a crouch."""
        self._change_mode(Mode.SOFT_STOP, now, why)

    def is_down(self, now: float) -> None:
        """Brake, when the crouch is reached."""
        self._change_mode(Mode.DAMPING, now, "the crouch is reached")

    def stop(self, now: float, why: str = "asked to stop at once") -> None:
        """Brake at once, until :meth:`reset`; no effect in idle."""
        if self.mode not in (Mode.IDLE, Mode.STOP):
            self._change_mode(Mode.STOP, now, why)

    def _change_mode(self, mode: Mode, now: float, why: str) -> None:
        if mode not in TRANSITIONS[self.mode]:
            allowed = ", ".join(sorted(TRANSITIONS[self.mode]))
            raise ForbiddenTransition(f"{mode} is not allowed in {self.mode}; from here: {allowed}")
        self.mode = mode
        answer = {Mode.SOFT_STOP: Answer.SOFT_STOP, Mode.STOP: Answer.STOP}.get(mode, Answer.NOTE)
        self.events.append(Event(now, why, mode, answer))

    # ------------------------------------------------------------------ faults

    @property
    def present(self) -> tuple[Fault, ...]:
        """The present faults, whatever their reaction."""
        return tuple(self._fault_time)

    def report(self, fault: Fault, detail: str = "") -> None:
        """Report a fault in this cycle."""
        self._reported[fault] = detail

    def measured(self, reading: Reading) -> None:
        """Check a usable reading: joints, motors, tilt, button."""
        limits, q, v = self.limits, reading.position, reading.velocity
        if rows_of(len(limits.names), q, v, reading.torque, reading.temperature) is None:
            self.report(Fault.NOT_FINITE, f"not of {len(limits.names)} joints")
            return
        if not (np.abs([q, v]) < MAX_MAGNITUDE).all():  # NaN, too
            self.report(Fault.NOT_FINITE, "position or velocity")
            return
        turns = rows_of(4, reading.quaternion)
        if turns is None or not turns.any():  # zeros would count as upright
            self.report(Fault.NOT_FINITE, "orientation")
            return
        self._measured = q, v
        overrun = np.maximum(q - limits.upper, limits.lower - q)
        self._worst(Fault.POSITION, overrun, limits.overrun)
        self._worst(Fault.VELOCITY, np.abs(v) - limits.overspeed * limits.velocity, 0.0)
        self._worst(Fault.OVERLOAD, np.abs(reading.torque) - limits.overload * limits.effort, 0.0)
        self._worst(Fault.WARM, reading.temperature, limits.warm)
        self._worst(Fault.HOT, reading.temperature, limits.hot)
        vertical = float(rotation_from(reading.quaternion)[2] @ limits.up)
        if not vertical >= np.cos(limits.tilt):  # NaN, too
            self.report(Fault.TILT, f"by more than {limits.tilt:g} rad")
        if reading.stop:
            self.report(Fault.BUTTON)

    def _worst(self, fault: Fault, values: Array, limit: float) -> None:
        k = int(values.argmax())
        if not values[k] <= limit:  # NaN, too, which argmax returns first
            self.report(fault, self.limits.names[k])

    def judge(self, now: float) -> Mode:
        """End a cycle's reports: change the mode if a fault has lasted too long."""
        answer, cause = Answer.NOTE, ""
        for fault, detail in self._reported.items():
            rule = RULES[fault]
            if fault not in self._fault_time:
                what = f"{fault}: {detail}" if detail else str(fault)
                self.events.append(Event(now, what, self.mode))
            self.counts[fault] += 1
            duration = min(self._fault_time.get(fault, 0.0), rule.patience) + self.dt
            self._fault_time[fault] = duration
            if duration > rule.patience + 1e-9 and rule.answer > answer:
                answer, cause = rule.answer, f"{fault} {detail}".rstrip()
        for fault in self._fault_time.keys() - self._reported.keys():
            self._fault_time[fault] -= 0.5 * self.dt
            if self._fault_time[fault] <= 0.0:
                del self._fault_time[fault]
        self._reported.clear()
        if answer is Answer.STOP:
            self.stop(now, cause)
        elif answer is Answer.SOFT_STOP and Mode.SOFT_STOP in TRANSITIONS[self.mode]:
            self.soft_stop(now, cause)
        return self.mode

    # ------------------------------------------------------------------ commands

    def admit(self, wanted: Command | None) -> Command:
        """Return the command for the robot: ``wanted`` within limits; the last one if None.

        For any input the result is finite; positions, gains, velocities and torques are within
        limits; so is the motors' total torque at the last reading, unless joints only brake; and
        the rates of targets and torques are limited.
        """
        if self.mode is Mode.IDLE:
            return self._remember(self._off)
        if self.mode in (Mode.DAMPING, Mode.STOP) or self._measured is None:
            return self._remember(self._brake)
        q, v = self._measured
        if wanted is None:
            return self._hold_last(q, v)
        n, values = len(self.limits.names), (wanted.position, wanted.velocity, wanted.torque)
        rows = rows_of(n, *values, wanted.kp, wanted.kd)
        if rows is None or not np.isfinite(rows).all():
            self.report(Fault.COMMAND_NOT_FINITE, f"not of {n} joints" if rows is None else "")
            return self._hold_last(q, v)
        limits, last = self.limits, self._last
        position, velocity, torque, kp, kd = rows
        position = nearest_turn(position, q, self._endless)
        kp, kd = np.clip(kp, 0.0, limits.kp), np.clip(kd, 0.0, limits.kd)
        max_change = limits.velocity * self.dt
        reference = np.where(last.kp > 0.0, nearest_turn(last.position, q, self._endless), q)
        position = np.clip(position, reference - max_change, reference + max_change)
        position = np.clip(position, limits.lower, limits.upper)
        velocity = np.clip(velocity, -limits.velocity, limits.velocity)
        if not (np.abs([position, velocity]) < MAX_MAGNITUDE).all():  # of joints without limits
            self.report(Fault.COMMAND_NOT_FINITE, "position or velocity")
            return self._hold_last(q, v)
        max_torque_change = limits.torque_rate * self.dt
        torque = np.clip(torque, last.torque - max_torque_change, last.torque + max_torque_change)
        command = Command(wanted.sequence, position, velocity, torque, kp, kd)
        command = self._within_effort(command, q, v)
        if np.abs(command.torque - rows[2]).max() > 1e-6:
            self.report(Fault.CLIPPED)
        return self._remember(command)

    def _hold_last(self, q: Array, v: Array) -> Command:
        """Return the last command, its torque limited at the present state."""
        position = nearest_turn(self._last.position, q, self._endless)
        if not np.array_equal(position, self._last.position):
            self._last = replace(self._last, position=position)
        over = np.abs(self._last.motor_torque(q, v)) > self.limits.effort + 1e-9
        return self._remember(self._within_effort(self._last, q, v)) if over.any() else self._last

    def _within_effort(self, command: Command, q: Array, v: Array) -> Command:
        """Return a command with gains and torque scaled to the effort limits at (q, v)."""
        kp, kd, effort = command.kp, command.kd, self.limits.effort
        feedback = kp * (command.position - q) + kd * (command.velocity - v)
        share = np.minimum(1.0, effort / np.maximum(np.abs(feedback), 1e-9))
        kp, kd, feedback = share * kp, share * kd, share * feedback
        torque = np.clip(command.torque + feedback, -effort, effort) - feedback
        return replace(command, torque=np.clip(torque, -effort, effort), kp=kp, kd=kd)

    def _remember(self, command: Command) -> Command:
        self._last = command
        return command


def nearest_turn(position: Array, to: Array, endless: Bools) -> Array:
    """Return positions (n,) [rad], those of ``endless`` joints in the turn nearest to others (n,).

    Encoders of joints without a range begin anew after a turn: what is half a turn or more away is
    nearer the other way round. What is too far to be a position stays.
    """
    way = position - to
    turns = np.where(endless & (np.abs(way) < MAX_MAGNITUDE), np.rint(way / math.tau), 0.0)
    return np.asarray(position - math.tau * turns)
