"""Commands of the hardware loop under faults of sensors, messages, controllers and machines.

    python benchmarks/hardware_faults.py                # 10^6 cycles, seed 0
    python benchmarks/hardware_faults.py 100000 --seed 1

A robot on rails: its joints and its base swing whatever it is commanded, so that every sensor has a
signal and no physics hides a wrong command. Each cycle's command is compared with the robot's
limits by independent arithmetic. The tests inject the faults one by one.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

import wbc
from wbc.hardware.bus import BusError, Command, Reading
from wbc.hardware.loop import HardwareLoop
from wbc.hardware.operator import LoopStatus, Wish
from wbc.hardware.postures import CrouchPath, Motions, PostureMotion
from wbc.hardware.real_time import Beat
from wbc.hardware.robot_controller import ControllerAnswer, EstimateError
from wbc.hardware.safety import Mode, Safety
from wbc.hardware.safety_limits import SafetyLimits
from wbc.hardware.sensor_checks import SensorChecks

DT = 0.002
JOINT = 3  # that faults are about
SWING, RATE = 0.25, 2.0 * np.pi  # rad, rad/s of the joints' swing
LEAN = 0.35  # rad of the base's swing
PART = 0.7  # of the effort limit that the controller commands
RESULT = Path(__file__).with_name("hardware_faults.json")

Readings = list[Reading]
Change = Callable[[Reading, int, Any], Readings]


class RailRobot:
    """Sends readings of a swing and receives commands. A bus for both ends."""

    def __init__(self, robot: wbc.Robot, seed: int) -> None:
        limits = robot.limits
        self.middle = 0.5 * (limits.lower + limits.upper)
        self.swing = np.minimum(SWING, 0.3 * (limits.upper - limits.lower))
        self.random = np.random.default_rng(seed)
        self.dropped: Counter[str] = Counter()
        self.command = Command.damping(np.zeros(len(limits.effort)), enabled=False)
        self.change: Change | None = None
        self.memory = SimpleNamespace(kept=[], first=None)
        self.refuses = False
        self.since = 0
        self.count = 0
        self._waiting: deque[Reading] = deque()

    def move(self, t: float) -> None:
        """Send the reading of a time."""
        self.count += 1
        n = len(self.middle)
        phase = RATE * t
        q = self.middle + self.swing * np.sin(phase)
        v = self.swing * RATE * np.cos(phase)
        lean, rate = LEAN * np.sin(phase), LEAN * RATE * np.cos(phase)
        quaternion = np.array((np.sin(lean / 2), 0.0, 0.0, np.cos(lean / 2)))
        force = 9.81 * np.array((0.0, np.sin(lean), np.cos(lean)))
        noise = self.random.normal
        reading = Reading(
            self.count,
            t,
            q + 1e-5 * noise(size=n),
            v + 1e-2 * noise(size=n),
            self.command.motor_torque(q, v),
            np.full(n, 40.0),
            quaternion,
            np.array((rate, 0.0, 0.0)) + 1e-3 * noise(size=3),
            force + 1e-2 * noise(size=3),
        )
        if self.change is None:
            self._waiting.append(reading)
        else:
            self._waiting.extend(self.change(reading, self.since, self.memory))
            self.since += 1

    def inject(self, change: Change | None) -> None:
        """Change readings from now on."""
        self.change, self.since = change, 0
        self.memory = SimpleNamespace(kept=[], first=None)

    def read(self) -> Reading | None:
        newest = None
        while self._waiting:
            newest = self._waiting.popleft()
        return newest

    def write(self, command: Command) -> None:
        if self.refuses:
            raise BusError("refused")
        self.command = command

    def close(self) -> None: ...


class RailController:
    """Commands large torques, or fails as configured."""

    notes = ()

    def __init__(self, robot: wbc.Robot) -> None:
        self.robot, self.dt = robot, DT
        n = len(robot.joint_names)
        self.torque = PART * robot.limits.effort
        self.zero = np.zeros(n)
        self.state = robot.postures["standing"], np.zeros(robot.nv)
        self.wrong, self.waits, self.load = "", False, 1.0
        self.random = np.random.default_rng(7)

    def stand(self) -> None: ...
    def begin(self, reading: Reading) -> None: ...
    def come_to_rest(self) -> None: ...

    def observe(self, reading: Reading) -> ControllerAnswer:
        return ControllerAnswer(None, *self.state, load=self.load)

    def command(self, reading: Reading, waits: bool = False) -> ControllerAnswer:
        self.waits = waits
        wrong, zero = self.wrong, self.zero
        if wrong == "raises":
            raise RuntimeError("a bug")
        if wrong == "no estimate":
            raise EstimateError("lost")
        torque, position, velocity, kp = self.torque, reading.position, zero, zero
        if wrong == "nan":
            torque = torque.copy()
            torque[JOINT] = np.nan
        if wrong == "huge":
            draw = self.random.normal
            torque, position, velocity = (1e4 * draw(size=len(zero)) for _ in range(3))
            kp = 1e4 * np.abs(draw(size=len(zero)))
        command = Command(0, position, velocity, torque, kp, kp)
        ok = wrong != "unsolved"
        return ControllerAnswer(command, *self.state, ok=ok, report="no solution", load=self.load)


@cache
def _robot() -> wbc.Robot:
    return wbc.Robot.load("hoap2_like")


class HungWorker:
    """A worker that never answers."""

    busy = True

    def submit(self, job: object) -> None: ...
    def result(self, timeout: float) -> None: ...
    def close(self) -> tuple[str, ...]:
        return ()


class Rig:
    """A loop on a robot on rails, in simulated time."""

    def __init__(self, seed: int = 0, log: Path | None = None) -> None:
        self.robot = robot = _robot()
        n = len(robot.joint_names)
        self.bus = RailRobot(robot, seed)
        self.controller = RailController(robot)
        kp, kd = np.full(n, 20.0), np.full(n, 0.5)
        self.safety = Safety(SafetyLimits.of(robot, kp, kd), kd, DT)
        rows, zero = np.tile(self.bus.middle, (2, 1)), np.zeros((2, n))
        path = CrouchPath(rows, zero, robot.postures["standing"])
        self.loop = HardwareLoop(
            lambda: self.bus,
            self.controller,  # type: ignore[arg-type]
            self.safety,
            SensorChecks(robot),
            Motions(
                PostureMotion(path, kp, kd, up=True, onto=0.05, along=0.05),
                PostureMotion(path, kp, kd, up=False, onto=0.05, along=0.05),
            ),
            self,
            log=log,
            forked=False,
            priority=0,
        )
        self.time, self.wanted = 0.0, deque[Wish]()

    def wish(self, status: LoopStatus) -> Wish | None:
        """Return the requested mode; the rig is the loop's operator."""
        return self.wanted.popleft() if self.wanted else None

    def cycle(self, late: float = 0.0, missed: int = 0) -> Command:
        """Make a cycle with this delay."""
        self.bus.move(self.time)
        self.time += late
        command = self.loop.cycle(Beat(self.time, late, missed))
        self.time += max(DT - late, 0.0)
        return command

    def cycles(self, seconds: float) -> None:
        for _ in range(round(seconds / DT)):
            self.cycle()

    def start(self) -> None:
        """Arm, stand up and run."""
        self.wanted.append(Wish.ARM)
        self.cycles(0.03)
        self.wanted.append(Wish.STAND)
        self.cycles(0.12)
        self.wanted.append(Wish.RUN)
        self.cycles(0.1)
        assert self.safety.mode is Mode.RUNNING, list(self.safety.events)

    def excess(self, command: Command) -> str:
        """Return what of a command is outside the limits, by arithmetic of its own; else nothing.

        The torque that motors make is taken at the last usable reading.
        """
        limits, c = self.safety.limits, command
        parts = (c.position, c.velocity, c.torque, c.kp, c.kd)
        if not all(np.isfinite(part).all() for part in parts):
            return "not finite"
        reading = self.loop._state.reading
        passive = not c.kp.any() and not c.torque.any() and not c.velocity.any()
        if not c.enabled or passive:
            return "" if (c.kd <= limits.kd + 1e-12).all() else "brake too hard"
        if (c.position < limits.lower - 1e-9).any() or (c.position > limits.upper + 1e-9).any():
            return "position"
        if (np.abs(c.velocity) > limits.velocity + 1e-9).any():
            return "velocity"
        if (c.kp < 0.0).any() or (c.kp > limits.kp + 1e-9).any():
            return "kp"
        if (c.kd < 0.0).any() or (c.kd > limits.kd + 1e-9).any():
            return "kd"
        if (np.abs(c.torque) > limits.effort + 1e-9).any():
            return "torque"
        if reading is not None:
            made = c.torque + c.kp * (c.position - reading.position)
            made += c.kd * (c.velocity - reading.velocity)
            if (np.abs(made) > limits.effort * (1.0 + 1e-9)).any():
                return "torque of motors"
        return ""


