"""The loop that runs on a robot: read, check, estimate and tick, judge, limit, write, log.

One object owns the cycle. The controller has its own process and is asked once in a cycle: if it
answers in time, its command goes out in the same cycle; if not, the last one is held and the safety
layer counts. Nothing that the controller does, or does not do, keeps a cycle from being completed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from wbc.errors import InvalidInputError
from wbc.hardware.bus import Bus, BusError, Command, Reading
from wbc.hardware.log_row import log_fields, log_row
from wbc.hardware.loop_memory import LoopMemory
from wbc.hardware.loop_result import LoopResult, is_fault
from wbc.hardware.operator import LoopStatus, Operator, Wish
from wbc.hardware.postures import Motions
from wbc.hardware.real_time import Beat, CycleClock, check_cpus, pin, real_time
from wbc.hardware.real_time import now as clock_now
from wbc.hardware.ring_log import LogWriter, RingLog, Watcher
from wbc.hardware.robot_controller import RobotController
from wbc.hardware.safety import Event, Fault, ForbiddenTransition, Mode, Safety
from wbc.hardware.sensor_checks import SensorChecks
from wbc.hardware.worker import ForkedWorker, Job, Worker, WorkerOutcome, can_fork
from wbc.validate import Array, finite_number

PERIOD = 0.002  # s: of cycles
WITHOUT = 3  # periods of the controller without an answer that are no fault: contacts change
# In which nothing is commanded but damping, if at all.
DOWN = frozenset((Mode.IDLE, Mode.DAMPING, Mode.STOP))
PATIENCE = 2.0  # s without a usable reading, of a robot that is not armed, until that is said
AGAIN = 1.0  # s after which the same refusal is told again
SILENT_AFTER = 0.005  # s without a usable reading: two messages of 500 Hz
GONE_AFTER = 0.040  # s: the robot's side is gone, and the loop ends
STALL = 0.040  # s of lateness: the process was stopped or starved
RESERVE = 5e-4  # s of a cycle kept for what comes after the controller
BEFORE, AFTER = 10.0, 1.0  # s logged before and after an event
SPARE = 1.0  # s that the ring turns on while it is written, at least
SPARE_PART = 0.1  # and in parts of what it keeps
REST_TIME = 6.0  # s that a walk gets to come to rest
SEND_STOPS = 5  # damping commands that are sent when the loop ends


class HardwareLoop:
    """Runs a controller on a robot, over a bus.

    Parameters
    ----------
    bus:
        Opens the way to the robot: called once the controller's process is there.
    controller:
        Estimator and supervisor.
    safety, checks:
        The layer that judges, and what looks at readings.
    motions:
        Up and down.
    operator:
        Who says when.
    log:
        Where an event's log goes; None: nowhere.
    keep:
        How far logs reach back [s]; one is then written in the end, too, whatever happened. None:
        10 s, and nothing of a run without an event.
    made_of:
        What logs say of problem, profile and estimator, for :func:`wbc.hardware.replay.replay_log`.
    watch:
        Shows the log while it grows, in a process of its own that ends with the loop; only where
        there can be one.
    forked:
        Whether the controller has its own process, where that can be; it is forked now.
    priority:
        Of ``SCHED_FIFO``, where allowed; 0: none is asked for. The controller has half of it.
    cpus:
        On which the loop and, if there is a second, the controller run; empty: on any.
    say:
        Told of each mode that begins.

    Attributes
    ----------
    interrupted:
        Asked after each cycle whether somebody wants it to end; it then lets the operator know.
    """

    def __init__(
        self,
        bus: Callable[[], Bus],
        controller: RobotController,
        safety: Safety,
        checks: SensorChecks,
        motions: Motions,
        operator: Operator,
        *,
        log: Path | None = None,
        keep: float | None = None,
        made_of: Mapping[str, Any] | None = None,
        watch: Callable[[RingLog], None] | None = None,
        forked: bool = True,
        priority: int = 40,
        cpus: Sequence[int] = (),
        say: Callable[[str], None] = lambda text: None,
    ) -> None:
        check_cpus(cpus)
        self.controller, self.safety = controller, safety
        self._checks, self._motions, self._operator = checks, motions, operator
        self.dt = PERIOD
        self._every, self._feet = whole_cycles(controller.dt), tuple(controller.robot.feet)
        self._say, self._priority = say, priority
        n = len(safety.limits.effort)
        fields = log_fields(n, controller.robot.nq, controller.robot.nv)
        before = BEFORE if keep is None else finite_number("hardware, keep", keep, least=BEFORE)
        self._keeps = keep is not None
        self._ring = RingLog(fields, before + AFTER + max(SPARE, SPARE_PART * before), self.dt)
        self._forked = forked and can_fork()
        self._worker: Worker | ForkedWorker = (
            ForkedWorker(controller, priority // 2, cpus[-1] if cpus else None)
            if self._forked
            else Worker(controller)
        )
        pin(cpus[0] if cpus else None)
        rows = round((before + AFTER) / self.dt)
        self._writer = (
            None
            if log is None
            else LogWriter(self._ring, log, rows, made_of or {}, forked=self._forked)
        )
        self._watcher = Watcher(self._ring, watch) if watch and self._forked else None
        if watch and self._watcher is None:
            say("nothing is shown: there is no second process here")
        try:
            with real_time(priority):  # which a bus's own threads inherit
                self.bus = bus()
        except BaseException:
            self._worker.close()
            self._end_processes()
            raise
        self._began = 0.0
        self._now = LoopMemory()
        self._clock: CycleClock | None = None
        self.interrupted: Callable[[], bool] = lambda: False

    # ------------------------------------------------------------------ the whole

    def run(self, most: float = np.inf) -> LoopResult:
        """Run until the operator quits, the robot is gone, or ``most`` seconds are over."""
        notes: tuple[str, ...] = ()
        with real_time(self._priority) as refused:
            self._clock = CycleClock(self.dt)
            self._began = self._clock.due
            notes, asked = refused, False
            try:
                while not self._now.ended:
                    beat = self._clock.wait()
                    self.cycle(beat)
                    if not asked and self.interrupted():
                        asked = True
                        if self.safety.mode not in DOWN:
                            self._say("interrupted: it sits down; once more: it stops")
                    if asked and self.safety.mode in DOWN:
                        self._now.ended = "interrupted"
                    if beat.time - self._began > most:
                        self._now.ended = f"{most:g} s are over"
            except KeyboardInterrupt:
                self._now.ended = "interrupted"
            finally:
                self._leave()
        return self.result(notes)

    def _leave(self) -> None:
        """Send damping, whatever happened; write the log that waits."""
        now = self._now
        self.safety.stop(clock_now(), f"{now.ended or 'an error'}: the loop ends")
        for _ in range(SEND_STOPS):
            self._write(self.safety.admit(None))
        now.notes = tuple(self._worker.close())
        if now.log_at is not None or self._keeps:
            self._write_log(now.event or f"the end: {now.ended}")
        self._end_processes()

    def _end_processes(self) -> None:
        """End those that write and show."""
        if self._writer is not None:
            self._writer.close()
        if self._watcher is not None:
            self._watcher.close()

    def result(self, notes: Sequence[str] = ()) -> LoopResult:
        """Return how it went until now."""
        now, safety = self._now, self.safety
        writer = self._writer
        complaints = () if writer is None else tuple(writer.complaints)
        stopped = now.stopped or any(is_fault(one) for one in safety.events)
        return LoopResult(
            now.ended,
            now.time,
            not stopped,
            len(now.lateness),
            now.missed,
            now.held,
            np.array(now.lateness),
            np.array(now.seconds),
            tuple(safety.events),
            safety.counts.copy(),
            self.bus.dropped.copy(),
            (*notes, *complaints, *now.notes),
            () if writer is None else tuple(writer.written),
        )

    # ------------------------------------------------------------------ one cycle

    def cycle(self, beat: Beat) -> Command:
        """Make one cycle; return what was sent."""
        now, safety = self._now, self.safety
        time = now.time = beat.time
        now.asked = None
        now.lateness.append(beat.lateness)
        now.missed += beat.missed
        if beat.lateness > STALL:
            safety.report(Fault.STALLED, f"for {1e3 * beat.lateness:.0f} ms")
        elif beat.lateness > self.dt:
            safety.report(Fault.LATE_CYCLE, f"by {1e3 * beat.lateness:.1f} ms")
        fresh = self._read(time)
        self._obey(time)
        self._submit(fresh)
        if fresh is not None:  # while the controller is at work
            self._look_at(fresh)
        outcome = self._answered(time, fresh)
        wanted = self._wanted(time, outcome)
        mode = safety.judge(time)
        if mode is not now.mode:
            self._entered(mode, time)
            wanted = self._wanted(time, None)
        command = self._write(safety.admit(wanted))
        self._log(beat, command)
        return command

    def _read(self, time: float) -> Reading | None:
        """Return the new reading, if there is one of use."""
        now, safety = self._now, self.safety
        came = self.bus.read()
        fresh: Reading | None = None
        if came is not None:
            came = self._checks.mended(came)
            refused = self._checks.refused(came, time)
            if refused is None:
                fresh, now.heard = came, time
                now.before, now.reading = now.reading, came
            else:
                safety.report(*refused)
        silence = time - max(now.heard, self._began)
        if fresh is not None and now.told:
            self._say("the robot is heard")
            now.told = False
        elif silence > PATIENCE and not now.told:
            self._say(f"nothing heard for {PATIENCE:g} s: is the robot on, and on this bus?")
            now.told = True
        if fresh is None and silence > SILENT_AFTER:
            safety.report(Fault.SILENT, f"for {1e3 * silence:.0f} ms")
        if silence > GONE_AFTER and safety.mode is not Mode.IDLE and not now.ended:
            now.ended = f"the robot's side is gone: no usable reading for {1e3 * silence:.0f} ms"
        return fresh

    def _look_at(self, fresh: Reading) -> None:
        """Compare what sensors say with each other and with what was commanded."""
        now, torque = self._now, None
        if now.command is not None and now.before is not None and now.command.enabled:
            torque = now.command.motor_torque(now.before.position, now.before.velocity)
        for finding in self._checks.compared(fresh, torque):
            self.safety.report(*finding)
        self.safety.measured(fresh)

    def _submit(self, reading: Reading | None) -> None:
        """Ask the controller about a reading when it is time, unless it is still busy."""
        now, mode = self._now, self.safety.mode
        stands = mode is Mode.STANDING_UP and self._motions.up.is_over(now.time)
        asks = stands or mode is Mode.RUNNING
        now.turn += 1
        if asks and reading is not None and now.turn >= self._every:
            now.waiting, now.turn = reading, 0
        elif not asks:
            now.waiting = None
        if now.waiting is None or self._worker.busy:
            return
        commands = mode is Mode.RUNNING
        begins = not (now.runs if commands else now.stands)
        job = Job(now.waiting, begins, commands, now.sits_by is not None)
        self._worker.submit(job)
        now.asked, now.asked_last = job, job.reading.sequence
        now.runs, now.stands, now.waiting = commands, True, None

    def _answered(self, time: float, fresh: Reading | None) -> WorkerOutcome | None:
        """Return the controller's newest answer that is in time."""
        now, worker = self._now, self._worker
        newest: WorkerOutcome | None = None
        while (outcome := worker.result(self._left())) is not None:
            newest, now.answered = outcome, time
            about = now.asked_last
            now.took = clock_now() - time
            now.seconds.append(now.took)
            if now.waiting is None:
                break
            self._submit(None)
        if self.safety.mode is Mode.RUNNING:
            now.held += newest is None and worker.busy
            silence = time - max(now.answered, now.mode_began)
            if silence > WITHOUT * self._every * self.dt and fresh is not None:
                self.safety.report(Fault.NO_COMMAND, f"for {1e3 * silence:.0f} ms")
        if newest is not None and newest.answer is not None:
            now.answer_to = about
        return newest

    def _wanted(self, time: float, outcome: WorkerOutcome | None) -> Command | None:
        """Return what this mode commands; None: what was last commanded."""
        now, safety, reading = self._now, self.safety, self._now.reading
        if outcome is not None:
            self._judge_outcome(outcome)
        if safety.mode is Mode.RUNNING:
            if outcome is None or outcome.answer is None or not outcome.answer.ok:
                return None
            return outcome.answer.command
        motion = {Mode.STANDING_UP: self._motions.up, Mode.SOFT_STOP: self._motions.down}.get(
            safety.mode
        )
        if motion is None or reading is None:
            return None
        if not motion.has_begun:
            last = now.command
            torque: Array = np.zeros(len(reading.position))
            if last is not None:
                torque = last.motor_torque(reading.position, reading.velocity)
            motion.begin(time, reading.position, torque)
        return motion.command(time)

    def _judge_outcome(self, outcome: WorkerOutcome) -> None:
        answer, safety = outcome.answer, self.safety
        if answer is None:
            self._now.error = outcome.error
            if safety.mode is not Mode.RUNNING and outcome.no_estimate:
                return  # it has not stood still for long enough
            fault = Fault.ESTIMATOR_FAILED if outcome.no_estimate else Fault.CONTROLLER_RAISED
            safety.report(fault, outcome.error)
            return
        self._now.answer = answer
        if not answer.ok:
            safety.report(Fault.TICK_FAILED, answer.report)

    def _write(self, command: Command) -> Command:
        now = self._now
        now.sequence += 1
        command = command.numbered(now.sequence)
        try:
            self.bus.write(command)
        except BusError as error:
            self.safety.report(Fault.BUS_FAILED, str(error))
        now.command = command
        return command

    # ------------------------------------------------------------------ modes

    def _obey(self, time: float) -> None:
        """Do what the operator wishes, if the mode allows it."""
        now, safety = self._now, self.safety
        hears = now.reading is not None and time - now.heard < SILENT_AFTER
        passed = time - now.mode_began
        is_up = self._motions.up.is_over(time) and now.answer is not None
        status = LoopStatus(safety.mode, time - self._began, passed, hears, is_up)
        wish = self._operator.wish(status)
        try:
            if wish is not None:
                self._grant(wish, time, is_up)
        except ForbiddenTransition as refusal:
            self._tell(f"{wish}: {refusal}", time)
        if safety.mode is Mode.RUNNING and now.sits_by is not None:
            rests = now.answer is not None and now.answer.at_rest
            if rests or time > now.sits_by:
                safety.soft_stop(time)
        elif safety.mode is Mode.SOFT_STOP and self._motions.down.is_over(time):
            safety.is_down(time)
        if safety.mode is not now.mode:
            self._entered(safety.mode, time)

    def _tell(self, refusal: str, time: float) -> None:
        """Tell why a wish is refused; once a second, of a script that asks in each cycle."""
        events = self.safety.events
        if not events or events[-1].what != refusal or time - events[-1].time >= AGAIN:
            events.append(Event(time, refusal, self.safety.mode))
            self._say(refusal)

    def _grant(self, wish: Wish, time: float, is_up: bool) -> None:
        now, safety = self._now, self.safety
        at_once = {Wish.ARM: safety.arm, Wish.STAND: safety.stand_up, Wish.RESET: safety.reset}
        if wish in at_once:
            at_once[wish](time)
        elif wish is Wish.RUN:
            if safety.mode is Mode.STANDING_UP and not is_up:
                why = f"no estimate: {now.error}" if now.error else "it is not up yet"
                raise ForbiddenTransition(why)
            safety.run(time)
        elif wish is Wish.SIT:
            if safety.mode is Mode.RUNNING:
                now.sits_by = time + REST_TIME
            elif safety.mode is Mode.STANDING_UP:
                safety.soft_stop(time)
            elif safety.mode is Mode.DAMPING:
                safety.reset(time)
        elif wish is Wish.STOP:
            safety.stop(time)
        else:
            if safety.mode not in DOWN:
                raise ForbiddenTransition(f"sit, or stop, first: {safety.mode}")
            now.ended = "asked to quit"

    def _entered(self, mode: Mode, time: float) -> None:
        """Take note of a mode that began; a stop of any kind is logged."""
        now = self._now
        self._say(f"{time - self._began:8.3f} s  {mode}: {self.safety.events[-1].what}")
        now.mode, now.mode_began = mode, time
        now.runs = now.stands = False
        if mode is Mode.STANDING_UP:
            now.answer, now.error = None, ""
            self._motions.up.end()
            self._motions.down.end()
        now.sits_by = None if mode is not Mode.RUNNING else now.sits_by
        event = self.safety.events[-1]
        if is_fault(event):
            now.stopped = True
            if now.log_at is None:
                now.log_at, now.event = time + AFTER, event.what

    # ------------------------------------------------------------------ time and log

    def _left(self) -> float:
        """Return how long the controller may still take in this cycle [s]."""
        if not self._forked or self._clock is None:
            return 0.0
        return self._clock.due - RESERVE - clock_now()

    def _log(self, beat: Beat, command: Command) -> None:
        now = self._now
        self._ring.add(log_row(beat, self.safety, command, now, self._feet))
        if now.log_at is not None and beat.time >= now.log_at:
            self._write_log(now.event)

    def _write_log(self, event: str) -> None:
        now = self._now
        now.log_at = None
        if self._writer is None:
            return
        told = [f"{one.time:.4f} {one.mode}: {one.what}" for one in self.safety.events]
        self._writer.write(told, event)


def whole_cycles(dt: float) -> int:
    """Return how many cycles the controller's period has.

    Raises
    ------
    InvalidInputError
        No whole number of them.
    """
    cycles = round(dt / PERIOD)
    if cycles < 1 or abs(cycles * PERIOD - dt) > 1e-9:
        raise InvalidInputError(
            f"hardware: controller.dt {dt:g} s is no multiple of the cycle, {PERIOD:g} s"
        )
    return cycles
