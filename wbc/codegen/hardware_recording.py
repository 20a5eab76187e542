"""Outputs of Python's estimator and safety layer for messages and faults, to compare C with.

The messages are synthetic, of a robot that stands, sways, slips and whose sensors fail: they test
the arithmetic, and that C takes the same decision as Python in each branch.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np

from wbc.codegen.hardware_data import HardwareParts
from wbc.estimation import ImuReading, Measurement
from wbc.estimation.contact_filter import STATE_SIZE
from wbc.hardware.bus import Command, Reading
from wbc.hardware.loop import PERIOD
from wbc.hardware.safety import Fault, ForbiddenTransition, Mode, Safety
from wbc.hardware.sensor_checks import SensorChecks
from wbc.hardware.setup import safety_of
from wbc.validate import Array

SEED = 34
SAMPLES, CYCLES = 550, 1500
G_UNITS_FROM = 900  # from this cycle on the accelerometer says 1 for 9.81 m/s^2
FAULT_CYCLES = 20  # cycles in which one thing is wrong, for some of them
# Of a reading, by name: what is wrong with it.
READING_FAULTS = (
    *("nan", "repeated", "old", "clock", "far", "jump", "fast", "hot", "tilt", "frozen"),
    *("spin", "torque", "button", "lost", "leaning"),
)


def hardware_recording_text(parts: HardwareParts) -> str:
    """Return recording.txt, which replay.c reads: numbers by hexadecimal digits, all their bits."""
    n, nq = parts.robot.nv - 6, parts.robot.nq
    lines = [f"wbc hardware recording 1 {SAMPLES} {CYCLES} {n} {nq}"]
    for numbers in chain(_estimates(parts), _cycles(parts)):
        lines.append(" ".join(float.hex(float(one)) for one in numbers))
    return "\n".join(lines) + "\n"


# ---------------------------------------------------------------------- the estimator


def _estimates(parts: HardwareParts) -> Iterator[list[float]]:
    """Yield of each message what is in it, and what was estimated."""
    rng, robot, estimator = np.random.default_rng(SEED), parts.robot, parts.estimator
    estimator.reset()
    for m in _messages(parts, rng):
        found = estimator.update(m)
        given = [m.time, float(bool(m.imus)), float(m.velocities is not None)]
        zeros, imu = np.zeros(robot.nv - 6), np.zeros(6)
        if m.imus:
            imu = np.concatenate((m.imus[0].angular_velocity, m.imus[0].specific_force))
        torques = zeros if m.torques is None else m.torques
        told = (m.positions, zeros if m.velocities is None else m.velocities, torques, imu)
        given += [float(m.torques is not None), *np.concatenate(told)]
        if found is None:
            yield [*given, 0.0, *np.zeros(robot.nq + robot.nv + STATE_SIZE + 1)]
            continue
        spread = np.diag(found.covariance)
        yield [*given, 1.0, *found.q, *found.v, *spread, found.innovation[0]]


def _messages(parts: HardwareParts, rng: np.random.Generator) -> Iterator[Measurement]:
    robot, n = parts.robot, parts.robot.nv - 6
    begins, joints = parts.estimator.settings.standing_time + 0.1, parts.start[7:]
    loaded = parts.path.torques[0]
    legs = rng.normal(size=n) * np.minimum(0.1, 0.05 * robot.limits.velocity)
    for k in range(SAMPLES):
        time, moved = k * PERIOD, max(k * PERIOD - begins, 0.0)
        positions = joints + legs * np.sin(3.0 * moved) + 1e-4 * rng.normal(size=n)
        if 400 < k < 450:  # a foot that is taken aside
            positions[0] += 0.002 * (k - 400)
        if k in (370, 371):  # a reading that jumps
            positions[n // 2] += 1.0
        rate, force = 1e-3 * rng.normal(size=3), np.array((0.0, 0.0, 9.81))
        if moved:
            rate, force = rate + 0.05 * np.sin(4.0 * moved), force + 0.1 * rng.normal(size=3)
        reading = ImuReading(parts.estimator.imus[0].name, rate, force)
        if k == 380:  # beyond its range
            reading = ImuReading(reading.name, rate + 100.0, force)
        torques = loaded * (1.0 + 0.3 * np.sin(2.0 * moved)) + 0.1 * rng.normal(size=n)
        heard = () if 500 < k < 515 else (reading,)
        told = {} if k % 3 else {"velocities": 3.0 * legs * np.cos(3.0 * moved)}
        yield Measurement(time, positions, torques=torques, imus=heard, **told)


# ---------------------------------------------------------------------- the safety layer


def _cycles(parts: HardwareParts) -> Iterator[list[float]]:
    """Yield of each cycle what came and was asked for, and what was decided."""
    rng = np.random.default_rng(SEED + 1)
    safety = safety_of(parts.robot, parts.profile, PERIOD)
    checks, faults, modes = SensorChecks(parts.robot), list(Fault), list(Mode)
    last: Reading | None = None
    for k, (now, came, extra, wanted) in enumerate(_inputs(parts, rng)):
        asked = _request(safety, k)
        refused, took = -1, 0.0
        reading = None if came is None else checks.mended(came)
        if reading is not None:
            found = checks.refused(reading, now)
            if found is not None:
                refused = faults.index(found.fault)
                safety.report(found.fault)
        if asked >= 0:
            took = float(_carry_out(safety, asked, now))
        if reading is not None and refused < 0:
            torque = None
            if last is not None and k % 8 == 1:
                torque = safety.admit(None).motor_torque(last.position, last.velocity)
            for finding in checks.compared(reading, torque):
                safety.report(finding.fault)
            safety.measured(reading)
            last = reading
        if extra >= 0:
            safety.report(faults[extra])
        mode = safety.judge(now)
        told = safety.admit(wanted)
        borne = sum(2.0 ** faults.index(fault) for fault in safety.present)
        yield [
            *(now, float(asked), float(extra), *_of_reading(came, len(told.kp))),
            *_of_command(wanted, len(told.kp)),
            *(float(refused), took, float(modes.index(mode)), borne),
            *_of_command(told, len(told.kp)),
        ]


ARM, STAND, RUN, SOFT, DOWN, RESET = range(6)


def _request(safety: Safety, k: int) -> int:
    """Return what is asked for by hand: the way up again whenever it is down."""
    if k % 7:
        return -1
    mode = safety.mode
    ways = {Mode.IDLE: ARM, Mode.DAMPING: STAND, Mode.STANDING_UP: RUN, Mode.STOP: RESET}
    if mode is Mode.SOFT_STOP:
        return DOWN if k % 35 == 0 else -1
    if mode is Mode.RUNNING:
        return SOFT if k % 210 == 0 else -1
    return ways[mode] if k % 70 else RUN  # which is mostly forbidden


def _carry_out(safety: Safety, asked: int, now: float) -> bool:
    ways = (safety.arm, safety.stand_up, safety.run, safety.soft_stop, safety.is_down, safety.reset)
    try:
        ways[asked](now)
    except ForbiddenTransition:
        return False
    return True


def _inputs(
    parts: HardwareParts, rng: np.random.Generator
) -> Iterator[tuple[float, Reading | None, int, Command | None]]:
    """Yield the loop's time, a reading or none, a fault of the machine or -1, a command or none."""
    joints, safety, n = parts.start[7:], parts.safety, parts.robot.nv - 6
    limits, frozen, until = safety.limits, rng.normal(size=3), 0
    for k in range(CYCLES):
        now = 10.0 + k * PERIOD + 1e-5 * rng.random()
        if k % FAULT_CYCLES == 0:
            until = k + int(rng.integers(1, FAULT_CYCLES))
        reading = Reading(
            k,
            k * PERIOD,
            joints + 1e-4 * rng.normal(size=n),
            1e-3 * rng.normal(size=n),
            rng.normal(size=n),
            30.0 + rng.random(n),
            np.array((0.0, 0.0, 0.0, 1.0)),
            1e-3 * rng.normal(size=3),
            np.array((0.0, 0.0, 9.81)) + 1e-3 * rng.normal(size=3),
        )
        if k >= G_UNITS_FROM:
            reading = replace(reading, specific_force=reading.specific_force / 9.81)
        came: Reading | None = reading
        if 3 * FAULT_CYCLES < k < until:
            came = _with_fault(
                reading, READING_FAULTS[k // FAULT_CYCLES % len(READING_FAULTS)], k, frozen
            )
        extra = int(rng.integers(0, len(Fault))) if rng.random() < 0.02 else -1
        wanted = None
        if rng.random() < 0.9:
            wild = 10.0 if rng.random() < 0.1 else 0.05
            position = joints + wild * rng.normal(size=n)
            velocity, torque = wild * rng.normal(size=n), 20.0 * wild * rng.normal(size=n)
            if rng.random() < 0.02:
                torque[int(rng.integers(n))] = np.nan
            kp, kd = 1.2 * limits.kp * rng.random(n), 1.2 * limits.kd * rng.random(n)
            wanted = Command(0, position, velocity, torque, kp, kd)
        yield now, came, extra, wanted


def _with_fault(r: Reading, wrong: str, k: int, frozen: Array) -> Reading | None:
    """Return a reading with something wrong; None: it was lost."""
    j, one = k % len(r.position), np.eye(len(r.position))[k % len(r.position)]
    leaning = np.array((9.0, 0.0, 2.0)) + 1e-3 * r.angular_velocity
    changed: dict[str, dict[str, Any]] = {
        "nan": {"position": np.where(np.arange(len(one)) == j, np.nan, r.position)},
        "repeated": {"sequence": k - 1},
        "old": {"time": r.time - 0.015},
        "clock": {"time": r.time + 3.0},
        "far": {"position": r.position + 9.0 * one},
        "jump": {"position": r.position + 0.2 * one},
        "fast": {"velocity": r.velocity + 42.0 * one},
        "hot": {"temperature": r.temperature + 70.0 * one},
        "tilt": {"quaternion": np.array((np.sin(0.45), 0.0, 0.0, np.cos(0.45)))},
        "frozen": {"angular_velocity": frozen},
        "spin": {"angular_velocity": r.angular_velocity + 3.0},
        "torque": {"torque": r.torque + 300.0 * one},
        "button": {"stop": True},
        "leaning": {"specific_force": leaning},
    }
    return None if wrong == "lost" else replace(r, **changed[wrong])


def _of_reading(r: Reading | None, n: int) -> list[float]:
    if r is None:
        return [0.0] * (4 + 4 * n + 10)
    joints = (r.position, r.velocity, r.torque, r.temperature)
    imu = (r.quaternion, r.angular_velocity, r.specific_force)
    return [1.0, float(r.sequence), r.time, float(r.stop), *np.concatenate((*joints, *imu))]


def _of_command(c: Command | None, n: int) -> list[float]:
    if c is None:
        return [0.0] * (2 + 5 * n)
    numbers = np.concatenate((c.position, c.velocity, c.torque, c.kp, c.kd))
    return [1.0, float(c.enabled), *numbers]
