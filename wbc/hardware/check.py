"""Checks that the robot on a bus matches its model: rates, sensors, order and signs of joints."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import WbcError
from wbc.hardware.bus import Bus, Command, Reading, thrown_away
from wbc.hardware.loop import SILENCE
from wbc.hardware.real_time import CycleClock, now
from wbc.hardware.safety import Fault, Mode, Safety
from wbc.hardware.sensor_checks import SensorChecks
from wbc.minimum_jerk import minimum_jerk
from wbc.robot import Robot
from wbc.rotations import rotation_from
from wbc.validate import Array

MOVE_ANGLE = math.radians(2.0)
# Distance from its stops to which a joint is moved first [rad], and time for that [s].
STOP_MARGIN, OFF_STOP_TIME = 2.5 * MOVE_ANGLE, 1.5
MOVE_TIME, HOLD_TIME = 0.4, 0.2  # s: of a motion, and of holding before a measurement
MIN_RATIO, MAX_RATIO = 0.15, 2.0  # of a joint's measured motion by MOVE_ANGLE
# Largest motion of another joint by the joint's own: straps yield, so that both hips move.
MAX_COUPLING = 0.8
MAX_OVERRUN = 0.05  # rad or m of a joint beyond its range, as where it rests against its stop
MAX_JITTER = 0.5  # standard deviation of messages' intervals, by their period


class CheckFinding(NamedTuple):
    """What was checked, whether it is good, and what was measured."""

    what: str
    good: bool
    seen: str


@dataclass(frozen=True)
class CheckGains:
    """Gains that hold joints (n,): kp [N m/rad], kd [N m s/rad]."""

    kp: Array
    kd: Array


def listen(
    bus: Bus, robot: Robot, seconds: float = 2.0, *, up: ArrayLike = (0.0, 0.0, 1.0)
) -> list[CheckFinding]:
    """Listen without commanding; return findings about bus and sensors.

    ``up``: the axis of the IMU (3,) that is vertical when the robot stands.
    """
    checks, readings, refused = SensorChecks(robot), list[Reading](), list[str]()
    arrivals, until = list[float](), now() + seconds
    commands_heard = getattr(bus, "commands_heard", None)  # not on point-to-point buses
    while now() < until:
        reading = bus.read()
        if reading is None:
            time.sleep(2e-4)
            continue
        arrival = now()
        usable, findings = checks.look_at(reading, arrival)
        refused += [f"{one.fault}: {one.detail}" for one in findings]
        # A clock of another rate jumps at every reading: that is told by their rate.
        if usable or findings[0].fault is Fault.CLOCK_JUMPED:
            readings.append(reading)
            arrivals.append(arrival)
    if len(readings) < 10:
        first_fault = f"; first: {refused[0]}" if refused else ""
        raise WbcError(
            f"check: {len(readings)} usable readings in {seconds:g} s{first_fault}; is the robot on"
            f" this interface and in its low-level mode?{thrown_away(bus.dropped)}"
        )
    gaps, last = np.diff(arrivals), readings[-1]
    robot_gaps = np.diff([one.time for one in readings])
    period = float(np.median(robot_gaps))
    if not period > 0.0:
        raise WbcError(
            "check: most readings have the time of the one before: the robot's clock stands, or is"
            " too coarse; estimators drop such readings"
        )
    lost = int(np.round(robot_gaps / period - 1.0).clip(0).sum())
    found = [
        CheckFinding("rate", 0.0 < period <= 0.005, f"{1.0 / period:.0f} readings a second"),
        CheckFinding(
            "lost", lost <= 0.01 * len(readings), f"{lost} of {len(readings) + lost} readings"
        ),
        CheckFinding(
            "regular",
            float(np.std(gaps)) < MAX_JITTER * period,
            f"they come every {1e3 * np.mean(gaps):.2f} ms, give or take {1e3 * np.std(gaps):.2f}",
        ),
        CheckFinding("damaged", not bus.dropped["damaged"], f"{bus.dropped['damaged']} messages"),
        CheckFinding("believable", not refused, refused[0] if refused else "all readings"),
    ]
    if commands_heard is not None:
        others = commands_heard()
        seen = "commands of another program: end it" if others else "nobody else commands"
        found.append(CheckFinding("alone", not others, seen))
    return found + _check_at_rest(robot, readings, last, np.asarray(up))


def _check_at_rest(
    robot: Robot, readings: list[Reading], last: Reading, axis: Array
) -> list[CheckFinding]:
    limits = robot.limits
    overrun = np.maximum(last.position - limits.upper, limits.lower - last.position)
    worst = int(overrun.argmax())
    force = np.mean([one.specific_force for one in readings], axis=0)
    rate = float(np.linalg.norm(np.mean([one.angular_velocity for one in readings], axis=0)))
    size = float(np.linalg.norm(force))
    vertical = rotation_from(last.quaternion)[2]
    up, gravity = float(vertical @ axis), float(vertical @ (force / max(size, 1e-9)))
    tilt, angle = (math.degrees(math.acos(min(max(one, -1.0), 1.0))) for one in (up, gravity))
    return [
        CheckFinding(
            "range",
            bool(overrun[worst] <= MAX_OVERRUN),
            f"{robot.joint_names[worst]} is {abs(overrun[worst]):.3f} rad"
            f" {'outside' if overrun[worst] > 0.0 else 'inside'} its range",
        ),
        CheckFinding("upright", up > 0.8, f"tilted by {tilt:.1f} degrees"),
        CheckFinding(
            "gravity",
            angle < 6.0 and 9.0 < size < 10.6,
            f"{size:.2f} m/s^2, {angle:.1f} degrees off what the orientation says",
        ),
        CheckFinding("gyroscope", rate < 0.05, f"{rate:.3f} rad/s at rest"),
    ]


def move_joints(
    bus: Bus,
    robot: Robot,
    safety: Safety,
    gains: CheckGains,
    *,
    report: Callable[[CheckFinding], None] = lambda finding: None,
) -> list[CheckFinding]:
    """Hold all joints, and move each by 2 degrees and back; the robot must hang.

    A joint should move in the direction of its command, and no other one with it.

    Raises WbcError: the safety layer stopped the motion; the message says why.
    """
    mover = _Mover(bus, safety, SensorChecks(robot), gains)
    found = list[CheckFinding]()
    try:
        mover.begin()
        for k, name in enumerate(robot.joint_names):
            sign = 1.0 if mover.held[k] + MOVE_ANGLE < robot.limits.upper[k] else -1.0
            before = mover.hold()
            mover.move(k, sign * MOVE_ANGLE)
            moved = mover.hold() - before
            mover.move(k, 0.0)
            finding = _judge(name, k, sign, moved, robot.joint_names)
            found.append(finding)
            report(finding)
    finally:
        mover.end()
    return found


def _judge(name: str, k: int, sign: float, moved: Array, names: tuple[str, ...]) -> CheckFinding:
    own = sign * float(moved[k])
    others = np.abs(moved)
    others[k] = 0.0
    other = int(others.argmax())
    seen = f"moved by {math.degrees(own):.2f} degrees"
    if own < -MIN_RATIO * MOVE_ANGLE:
        return CheckFinding(name, False, f"{seen}: its sign is swapped")
    if own < MIN_RATIO * MOVE_ANGLE:
        what = (
            f"; {names[other]} moved instead"
            if others[other] > MIN_RATIO * MOVE_ANGLE
            else ": blocked, or the robot brakes by itself"
        )
        return CheckFinding(name, False, seen + what)
    if own > MAX_RATIO * MOVE_ANGLE:
        return CheckFinding(name, False, f"{seen}, {own / MOVE_ANGLE:.1f} times as far as told")
    if others[other] > MAX_COUPLING * own:
        by = math.degrees(others[other])
        return CheckFinding(name, False, f"{seen}; {names[other]} by {by:.2f} with it")
    return CheckFinding(name, True, seen)


class _Mover:
    """Commands positions through the safety layer, at the loop's rate."""

    def __init__(self, bus: Bus, safety: Safety, checks: SensorChecks, gains: CheckGains) -> None:
        self._bus, self._safety, self._checks, self._gains = bus, safety, checks, gains
        self._clock = CycleClock(safety.dt)
        self._number = 0
        self._last: Reading | None = None
        self._heard_at = math.inf
        self.held: Array = np.zeros(len(gains.kp))
        self._target: Array = self.held

    def begin(self) -> None:
        """Brake first, then hold the measured posture."""
        self._safety.arm(now())
        self._cycles(0.3)
        if self._last is None:
            raise WbcError("check: no reading; is the robot there?")
        self._safety.stand_up(now())
        # Move joints that rest on their stops off them.
        start, limits = self._last.position.copy(), self._safety.limits
        self.held = np.clip(start, limits.lower + STOP_MARGIN, limits.upper - STOP_MARGIN)
        steps = round(OFF_STOP_TIME / self._safety.dt)
        for step in range(1, steps + 1):
            self._target = start + minimum_jerk(step / steps) * (self.held - start)
            self._cycle()
        self._cycles(1.0)

    def hold(self) -> Array:
        """Hold still for a while; return the mean joint positions (n,)."""
        positions = self._cycles(HOLD_TIME)
        return np.mean(positions[len(positions) // 2 :], axis=0)

    def move(self, k: int, by: float) -> None:
        """Move one joint to ``by`` from its held position."""
        begin, end = self._target[k], self.held[k] + by
        steps = round(MOVE_TIME / self._safety.dt)
        for step in range(1, steps + 1):
            self._target = self._target.copy()
            self._target[k] = begin + minimum_jerk(step / steps) * (end - begin)
            self._cycle()

    def end(self) -> None:
        """Brake, and end."""
        self._safety.stop(now(), "the check is over")
        for _ in range(5):
            self._cycle()

    def _cycles(self, seconds: float) -> list[Array]:
        positions = list[Array]()
        for _ in range(round(seconds / self._safety.dt)):
            self._cycle()
            if self._last is not None:
                positions.append(self._last.position)
        return positions

    def _cycle(self) -> None:
        time = self._clock.wait().time
        safety = self._safety
        before = safety.mode
        reading = self._bus.read()
        if reading is not None:
            usable, findings = self._checks.look_at(reading, time)
            for one in findings:
                safety.report(*one)
            if usable:
                self._last, self._heard_at = reading, time
                safety.measured(reading)
        if time - self._heard_at > SILENCE:
            safety.report(Fault.SILENT)
        safety.judge(time)
        zero = np.zeros(len(self._target))
        command = Command(0, self._target, zero, zero, self._gains.kp, self._gains.kd)
        self._number += 1
        self._bus.write(safety.admit(command).numbered(self._number))
        if before is Mode.STANDING_UP and safety.mode is not before:
            raise WbcError(f"check: {safety.events[-1].what}; motors brake")