# ---------------------------------------------------------------------- faults of readings


def of_imu(name: str, value: Callable[[np.ndarray, Any], np.ndarray]) -> Change:
    """Return a fault of a part of the IMU, or of all joints."""

    def change(r: Reading, since: int, memory: Any) -> Readings:
        field = np.array(getattr(r, name))
        memory.first = field.copy() if memory.first is None else memory.first
        return [replace(r, **{name: value(field, memory)})]

    return change


def of_joint(name: str, value: Callable[[np.ndarray, Any], float]) -> Change:
    """Return a fault of one joint's sensor; ``value`` gets the field and the memory."""

    def changed(field: np.ndarray, memory: Any) -> np.ndarray:
        field[JOINT] = value(field, memory)
        return field

    return of_imu(name, changed)


def late_by(cycles: int) -> Change:
    def change(r: Reading, since: int, memory: Any) -> Readings:
        memory.kept.append(r)
        return [memory.kept.pop(0)] if len(memory.kept) > cycles else []

    return change


def shifted(seconds: float) -> Change:
    return lambda r, since, memory: [replace(r, time=r.time + seconds)]


def swapped(r: Reading, since: int, memory: Any) -> Readings:
    memory.kept.append(r)
    if len(memory.kept) < 2:
        return []
    first, second = memory.kept
    memory.kept.clear()
    return [second, first]


