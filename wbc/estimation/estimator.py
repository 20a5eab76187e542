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

from wbc.errors import InvalidInputError, shown
from wbc.estimation.beginning import SWAYED, Beginning, bias_covariance, level
from wbc.estimation.contact_filter import SHOWN, ContactFilter, Counts
from wbc.estimation.estimate import Estimate
from wbc.estimation.imus import ImuMount, ImuWatch, Inertial
from wbc.estimation.joint_readings import JointMemory, JointReadings
from wbc.estimation.measurement import Measurement
from wbc.estimation.momentum_observer import MomentumObserver
from wbc.estimation.settings import EstimatorSettings
from wbc.estimation.sight import Sight
from wbc.estimation.standing_feet import FeetApart, FootSeen, FootWatch, track
from wbc.robot import Robot
from wbc.robot.limits import BASE_NV
from wbc.robot.model import check_robot
from wbc.spatial import skew
from wbc.validate import Array, read_only


class _Memory(NamedTuple):
    """All that an estimator knows between two messages."""

    filter: tuple[Array, Counts]
    joints: JointMemory
    observer: Array
    imus: ImuWatch | None
    feet: tuple[FootWatch, ...]
    apart: FeetApart
    forces: Mapping[str, Array]
    time: float
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
        s = self.settings
        self._sight = Sight(robot, self.imus, s)
        self._joints = JointReadings(robot, s.velocity_window, dt)
        self.velocity_delay = self._joints.delay
        self._observer = MomentumObserver(robot, s.bandwidth)
        self._gravity = np.array(robot.model.gravity.linear)
        self._filter = ContactFilter(len(robot.feet), s.noise, self._gravity)
        self.notes = (
            "heading and position are relative to the start: nothing observes them, and their"
            " variance grows",
            f"joint velocities that are not measured are {1e3 * self.velocity_delay:.1f} ms old",
        )
        self.reset()

    def __repr__(self) -> str:
        names = ", ".join(one.name for one in self.imus)
        state = "standing to begin" if self._beginning else f"t={self._time:.3f} s"
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
        self._start = None if q is None else self.robot.check_configuration(q)
        self._beginning: Beginning | None = Beginning(
            self.imus[0].name, self.settings.standing_time
        )
        self._past: deque[tuple[Measurement, _Memory]] = deque(maxlen=self.settings.history)
        self._forget(0.0)

    def _forget(self, time: float) -> None:
        self._joints.reset()
        self._observer.reset()
        self._imus: ImuWatch | None = None
        count = len(self._sight.feet)
        self._feet, self._apart = (FootWatch(),) * count, FeetApart({}, (0.0,) * count)
        self._forces: Mapping[str, Array] = {}
        self._time = time
        self._lost_since: float | None = None

    def _stand(self, beginning: Beginning, measurement: Measurement) -> Estimate | None:
        """Wait until it stood still long enough; then begin, with all that was measured."""
        waited = beginning.collect(measurement)
        if waited is None:
            return None
        self._sight.look(waited[0].positions)
        self._forget(waited[0].time)
        mean = beginning.mean
        level(self._filter, self._sight, mean, self._gravity, self._start, self.settings)
        self._beginning = None
        for one in waited:
            estimate = self._take(one, standing=True)
        return estimate

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
        if self._beginning is not None:
            return self._stand(self._beginning, measurement)
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
        positions, rates = self._joints.take(m, dt, notes)
        if self.settings.encoder_delay:
            positions = positions + self.settings.encoder_delay * rates
        if inertial.leader != before:
            self._follow(before, inertial.leader)
        if dt > 0.0:
            self._filter.predict(inertial.rate, inertial.force, dt, inertial.scale)
        self._sight.look(positions)
        squared, rows = self._see_feet(m, inertial, rates, standing, notes)
        q, v = self._sight.state(self._filter, inertial.leader, inertial.rate, positions, rates)
        self._feel(m, q, v, dt)
        self._last = self._estimate(q, v, (squared, rows), notes)
        return self._last

    # ------------------------------------------------------------------ feet

    def _see_feet(
        self, m: Measurement, inertial: Inertial, rates: Array, standing: bool, notes: list[str]
    ) -> tuple[float, int]:
        """Hold, correct by or release each foot; return NIS and rows."""
        filter_, sight = self._filter, self._sight
        loads, shares = self._loads(m, standing)
        if loads is None:
            notes.append("no contacts, forces or torques: all feet are taken to bear always")
            loads = (1.0,) * len(sight.feet)
        squared, rows, feet, held = 0.0, 0, list[FootWatch](), filter_.held
        speeds = [0.0] * len(held)
        lost = self._lost_since is not None and m.time - self._lost_since > self.settings.lost
        for k, name in enumerate(sight.feet):
            watch = self._feet[k].loaded(m.time, loads[k], shares)
            if not (watch.bears or held[k]):
                feet.append(watch)
                continue
            place, noise = sight.place(k, inertial.leader, rates)
            speed = speeds[k] = filter_.foot_speed(inertial.rate, place)
            if lost and watch.bears and not held[k]:
                notes.append(f"no foot is still: {name} is counted on at {speed:.2f} m/s")
                filter_.widen(speed)
                speed, watch = 0.0, replace(watch, since=-math.inf)
            seen = FootSeen(place, noise, speed, sight.flat[k])
            found = track(filter_, held[k], k, name, watch, seen, m.time, self.settings)
            feet.append(found.watch)
            squared, rows = squared + found.squared, rows + found.rows
            if found.note:
                notes.append(found.note)
        places = sight.places[:, :3]
        held = filter_.held
        self._apart, slipped, way = self._apart.seen(held, places, speeds, self.settings.apart)
        if slipped is not None:
            filter_.release(slipped)
            feet[slipped] = FootWatch(True, m.time, slips=True)
            name, far = sight.feet[slipped], 1e3 * way
            notes.append(
                f"{name} foot slips: feet are {far:.1f} mm nearer or farther; not counted on"
            )
        self._feet = tuple(feet)
        stands = sum(held) > (slipped is not None)
        if stands or not any(one.bears for one in feet):
            self._lost_since = None
        elif self._lost_since is None:
            self._lost_since = m.time
        return squared, rows

    def _loads(
        self, m: Measurement, standing: bool
    ) -> tuple[Sequence[float] | None, tuple[float, float]]:
        """Return the loads of the feet by the weight, and from which share on one bears."""
        s, names, weight = self.settings, self._sight.feet, self.robot.weight
        if standing:
            return (1.0,) * len(names), s.load
        if m.forces is not None:
            return [m.forces.get(name, 0.0) / weight for name in names], s.load
        if m.contacts is not None:
            return [float(m.contacts.get(name, False)) for name in names], s.load
        if self._forces:
            return [float(self._forces[name][2]) / weight for name in names], s.estimated_load
        return None, s.load

    def _feel(self, m: Measurement, q: Array, v: Array, dt: float) -> None:
        """Estimate the forces on the soles from the motors' torques."""
        if m.torques is None:
            self._forces = {}
            return
        self._observer.update(q, v, m.torques, dt)
        self._forces = self._observer.wrenches

    def _follow(self, before: int, leader: int) -> None:
        """Go on with another IMU: the same body, another place and biases nobody knows."""
        filter_, sight = self._filter, self._sight
        R, P, own = filter_.rotation, filter_.covariance, sight.imu_rotation(before).T
        arm = R @ own @ (sight.imu_origin(leader) - sight.imu_origin(before))
        P[9:], P[:, 9:] = 0.0, 0.0
        P[9:, 9:] = bias_covariance(self.settings)
        by = np.eye(SHOWN)
        by[6:9, :3] = -skew(arm)  # how the new place turns with the old one
        turned = R @ own @ sight.imu_rotation(leader)
        velocity, place = filter_.velocity, filter_.position + arm
        filter_.reset(turned, place, velocity, covariance=by @ P @ by.T)
        filter_.widen(SWAYED)

    def _estimate(
        self, q: Array, v: Array, innovation: tuple[float, int], notes: list[str]
    ) -> Estimate:
        filter_, feet = self._filter, self._feet
        if not np.isfinite(q.sum()):  # NaN of any entry is one of the sum
            raise InvalidInputError("estimator: the estimate is not finite; reset it")
        return Estimate(
            self._time,
            read_only(q),
            read_only(v),
            read_only(filter_.covariance),
            tuple(n for n, held in zip(self._sight.feet, filter_.held, strict=True) if held),
            tuple(n for n, one in zip(self._sight.feet, feet, strict=True) if one.slips),
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
            self._joints.memory(),
            self._observer.memory(),
            self._imus,
            self._feet,
            self._apart,
            self._forces,
            self._time,
            self._lost_since,
        )

    def _restore(self, memory: _Memory) -> None:
        self._filter.restore(memory.filter)
        self._joints.restore(memory.joints)
        self._observer.restore(memory.observer)
        self._imus, self._feet, self._forces = memory.imus, memory.feet, memory.forces
        self._apart = memory.apart
        self._time, self._lost_since = memory.time, memory.lost_since
