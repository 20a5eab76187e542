"""The base's state from IMUs, encoders and contacts: one update per message.

IMU -> predict -> joints -> feet seen from the IMU -> who bears -> hold, correct or release each
    -> base pose and velocity -> forces by momentum residuals, for who bears in the next update
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, listed, shown
from wbc.estimation.contact_filter import SHOWN, ContactFilter, Counts
from wbc.estimation.estimate import Estimate
from wbc.estimation.imus import ImuMount, ImuWatch, Inertial
from wbc.estimation.joint_velocity import JointVelocityFilter
from wbc.estimation.measurement import Measurement
from wbc.estimation.momentum_observer import MomentumObserver, foot_wrenches
from wbc.estimation.settings import EstimatorSettings
from wbc.estimation.standing_feet import FootSeen, FootWatch, track
from wbc.native import doubles, lib
from wbc.robot import Robot
from wbc.robot.limits import BASE_NQ, BASE_NV
from wbc.robot.model import check_robot
from wbc.robot.mounted import Mount, MountedFrames
from wbc.rotations import exp_rotation, quaternion_from, rotation_from
from wbc.spatial import skew
from wbc.validate import Array, read_only

TILT = 0.05  # rad: standard deviation of the tilt by the mean specific force of a robot at rest
SWAYED = 0.1  # rad/s: mean of a gyroscope's reading, beyond which the robot does not stand still
JUMP = 3.0  # times what a joint's speed limit allows in one period: a reading is wrong
LEEWAY = 5e-3  # rad or m, besides
# A joint whose readings jumped is believed after so many that agree: it is where they say.
AGREE = 5


class _Memory(NamedTuple):
    """All that an estimator knows between two messages."""

    filter: tuple[Array, Counts]
    velocity: tuple[Array, Array, int]
    observer: tuple[Array, tuple[Array, Array, Array] | None]
    imus: ImuWatch | None
    feet: tuple[FootWatch, ...]
    forces: Mapping[str, Array]
    time: float
    positions: Array | None
    distrusted: Counts
    lost_since: float | None


class StateEstimator:
    """Estimates the base of a robot from its sensors; see the page *Estimate*.

    In the beginning the robot stands still for ``standing_time``; :meth:`update` returns None until
    then. Heading and position are relative to that stance: nothing observes them, and their
    variance only grows.

    Parameters
    ----------
    robot:
        With a floating base, and feet.
    imus:
        Where they are; the first one leads as long as it is heard. By default one at the base.
    settings:
        Others than those of :class:`~wbc.estimation.EstimatorSettings`, by name.

    Attributes
    ----------
    robot, settings:
        As given.
    velocity_delay:
        How old joint velocities are that come from encoders alone [s].
    notes:
        What an estimate does not know, in words.

    Raises
    ------
    InvalidInputError
        A robot whose base is bolted, or without feet, or a setting out of range.
    UnknownNameError
        An IMU on a frame that is none.
    """

    def __init__(
        self,
        robot: Robot,
        imus: Sequence[ImuMount] | ImuMount = (),
        settings: EstimatorSettings | None = None,
        *,
        dt: float = 0.002,
    ) -> None:
        check_robot("estimator, robot", robot)
        if robot.fixed_base or not robot.feet:
            why = "its base is bolted" if robot.fixed_base else "no feet were found"
            raise InvalidInputError(
                f"estimator: {robot.name}: {why}; a base is estimated from feet that stand"
            )
        self.robot, self.settings = robot, settings or EstimatorSettings()
        self.imus = (imus,) if isinstance(imus, ImuMount) else tuple(imus) or (ImuMount(),)
        names = [one.name for one in self.imus]
        if len(set(names)) < len(names):
            raise InvalidInputError(f"estimator, imus: names must differ, got {names}")
        self._foot_names = tuple(robot.feet)
        soles = [Mount(foot.frame, np.zeros(3), np.eye(3)) for foot in robot.feet.values()]
        self._mounted = MountedFrames(robot, [*(one.mount for one in self.imus), *soles])
        self._flat = tuple(len(foot.polygon) > 2 for foot in robot.feet.values())
        s = self.settings
        self._velocity = JointVelocityFilter(robot.nv - BASE_NV, s.velocity_window, dt)
        self.velocity_delay = self._velocity.delay
        self._observer = MomentumObserver(robot, s.bandwidth)
        gravity = np.array(robot.model.gravity.linear)
        self._filter = ContactFilter(len(robot.feet), s.noise, gravity)
        self._floor = np.array((s.place_floor, s.turn_floor)) ** 2
        self._variance = s.encoder_deviation**2
        self._places = np.zeros((len(robot.feet), 12))
        self._noises = np.zeros((len(robot.feet), 6, 6))
        self._most = JUMP * robot.limits.velocity
        self.notes = (
            "heading and position are relative to the start: nothing observes them, and their"
            " variance grows",
            f"joint velocities that are not measured are {1e3 * self.velocity_delay:.1f} ms old",
        )
        self.reset()

    def __repr__(self) -> str:
        names = ", ".join(one.name for one in self.imus)
        state = "standing to begin" if self._started is None else f"t={self._time:.3f} s"
        return f"StateEstimator({self.robot.name!r}, {names}, {state})"

    # ------------------------------------------------------------------ to begin

    def reset(self, q: ArrayLike | None = None) -> None:
        """Forget everything, and stand still to begin.

        Parameters
        ----------
        q:
            Configuration (nq,) whose base position and heading it is then; its tilt and joints are
            measured. None: heading 0, the soles' middle at the world's origin.

        Raises
        ------
        InvalidInputError
            An unusable configuration.
        """
        self._begin = None if q is None else self.robot.check_configuration(q)
        self._waiting: list[Measurement] = []
        self._started: float | None = None
        self._past: deque[tuple[Measurement, _Memory]] = deque(maxlen=self.settings.history)
        self._forget(0.0)

    def _forget(self, time: float) -> None:
        self._velocity.reset()
        self._observer.reset()
        self._imus: ImuWatch | None = None
        self._feet = (FootWatch(),) * len(self._foot_names)
        self._forces: Mapping[str, Array] = {}
        self._time = time
        self._positions: Array | None = None
        self._distrusted: Counts = np.zeros(self.robot.nv - BASE_NV, dtype=np.int64)
        self._lost_since: float | None = None

    def _stand(self, measurement: Measurement) -> Estimate | None:
        """Wait until it stood still long enough; then begin, with all that was measured."""
        if self._waiting and measurement.time <= self._waiting[-1].time:
            return None  # late, or twice: standing, nothing is lost with it
        leader = self.imus[0].name
        if not self._waiting and all(one.name != leader for one in measurement.imus):
            return None
        self._waiting.append(measurement)
        first = self._waiting[0]
        if measurement.time - first.time < self.settings.standing_time - 1e-9:
            return None
        readings = [one for m in self._waiting for one in m.imus if one.name == leader]
        if not readings:  # heard first, then not any more
            raise InvalidInputError(
                f"estimator: no reading of IMU {leader!r} in {self.settings.standing_time:g} s"
                f" (heard: {sorted({one.name for m in self._waiting for one in m.imus})})"
            )
        rate = np.mean([one.angular_velocity for one in readings], axis=0)
        force = np.mean([one.specific_force for one in readings], axis=0)
        way = float(np.abs(measurement.positions - first.positions).max())
        if np.linalg.norm(rate) > SWAYED or way > SWAYED * self.settings.standing_time:
            self._waiting = [measurement]  # it moves: begin to wait anew
            return None
        self._mounted.at(first.positions)
        self._forget(first.time)
        self._level(force)
        self._started = first.time
        waiting, self._waiting = self._waiting, []
        for one in waiting:
            estimate = self._take(one, standing=True)
        return estimate

    def _level(self, force: Array) -> None:
        """Begin with the tilt that a specific force at rest has, and nothing moving."""
        up = -np.array(self.robot.model.gravity.linear)
        up /= np.linalg.norm(up)
        seen = force / np.linalg.norm(force)
        mounted, q = self._mounted, self._begin
        R_imu = _shortest(seen, up)  # some heading
        forwards = (R_imu @ mounted.rotation(0).T)[:, 0]
        wanted = rotation_from(q[3:BASE_NQ])[:, 0] if q is not None else np.eye(3)[0]
        turn = math.atan2(wanted[1], wanted[0]) - math.atan2(forwards[1], forwards[0])
        R_imu = exp_rotation(np.array((0.0, 0.0, turn))) @ R_imu
        R = R_imu @ mounted.rotation(0).T
        if q is None:
            first = len(self.imus)
            soles = [R @ mounted.origin(first + k) for k in range(len(self._foot_names))]
            base = -np.mean(soles, axis=0)
        else:
            base = q[:3]
        s, P = self.settings, np.zeros((SHOWN, SHOWN))
        across = np.eye(3) - np.outer(up, up)
        P[:3, :3] = TILT**2 * across
        P[9:12, 9:12] = s.gyroscope_bias**2 * np.eye(3)
        P[12:, 12:] = s.accelerometer_bias**2 * np.eye(3)
        self._filter.reset(R_imu, base + R @ mounted.origin(0), covariance=P)

    # ------------------------------------------------------------------ messages

    def update(self, measurement: Measurement) -> Estimate | None:
        """Take in a message; return the estimate at the time of the latest one.

        None while it stands to begin. A message that comes late is filed where it belongs, and what
        followed is taken in again: to the same bits as in order. One that is older than
        ``history`` messages, or came twice, is dropped, and a note says so.

        Raises
        ------
        InvalidInputError
            A message of another robot, or without any reading of the leading IMU to begin with.
        """
        joints = self.robot.nv - BASE_NV
        if not isinstance(measurement, Measurement) or measurement.positions.shape != (joints,):
            raise InvalidInputError(
                f"estimator: expected a Measurement of {joints} joints, got {shown(measurement)}"
            )
        if self._started is None:
            return self._stand(measurement)
        if measurement.time > self._time:
            return self._take(measurement)
        return self._file(measurement)

    def _file(self, late: Measurement) -> Estimate:
        """Take in a message that is not the latest."""
        times = [one.time for one, _ in self._past]
        at = bisect_left(times, late.time)
        age = 1e3 * (self._time - late.time)
        if at < len(times) and times[at] == late.time:
            return replace(self._last, notes=("a message came twice; dropped",))
        if at == 0:
            kept = f"older than the last {len(times)} messages"
            return replace(self._last, notes=(f"a message is {age:.1f} ms late, {kept}; dropped",))
        again = [late, *(one for one, _ in list(self._past)[at:])]
        self._restore(self._past[at][1])
        for _ in range(len(times) - at):
            self._past.pop()
        for one in again:
            estimate = self._take(one)
        note = f"a message is {age:.1f} ms late; {len(again) - 1} were taken in again"
        return replace(estimate, notes=(*estimate.notes, note))

    def _take(self, m: Measurement, standing: bool = False) -> Estimate:
        if self.settings.history:
            self._past.append((m, self._memory()))
        notes = list[str]()
        watch = self._imus or ImuWatch.of(self.imus, self.settings.timeout, m.time)
        before = watch.leader
        self._imus, inertial = watch.seen(m.time, {one.name: one for one in m.imus})
        notes += inertial.notes
        dt, self._time = m.time - self._time, m.time
        positions = self._believed(m.positions, dt, notes)
        rates = self._velocity.update(m.time, positions)
        rates = rates if m.velocities is None else m.velocities
        if self.settings.encoder_delay:
            positions = positions + self.settings.encoder_delay * rates
        if inertial.leader != before:
            self._follow(before, inertial.leader)
        if dt > 0.0:
            self._filter.predict(inertial.rate, inertial.force, dt, inertial.scale)
        self._mounted.at(positions)
        squared, rows = self._see_feet(m, inertial, rates, standing, notes)
        q, v = self._base(positions, rates, inertial)
        self._feel(m, q, v, dt)
        self._last = self._estimate(q, v, (squared, rows), notes)
        return self._last

    def _believed(self, positions: Array, dt: float, notes: list[str]) -> Array:
        """Return joint positions, those that jumped beyond all speed as they were."""
        before = self._positions
        if before is not None:
            jumped = np.abs(positions - before) > self._most * dt + LEEWAY
            if jumped.any() or self._distrusted.any():
                self._distrusted = np.where(jumped, self._distrusted + 1, 0)
                doubted = jumped & (self._distrusted < AGREE)
                if doubted.any():
                    names = [self.robot.joint_names[k] for k in np.flatnonzero(doubted)]
                    notes.append(f"joint {listed(names)}: position jumped; held")
                    positions = np.where(doubted, before, positions)
        self._positions = positions
        return positions

    # ------------------------------------------------------------------ feet

    def _see_feet(
        self, m: Measurement, inertial: Inertial, rates: Array, standing: bool, notes: list[str]
    ) -> tuple[float, int]:
        """Hold, correct by or release each foot; return NIS and rows."""
        frames, filter_, first = self._mounted.frames, self._filter, len(self.imus)
        leader = inertial.leader
        loads, shares = self._loads(m, standing)
        if loads is None:
            notes.append("no contacts, forces or torques: both feet are taken to bear always")
            loads = np.ones(len(self._feet))
        imu = doubles(frames[leader])
        moved = self._mounted.jacobian(leader)[:, BASE_NV:] @ rates
        R_imu, velocity, rate = (
            self._mounted.rotation(leader),
            filter_.rotation.T @ filter_.velocity,
            inertial.rate - filter_.gyroscope_bias,
        )
        squared, rows, held, bears, feet = 0.0, 0, False, False, []
        for k, name in enumerate(self._foot_names):
            place, noise = self._places[k], self._noises[k]
            lib.wbc_foot_place(
                self.robot.nv,
                *(imu, doubles(frames[first + k]), self._variance, doubles(self._floor)),
                *(doubles(place), doubles(noise)),
            )
            watch = self._feet[k].loaded(m.time, float(loads[k]), shares)
            speed = 0.0
            if watch.bears and not filter_.held[k]:
                J = self._mounted.jacobian(first + k)[:3, BASE_NV:]
                arm = frames[first + k, :3] - frames[leader, :3]
                of_joints = J @ rates - moved[:3] - np.cross(moved[3:], arm)
                of_foot = velocity + np.cross(rate, place[:3]) + R_imu.T @ of_joints
                speed = math.hypot(*of_foot.tolist())
                if self._lost_since is not None and (
                    m.time - self._lost_since > self.settings.lost
                ):
                    notes.append(
                        f"no foot for {1e3 * (m.time - self._lost_since):.0f} ms: {name}"
                        f" is counted on at {speed:.2f} m/s"
                    )
                    filter_.widen(speed)
                    speed, watch = 0.0, replace(watch, since=-math.inf)
            seen = FootSeen(place, noise, speed, self._flat[k])
            found = track(filter_, k, name, watch, seen, m.time, self.settings)
            feet.append(found.watch)
            squared, rows = squared + found.squared, rows + found.rows
            if found.note:
                notes.append(found.note)
            held, bears = held or filter_.held[k], bears or found.watch.bears
        self._feet = tuple(feet)
        if held or not bears:
            self._lost_since = None
        elif self._lost_since is None:
            self._lost_since = m.time
        return squared, rows

    def _loads(self, m: Measurement, standing: bool) -> tuple[Array | None, tuple[float, float]]:
        """Return the loads of the feet by the weight, and from which share on one bears."""
        s, names = self.settings, self._foot_names
        if standing:
            return np.ones(len(names)), s.load
        if m.forces is not None:
            loads = [m.forces.get(name, 0.0) / self.robot.weight for name in names]
            return np.array(loads), s.load
        if m.contacts is not None:
            return np.array([float(m.contacts.get(name, False)) for name in names]), s.load
        if self._forces:
            loads = [self._forces[name][2] / self.robot.weight for name in names]
            return np.array(loads), s.estimated_load
        return None, s.load

    def _feel(self, m: Measurement, q: Array, v: Array, dt: float) -> None:
        """Estimate the forces on the soles from the motors' torques."""
        if m.torques is None:
            self._forces = {}
            return
        snapshot = self.robot.snapshot(q, v)
        residual = self._observer.update(snapshot, m.torques, dt)
        self._forces = foot_wrenches(snapshot, residual)

    # ------------------------------------------------------------------ the base

    def _base(self, positions: Array, rates: Array, inertial: Inertial) -> tuple[Array, Array]:
        """Return configuration and velocity by the filter's IMU and the joints."""
        k, mounted, filter_, robot = inertial.leader, self._mounted, self._filter, self.robot
        R_imu = mounted.rotation(k)
        R = filter_.rotation @ R_imu.T
        q, v = np.empty(robot.nq), np.empty(robot.nv)
        q[:3] = filter_.position - R @ mounted.origin(k)
        q[3:BASE_NQ] = quaternion_from(R)
        robot.limits.write_positions(q, positions)
        moved = mounted.jacobian(k)[:, BASE_NV:] @ rates
        v[3:6] = R_imu @ (inertial.rate - filter_.gyroscope_bias) - moved[3:]
        v[:3] = filter_.velocity @ R - np.cross(v[3:6], mounted.origin(k)) - moved[:3]
        v[BASE_NV:] = rates
        return q, v

    def _follow(self, before: int, leader: int) -> None:
        """Go on with another IMU: the same body, another place and biases nobody knows."""
        filter_, mounted, s = self._filter, self._mounted, self.settings
        R, P = filter_.rotation, filter_.covariance
        turn = mounted.rotation(before).T @ mounted.rotation(leader)
        arm = mounted.rotation(before).T @ (mounted.origin(leader) - mounted.origin(before))
        P[9:], P[:, 9:] = 0.0, 0.0
        P[9:12, 9:12] = s.gyroscope_bias**2 * np.eye(3)
        P[12:, 12:] = s.accelerometer_bias**2 * np.eye(3)
        by = np.eye(SHOWN)
        by[6:9, :3] = -skew(R @ arm)  # how the new place turns with the old one
        filter_.reset(
            R @ turn,
            filter_.position + R @ arm,
            filter_.velocity,
            covariance=by @ P @ by.T,
        )
        filter_.widen(SWAYED)

    def _estimate(
        self, q: Array, v: Array, innovation: tuple[float, int], notes: list[str]
    ) -> Estimate:
        filter_, feet = self._filter, self._feet
        if not np.isfinite(q).all():
            raise InvalidInputError("estimator: the estimate is not finite; reset it")
        return Estimate(
            self._time,
            read_only(q),
            read_only(v),
            read_only(filter_.covariance),
            tuple(n for n, held in zip(self._foot_names, filter_.held, strict=True) if held),
            tuple(n for n, one in zip(self._foot_names, feet, strict=True) if one.slips),
            read_only(filter_.gyroscope_bias),
            read_only(filter_.accelerometer_bias),
            self._forces,
            innovation,
            tuple(notes),
        )

    # ------------------------------------------------------------------ memory

    def _memory(self) -> _Memory:
        return _Memory(
            self._filter.memory(),
            self._velocity.memory(),
            self._observer.memory(),
            self._imus,
            self._feet,
            self._forces,
            self._time,
            self._positions,
            self._distrusted,
            self._lost_since,
        )

    def _restore(self, memory: _Memory) -> None:
        self._filter.restore(memory.filter)
        self._velocity.restore(memory.velocity)
        self._observer.restore(memory.observer)
        self._imus, self._feet, self._forces = memory.imus, memory.feet, memory.forces
        self._time, self._positions = memory.time, memory.positions
        self._distrusted, self._lost_since = memory.distrusted, memory.lost_since


def _shortest(a: Array, b: Array) -> Array:
    """Return the shortest rotation (3, 3) from one unit vector to another."""
    axis = np.cross(a, b)
    sine, cosine = float(np.linalg.norm(axis)), float(a @ b)
    if sine < 1e-12:
        across = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        axis = across / np.linalg.norm(across)
        return np.eye(3) if cosine > 0.0 else exp_rotation(np.pi * axis)
    return exp_rotation(math.atan2(sine, cosine) / sine * axis)