def shuffled_alone(r: Reading, since: int, memory: Any) -> Readings:
    """Send the last reading but one again, alone, each second cycle."""
    memory.kept.append(r)
    return [memory.kept[-3]] if since % 2 and len(memory.kept) > 3 else [r]


def nan_of(field: np.ndarray, memory: Any) -> np.ndarray:
    return np.full_like(field, np.nan)


JUMP = of_joint("position", lambda f, m: f[JOINT] + 0.4)
READING_FAULTS: dict[str, tuple[Change, Mode]] = {
    "position dead": (of_joint("position", lambda f, m: 0.0), Mode.STOP),
    "position frozen": (of_joint("position", lambda f, m: m.first[JOINT]), Mode.STOP),
    "position NaN": (of_joint("position", lambda f, m: np.nan), Mode.STOP),
    "position infinite": (of_joint("position", lambda f, m: np.inf), Mode.STOP),
    "position jumped": (JUMP, Mode.STOP),
    "position sign swapped": (of_joint("position", lambda f, m: -f[JOINT]), Mode.STOP),
    "position jumped once": (lambda r, k, m: JUMP(r, k, m) if k == 0 else [r], Mode.RUNNING),
    "velocity dead": (of_joint("velocity", lambda f, m: 0.0), Mode.STOP),
    "velocity frozen": (of_joint("velocity", lambda f, m: m.first[JOINT]), Mode.STOP),
    "velocity NaN": (of_joint("velocity", lambda f, m: np.nan), Mode.STOP),
    "velocity jumped": (of_joint("velocity", lambda f, m: f[JOINT] + 1e3), Mode.STOP),
    "velocity sign swapped": (of_joint("velocity", lambda f, m: -f[JOINT]), Mode.STOP),
    "torque dead": (of_joint("torque", lambda f, m: 0.0), Mode.STOP),
    "torque NaN": (of_joint("torque", lambda f, m: np.nan), Mode.STOP),
    "torque sign swapped": (of_joint("torque", lambda f, m: -f[JOINT]), Mode.STOP),
    "torque beyond the limit": (of_joint("torque", lambda f, m: 2.0 * f[JOINT]), Mode.STOP),
    "temperature NaN": (of_joint("temperature", lambda f, m: np.nan), Mode.STOP),
    "temperature dead": (of_joint("temperature", lambda f, m: -273.0), Mode.STOP),
    "motor warm": (of_joint("temperature", lambda f, m: 85.0), Mode.DAMPING),
    "motor hot": (of_joint("temperature", lambda f, m: 100.0), Mode.STOP),
    "gyroscope dead": (of_imu("angular_velocity", lambda f, m: 0.0 * f), Mode.STOP),
    "gyroscope frozen": (of_imu("angular_velocity", lambda f, m: m.first), Mode.STOP),
    "gyroscope NaN": (of_imu("angular_velocity", nan_of), Mode.STOP),
    "gyroscope jumped": (of_imu("angular_velocity", lambda f, m: f + 60.0), Mode.STOP),
    "gyroscope sign swapped": (of_imu("angular_velocity", lambda f, m: -f), Mode.STOP),
    "accelerometer dead": (of_imu("specific_force", lambda f, m: 0.0 * f), Mode.STOP),
    "accelerometer frozen": (of_imu("specific_force", lambda f, m: m.first), Mode.STOP),
    "accelerometer NaN": (of_imu("specific_force", nan_of), Mode.STOP),
    "accelerometer jumped": (of_imu("specific_force", lambda f, m: f + 500.0), Mode.STOP),
    "accelerometer sign swapped": (of_imu("specific_force", lambda f, m: -f), Mode.STOP),
    "orientation NaN": (of_imu("quaternion", nan_of), Mode.STOP),
    "orientation no rotation": (of_imu("quaternion", lambda f, m: 0.0 * f), Mode.STOP),
    "orientation frozen": (of_imu("quaternion", lambda f, m: m.first), Mode.STOP),
    "orientation jumped": (of_imu("quaternion", lambda f, m: f[[3, 1, 2, 0]]), Mode.STOP),
    "orientation sign swapped": (
        of_imu("quaternion", lambda f, m: f * (-1.0, -1.0, -1.0, 1.0)),
        Mode.STOP,
    ),
    "message lost": (lambda r, k, m: [] if k == 0 else [r], Mode.RUNNING),
    "every third message lost": (lambda r, k, m: [] if k % 3 == 0 else [r], Mode.RUNNING),
    "messages lost for 10 ms": (lambda r, k, m: [] if k < 5 else [r], Mode.RUNNING),
    "messages lost for good": (lambda r, k, m: [], Mode.STOP),
    "messages twice": (lambda r, k, m: [r, r], Mode.RUNNING),
    "messages out of order": (swapped, Mode.RUNNING),
    "old messages between": (shuffled_alone, Mode.RUNNING),
    "messages late by 30 ms": (late_by(15), Mode.STOP),
    "messages late by 4 ms": (late_by(2), Mode.RUNNING),
    "clock jumps ahead": (shifted(5.0), Mode.RUNNING),
    "clock jumps back": (shifted(-5.0), Mode.RUNNING),
    "clock NaN": (shifted(np.nan), Mode.STOP),
    "numbers begin anew": (lambda r, k, m: [replace(r, sequence=k + 1)], Mode.STOP),
    "stop button": (lambda r, k, m: [replace(r, stop=True)], Mode.STOP),
}
"""Each with the mode in which the loop is 0.5 s later."""

