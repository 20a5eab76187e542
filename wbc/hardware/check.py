"""Whether a robot on its bus is that of the model: rates, sensors, order and signs of joints."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from wbc.errors import WbcError
from wbc.hardware.bus import Bus, Command, Reading
from wbc.hardware.real_time import CycleClock, now
from wbc.hardware.safety import Mode, Safety
from wbc.hardware.sensor_checks import SensorChecks
from wbc.minimum_jerk import minimum_jerk
from wbc.robot import Robot
from wbc.rotations import rotation_from
from wbc.validate import Array

MOVE = math.radians(2.0)
INSIDE, OFF_STOPS = 2.5 * MOVE, 1.5  # rad off its stops that a joint is led, in so many s
MOVE_TIME, HOLD_TIME = 0.4, 0.2  # s: there, and before it is looked at
LEAST, MOST = 0.15, 2.0  # times MOVE that a joint must, and may, move
OTHERS = (
    0.8  # straps give, so that both hips move: of its own movement that any other joint may move
)
BEYOND = 0.05  # rad or m that a joint may be out of its range: where it rests against its stop
LATE = 0.5  # of the period by which a message may come late, on average


class CheckFinding(NamedTuple):
    """What was looked at, whether it is as it should be, and what was seen."""

    what: str
    good: bool
    seen: str


@dataclass(frozen=True)
class CheckGains:
    """With which joints are held (n,): kp [N m/rad], kd [N m s/rad]."""

    kp: Array
    kd: Array


def listen(bus: Bus, robot: Robot, seconds: float = 2.0) -> list[CheckFinding]:
    """Listen without commanding anything; return what readings say of bus and sensors.

    Raises
    ------
    WbcError
        Nothing comes.
    """
    checks, readings, refused = SensorChecks(robot), list[Reading](), list[str]()
    arrivals, until = list[float](), now() + seconds
    heard = getattr(bus, "commands_heard", None)  # nobody can tell on a bus from one end to another
    while now() < until:
        reading = bus.read()
        if reading is None:
            time.sleep(2e-4)
            continue
        came = now()
        usable, shown = checks.look_at(reading, came)
        refused += [f"{one.fault}: {one.detail}" for one in shown]
        if usable:
            readings.append(reading)
            arrivals.append(came)
    if len(readings) < 10:
        why = f"; first: {refused[0]}" if refused else ""
        thrown = ", ".join(f"{count} {reason}" for reason, count in bus.dropped.items() if count)
        thrown_away = f"; thrown away: {thrown}" if thrown else ""
        raise WbcError(
            f"check: {len(readings)} usable readings in {seconds:g} s{why}; is the robot on this"
            f" interface and in its low-level mode?{thrown_away}"
        )
    gaps, last = np.diff(arrivals), readings[-1]
    robot_gaps = np.diff([one.time for one in readings])
    period = float(np.median(robot_gaps))
    lost = int(np.round(robot_gaps / period - 1.0).clip(0).sum())
    found = [
        CheckFinding("rate", 0.0 < period <= 0.005, f"{1.0 / period:.0f} readings a second"),
        CheckFinding(
            "lost", lost <= 0.01 * len(readings), f"{lost} of {len(readings) + lost} readings"
        ),
        CheckFinding(
            "regular",
            float(np.std(gaps)) < LATE * period,
            f"they come every {1e3 * np.mean(gaps):.2f} ms, give or take {1e3 * np.std(gaps):.2f}",
        ),
        CheckFinding("damaged", not bus.dropped["damaged"], f"{bus.dropped['damaged']} messages"),
        CheckFinding("believable", not refused, refused[0] if refused else "all readings"),
    ]
    if heard is not None:
        others = heard()
        seen = "commands of another program: end it" if others else "nobody else commands"
        found.append(CheckFinding("alone", not others, seen))
    return found + _at_rest(robot, readings, last)


def _at_rest(robot: Robot, readings: list[Reading], last: Reading) -> list[CheckFinding]:
    limits = robot.limits
    beyond = np.maximum(last.position - limits.upper, limits.lower - last.position)
    worst = int(beyond.argmax())
    force = np.mean([one.specific_force for one in readings], axis=0)
    spin = float(np.linalg.norm(np.mean([one.angular_velocity for one in readings], axis=0)))
    vertical = rotation_from(last.quaternion)[2]
    up = float(vertical[2])
    along = force / max(float(np.linalg.norm(force)), 1e-9)
    gravity = float(vertical @ along)
    lean = math.degrees(math.acos(min(max(gravity, -1.0), 1.0)))
    return [
        CheckFinding(
            "range",
            bool(beyond[worst] <= BEYOND),
            f"{robot.joint_names[worst]} is {abs(beyond[worst]):.3f} rad"
            f" {'outside' if beyond[worst] > 0.0 else 'inside'} its range",
        ),
        CheckFinding(
            "upright", up > 0.8, f"tilted by {math.degrees(math.acos(min(up, 1.0))):.1f} degrees"
        ),
        CheckFinding(
            "gravity",
            lean < 6.0 and 9.0 < float(np.linalg.norm(force)) < 10.6,
            f"{np.linalg.norm(force):.2f} m/s^2, {lean:.1f} degrees off what the orientation says",
        ),
        CheckFinding("gyroscope", spin < 0.05, f"{spin:.3f} rad/s at rest"),
    ]


def move_joints(
    bus: Bus,
    robot: Robot,
    safety: Safety,
    gains: CheckGains,
    *,
    told: Callable[[CheckFinding], None] = lambda finding: None,
) -> list[CheckFinding]:
    """Hold all joints where they are, and move each by 2 degrees and back; the robot must hang.

    A joint should move in the direction of its command, and no other one with it.

    Raises
    ------
    WbcError
        The safety layer stopped it; the message says why.
    """
    mover = _Mover(bus, safety, SensorChecks(robot), gains)
    found = list[CheckFinding]()
    try:
        mover.begin()
        for k, name in enumerate(robot.joint_names):
            sign = 1.0 if mover.held[k] + MOVE < robot.limits.upper[k] else -1.0
            before = mover.hold()
            mover.move(k, sign * MOVE)
            moved = mover.hold() - before
            mover.move(k, 0.0)
            finding = _judged(name, k, sign, moved, robot.joint_names)
            found.append(finding)
            told(finding)
    finally:
        mover.end()
    return found


def _judged(name: str, k: int, sign: float, moved: Array, names: tuple[str, ...]) -> CheckFinding:
    own = sign * float(moved[k])
    others = np.abs(moved)
    others[k] = 0.0
    other = int(others.argmax())
    seen = f"moved by {math.degrees(own):.2f} degrees"
    if own < -LEAST * MOVE:
        return CheckFinding(name, False, f"{seen}: its sign is swapped")
    if own < LEAST * MOVE:
        what = (
            f"; {names[other]} moved instead"
            if others[other] > LEAST * MOVE
            else ": blocked, or the robot brakes by itself"
        )
        return CheckFinding(name, False, seen + what)
    if own > MOST * MOVE:
        return CheckFinding(name, False, f"{seen}, {own / MOVE:.1f} times as far as told")
    if others[other] > OTHERS * own:
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
        self.held: Array = np.zeros(len(gains.kp))
        self._target: Array = self.held

    def begin(self) -> None:
        """Brake first, then hold what is measured."""
        self._safety.arm(now())
        self._cycles(0.3)
        if self._last is None:
            raise WbcError("check: no reading; is the robot there?")
        self._safety.stand_up(now())
        # A joint that rests on its stop is moved off it first.
        began, limits = self._last.position.copy(), self._safety.limits
        self.held = np.clip(began, limits.lower + INSIDE, limits.upper - INSIDE)
        steps = round(OFF_STOPS / self._safety.dt)
        for step in range(1, steps + 1):
            self._target = began + minimum_jerk(step / steps) * (self.held - began)
            self._cycle()
        self._cycles(1.0)

    def hold(self) -> Array:
        """Hold still for a while; return where joints are in the mean (n,)."""
        seen = self._cycles(HOLD_TIME)
        return np.mean(seen[len(seen) // 2 :], axis=0)

    def move(self, k: int, by: float) -> None:
        """Move one joint to ``by`` from where it was held."""
        begin, end = self._target[k], self.held[k] + by
        steps = round(MOVE_TIME / self._safety.dt)
        for step in range(1, steps + 1):
            self._target = self._target.copy()
            self._target[k] = begin + minimum_jerk(step / steps) * (end - begin)
            self._cycle()

    def end(self) -> None:
        """Brake, and go."""
        self._safety.stop(now(), "the check is over")
        for _ in range(5):
            self._cycle()

    def _cycles(self, seconds: float) -> list[Array]:
        seen = list[Array]()
        for _ in range(round(seconds / self._safety.dt)):
            self._cycle()
            if self._last is not None:
                seen.append(self._last.position)
        return seen

    def _cycle(self) -> None:
        time = self._clock.wait().time
        safety = self._safety
        before = safety.mode
        reading = self._bus.read()
        if reading is not None:
            usable, shown = self._checks.look_at(reading, time)
            for one in shown:
                safety.report(*one)
            if usable:
                self._last = reading
                safety.measured(reading)
        safety.judge(time)
        zero = np.zeros(len(self._target))
        wanted = Command(0, self._target, zero, zero, self._gains.kp, self._gains.kd)
        self._number += 1
        self._bus.write(safety.admit(wanted).numbered(self._number))
        if before is Mode.STANDING_UP and safety.mode is not before:
            raise WbcError(f"check: {safety.events[-1].what}; motors brake")