CONTROLLER_FAULTS = {
    "raises": Mode.DAMPING,
    "no estimate": Mode.DAMPING,
    "nan": Mode.DAMPING,
    "unsolved": Mode.DAMPING,
    "huge": Mode.RUNNING,  # clipped to the robot's limits
    "hangs": Mode.DAMPING,
}


def after(name: str, mode: Mode, rig: Rig) -> str:
    """Return an error message if the loop ended in another mode than expected."""
    found = rig.safety.mode
    return "" if found is mode else f"{name}: {found}, not {mode}: {list(rig.safety.events)[-4:]}"


# ---------------------------------------------------------------------- a million cycles


def soak(cycles: int, seed: int) -> dict[str, Any]:
    """Return the results of a number of cycles with random faults."""
    random = np.random.default_rng(seed)
    names = list(READING_FAULTS)
    rig = Rig(seed)
    seen: Counter[str] = Counter()
    modes: Counter[str] = Counter()
    outside: Counter[str] = Counter()
    began = time.perf_counter()
    for _ in range(cycles):
        draw = random.uniform()
        if draw < 0.01:  # a fault comes, or goes
            kind = random.integers(4)
            rig.controller.wrong, rig.bus.refuses = "", False
            rig.bus.inject(None)
            if kind == 0:
                name = names[random.integers(len(names))]
                rig.bus.inject(READING_FAULTS[name][0])
            elif kind == 1:
                name = ("raises", "no estimate", "nan", "unsolved", "huge")[random.integers(5)]
                rig.controller.wrong = name
            elif kind == 2:
                name = "bus refuses"
                rig.bus.refuses = random.uniform() < 0.3
            else:
                name = "none"
            seen[name] += 1
        elif draw < 0.03:  # the operator requests a mode, sensible or not
            choices = list(Wish)[:-1]
            rig.wanted.append(choices[random.integers(len(choices))])
        mode = rig.safety.mode
        if mode is Mode.STOP and random.uniform() < 0.05:
            rig.wanted.append(Wish.RESET)
        elif mode is Mode.IDLE and random.uniform() < 0.1:
            rig.wanted.append(Wish.ARM)
        elif mode is Mode.DAMPING and random.uniform() < 0.1:
            rig.wanted.append(Wish.STAND)
        elif mode is Mode.STANDING_UP and random.uniform() < 0.05:
            rig.wanted.append(Wish.RUN)
        late = float(random.exponential(0.01)) if random.uniform() < 0.003 else 0.0
        rig.loop._state.ended = ""
        command = rig.cycle(late, int(late / DT))
        wrong = rig.excess(command)
        if wrong:
            outside[wrong] += 1
        modes[str(rig.safety.mode)] += 1
        del rig.loop._state.lateness[:]
        del rig.loop._state.seconds[:]
    seconds = time.perf_counter() - began
    return {
        "cycles": cycles,
        "seed": seed,
        "outside limits": dict(outside),
        "modes": dict(modes),
        "faults injected": dict(seen.most_common()),
        "faults found": {str(k): v for k, v in rig.safety.counts.most_common()},
        "microseconds a cycle": round(1e6 * seconds / cycles, 1),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cycles", type=int, nargs="?", default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--output", type=Path, default=RESULT)
    wanted = parser.parse_args()
    found = soak(wanted.cycles, wanted.seed)
    wanted.output.write_text(json.dumps(found, indent=1) + "\n")
    print(json.dumps(found, indent=1))
    assert not found["outside limits"]


if __name__ == "__main__":
    main()
