"""The control loop on a robot: read, check, estimate and tick, judge, limit, write, log.

One object owns the cycle. The controller runs in its own process: if it answers in time, its
command is sent in the same cycle; if not, the last one is held and the safety layer counts.
Whatever the controller does, every cycle is completed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import numpy as np

from wbc.errors import InvalidInputError, UnknownNameError
from wbc.hardware.bus import Bus, BusError, Command, Reading, thrown_away
from wbc.hardware.log_row import LoopState, log_fields, log_row
from wbc.hardware.loop_result import HANGS, LoopResult, is_fault
from wbc.hardware.operator import LoopStatus, Operator, Wish
from wbc.hardware.postures import Motions
from wbc.hardware.real_time import Beat, CycleClock, check_cpus, pin, real_time
from wbc.hardware.real_time import now as clock_now
from wbc.hardware.ring_log import LogWriter, RingLog, Watcher
from wbc.hardware.robot_controller import RobotController
from wbc.hardware.safety import Event, Fault, ForbiddenTransition, Mode, Safety
from wbc.hardware.sensor_checks import SensorChecks
from wbc.hardware.worker import ForkedWorker, Job, Worker, WorkerOutcome, can_fork
from wbc.kinds import one_of
from wbc.validate import finite_number

PERIOD = 0.002  # s: of cycles
ALLOWED_MISSES = 3  # ticks without an answer before that is a fault: contact changes take time
# Modes that command damping at most.
PASSIVE_MODES = frozenset((Mode.IDLE, Mode.DAMPING, Mode.STOP))
SILENCE_NOTICE = 2.0  # s without a usable reading until the operator is told
REPEAT_NOTICE = 1.0  # s until the same refusal is repeated
SILENCE = 0.005  # s without a usable reading until that is a fault: two messages of 500 Hz
ROBOT_GONE = 0.040  # s without a usable reading until the loop ends
STALL_LATENESS = 0.040  # s of lateness: the process was stopped or starved
CYCLE_RESERVE = 5e-4  # s of a cycle for the work after the controller
BEFORE, AFTER = 10.0, 1.0  # s logged before and after an event
# Rows of the ring for cycles while it is written: at least [s], and as a ratio of its length.
SPARE, SPARE_RATIO = 1.0, 0.1
REST_TIME = 6.0  # s for a walk to come to rest
# s in which a robot that is up waits for an estimate, which takes half a second: its joints hold a
# posture but do not balance, and it leans, twice as far in about a second.
UNBALANCED_TIME = 1.5
# Part of the weight on the feet with which the controller may balance, and s for which it may be
# less.
MIN_LOAD, HANG_TIME = 0.5, 0.1
PROBLEM_BEGINS = "the problem begins"
FINAL_STOPS = 5  # damping commands sent when the loop ends
LISTENING = 1.0  # s to listen for another program's commands: DDS finds others in less


class HardwareLoop:
    """Runs a controller on a robot, over a bus.

    Parameters
    ----------
    bus:
        Opens the bus: called after the controller's process is forked.
    controller:
        Estimator and supervisor.
    safety, checks:
        The safety layer, and the checks of readings.
    motions:
        Up and down.
    operator:
        Requests modes.
    log:
        File of an event's log; None: no logs.
    keep:
        Length of logs [s]; one is then written at the end in any case. None: 10 s, and no log of a
        run without an event.
    made_of:
        Problem, profile and estimator for logs, see :func:`wbc.hardware.replay.replay_log`.
    watch:
        Shows the log live, in a process of its own that ends with the loop, where the system can
        fork.
    forked:
        Whether the controller has its own process, where possible; it is forked now.
    priority:
        Of ``SCHED_FIFO``, where allowed; 0: none. The controller has half of it.
    cpus:
        CPUs of the loop and, if there is a second, of the controller; empty: any.
    say:
        Called with a text for each mode that begins.

    Attributes
    ----------
    interrupted:
        Called after each cycle; True makes the robot sit down, and then ends the loop.
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
        log: str | Path | None = None,
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
        self._cycles, self._feet = cycles_per_tick(controller.dt), tuple(controller.robot.feet)
        self._say, self._priority = say, priority
        n = len(safety.limits.effort)
        fields = log_fields(n, controller.robot.nq, controller.robot.nv)
        before = BEFORE if keep is None else finite_number("hardware, keep", keep, least=BEFORE)
        self._always_logs = keep is not None
        self._ring = RingLog(fields, before + AFTER + max(SPARE, SPARE_RATIO * before), self.dt)
        self._forked = forked and can_fork()
        self._worker: Worker | ForkedWorker = (
            ForkedWorker(controller, priority // 2, cpus[-1] if cpus else None)
            if self._forked
            else Worker(controller)
        )
        rows = round((before + AFTER) / self.dt)
        self._writer = (
            None
            if log is None
            else LogWriter(self._ring, log, rows, made_of or {}, forked=self._forked)
        )
        self._watcher = Watcher(self._ring, watch) if watch and self._forked else None
        if watch and self._watcher is None:
            say("nothing is shown: there is no second process here")
        pin(cpus[0] if cpus else None)  # what writes and shows logs is elsewhere
        try:
            with real_time(priority):  # which a bus's own threads inherit
                self.bus = bus()
            _refuse_second(self.bus)
        except BaseException:
            self._worker.close()
            self._end_processes()
            raise
        self._start = 0.0
        self._state = LoopState(safety.admit(None))
        self._clock: CycleClock | None = None
        self.interrupted: Callable[[], bool] = lambda: False

    # ------------------------------------------------------------------ run

    def run(self, most: float = np.inf) -> LoopResult:
        """Run until the operator quits, the robot is gone, or ``most`` seconds have passed.

        Raises
        ------
        InvalidInputError
            It ran before: its controller and its log are closed.
        """
        if self._clock is not None:
            raise InvalidInputError("hardware: this loop has run, and ended; make another")
        with real_time(self._priority) as not_granted:
            self._clock = CycleClock(self.dt)
            self._start, interrupting = self._clock.due, False
            try:
                while not self._state.ended:
                    beat = self._clock.wait()
                    self.cycle(beat)
                    if not interrupting and self.interrupted():
                        interrupting = True
                        if self.safety.mode not in PASSIVE_MODES:
                            self._say("interrupted: it sits down; Ctrl-C, once more: it stops")
                            self._grant(Wish.SIT, beat.time, is_up=False)
                    if interrupting and self.safety.mode in PASSIVE_MODES:
                        self._state.ended = "interrupted"
                    if beat.time - self._start > most:
                        self._state.ended = f"{most:g} s are over"
            except KeyboardInterrupt:
                self._state.ended = "interrupted"
            except Exception as error:  # of an operator, or a bus: its log tells what was before
                self._state.ended = f"{type(error).__name__}: {error}"
                self._state.log_time = self._state.time
                raise
            finally:
                self._shut_down()
        return self.result(not_granted)

    def _shut_down(self) -> None:
        """Send damping in any case; write the pending log."""
        state = self._state
        self.safety.stop(clock_now(), f"{state.ended or 'an error'}: the loop ends")
        try:
            for _ in range(FINAL_STOPS):
                self._write(self.safety.admit(None))
        finally:  # whatever a bus of one's own raises
            state.notes = tuple(self._worker.close())
            if state.log_time is not None or self._always_logs:
                self._write_log(state.event or f"the end: {state.ended}")
            self._end_processes()

    def _end_processes(self) -> None:
        """End the processes that write and show logs."""
        if self._writer is not None:
            self._writer.close()
        if self._watcher is not None:
            self._watcher.close()

    def result(self, notes: Sequence[str] = ()) -> LoopResult:
        """Return the result so far."""
        state, safety = self._state, self.safety
        writer = self._writer
        errors = () if writer is None else tuple(writer.errors)
        stopped = state.had_fault or any(is_fault(one) for one in safety.events)
        return LoopResult(
            state.ended,
            state.time,
            not stopped,
            len(state.lateness),
            state.missed,
            state.held_cycles,
            np.array(state.lateness),
            np.array(state.seconds),
            tuple(safety.events),
            safety.counts.copy(),
            self.bus.dropped.copy(),
            (*notes, *errors, *state.notes),
            () if writer is None else tuple(writer.written),
        )

    # ------------------------------------------------------------------ one cycle

    def cycle(self, beat: Beat) -> Command:
        """Make one cycle; return the command that was sent."""
        state, safety = self._state, self.safety
        time = state.time = beat.time
        state.request = None
        state.lateness.append(beat.lateness)
        state.missed += beat.missed
        if beat.lateness > STALL_LATENESS:
            safety.report(Fault.STALLED, f"for {1e3 * beat.lateness:.0f} ms")
        elif beat.lateness > self.dt:
            safety.report(Fault.LATE_CYCLE, f"by {1e3 * beat.lateness:.1f} ms")
        fresh = self._read(time)
        self._handle_operator(time)
        self._request_answer(fresh)
        if fresh is not None:  # in parallel to the controller
            self._check_sensors(fresh)
        outcome = self._collect_answer(time, fresh)
        wanted = self._desired_command(time, outcome)
        mode = safety.judge(time)
        if mode is not state.mode:
            self._on_mode_change(mode, time)
            wanted = self._desired_command(time, None)
        command = self._write(safety.admit(wanted))
        self._log(beat, command)
        return command

    def _read(self, time: float) -> Reading | None:
        """Return the new reading, if there is a usable one."""
        state, safety = self._state, self.safety
        fresh, message, why = None, None, ""
        try:
            message = self.bus.read()
        except (BusError, OSError) as error:  # as without any: silence has its answer
            why = f": {error}"
        if message is not None:
            message = self._checks.mended(message)
            finding = self._checks.refused(message, time)
            if finding is None:
                fresh, state.last_reading_time = message, time
                state.previous, state.reading = state.reading, message
            else:
                safety.report(*finding)
        silence = time - max(state.last_reading_time, self._start)
        if fresh is not None and state.silence_reported:
            self._say("the robot is heard")
            state.silence_reported = False
        elif silence > SILENCE_NOTICE and not state.silence_reported:
            self._say(
                f"nothing heard for {SILENCE_NOTICE:g} s{why}: is the robot on, and on this bus?"
                f"{thrown_away(self.bus.dropped)}"
            )
            state.silence_reported = True
        if fresh is None and silence > SILENCE:
            safety.report(Fault.SILENT, f"for {1e3 * silence:.0f} ms{why}")
        if silence > ROBOT_GONE and safety.mode is not Mode.IDLE and not state.ended:
            state.ended = f"the robot's side is gone: no usable reading for {1e3 * silence:.0f} ms"
        return fresh

    def _check_sensors(self, fresh: Reading) -> None:
        """Compare sensors with each other and with the last command."""
        state, torque = self._state, None
        if state.previous is not None and state.command.enabled:
            torque = state.command.motor_torque(state.previous.position, state.previous.velocity)
        for finding in self._checks.compared(fresh, torque):
            self.safety.report(*finding)
        self.safety.measured(fresh)

    def _request_answer(self, reading: Reading | None) -> None:
        """Request an answer to a reading when a tick is due."""
        state, mode = self._state, self.safety.mode
        is_up = mode is Mode.STANDING_UP and self._motions.up.is_over(state.time)
        is_needed = is_up or mode is Mode.RUNNING
        state.waited += 1
        if is_needed and reading is not None and state.waited >= self._cycles:
            state.pending_reading, state.waited = reading, 0
        elif not is_needed:
            state.pending_reading = None
        self._submit()

    def _submit(self) -> None:
        """Pass the pending request on, unless the controller is busy."""
        state = self._state
        if state.pending_reading is None or self._worker.busy:
            return
        commands = self.safety.mode is Mode.RUNNING
        begins = not (state.is_commanding if commands else state.is_observing)
        rests, waits = state.sit_deadline is not None, commands and state.waits
        job = Job(state.pending_reading, begins, commands, rests, waits)
        self._worker.submit(job)
        state.request, state.request_sequence = job, job.reading.sequence
        state.is_commanding, state.is_observing, state.pending_reading = commands, True, None

    def _collect_answer(self, time: float, fresh: Reading | None) -> WorkerOutcome | None:
        """Return the controller's newest answer within this cycle."""
        state, worker, newest = self._state, self._worker, None
        while (outcome := worker.result(self._time_left())) is not None:
            if state.is_stale:  # to a request of the mode before
                state.is_stale = False
                self._submit()
                continue
            newest, state.last_answer_time = outcome, time
            sequence = state.request_sequence
            state.answer_duration = clock_now() - time
            state.seconds.append(state.answer_duration)
            if state.pending_reading is None:
                break
            self._submit()
        if self.safety.mode is Mode.RUNNING:
            state.held_cycles += newest is None and worker.busy
            silence = time - max(state.last_answer_time, state.mode_start)
            if silence > ALLOWED_MISSES * self._cycles * self.dt and fresh is not None:
                self.safety.report(Fault.NO_COMMAND, f"for {1e3 * silence:.0f} ms")
        if newest is not None and newest.answer is not None:
            state.answer_sequence = sequence
        return newest

    def _desired_command(self, time: float, outcome: WorkerOutcome | None) -> Command | None:
        """Return this mode's command; None: hold the last one."""
        state, safety, reading = self._state, self.safety, self._state.reading
        if outcome is not None:
            self._report_outcome(outcome)
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
            torque = state.command.motor_torque(reading.position, reading.velocity)
            motion.begin(time, reading.position, torque)
        return motion.command(time)

    def _report_outcome(self, outcome: WorkerOutcome) -> None:
        answer, safety = outcome.answer, self.safety
        if answer is None:
            self._state.error = outcome.error
            if safety.mode is not Mode.RUNNING and outcome.no_estimate:
                return  # the robot has not stood still for long enough
            fault = Fault.ESTIMATOR_FAILED if outcome.no_estimate else Fault.CONTROLLER_RAISED
            safety.report(fault, outcome.error)
            return
        state = self._state
        state.answer, state.error = answer, ""
        if answer.load >= MIN_LOAD:
            state.load_time = state.time
        if not answer.ok:
            safety.report(Fault.TICK_FAILED, answer.report)

    def _write(self, command: Command) -> Command:
        state = self._state
        state.sequence += 1
        command = command.numbered(state.sequence)
        try:
            self.bus.write(command)
        except (BusError, OSError) as error:
            self.safety.report(Fault.BUS_FAILED, str(error))
        state.command = command
        return command

    # ------------------------------------------------------------------ modes

    def _handle_operator(self, time: float) -> None:
        """Carry out the operator's wish, if the mode allows it."""
        state, safety = self._state, self.safety
        has_readings = state.reading is not None and time - state.last_reading_time < SILENCE
        mode_time = time - state.mode_start
        is_up = self._motions.up.is_over(time) and self._load >= MIN_LOAD
        status = LoopStatus(safety.mode, time - self._start, mode_time, has_readings, is_up)
        wish = self._operator.wish(status)
        try:
            if wish is not None:
                self._grant(Wish(one_of("wish", wish, list(Wish))), time, is_up)
        except UnknownNameError as refusal:
            self._report_refusal(str(refusal), time)
        except ForbiddenTransition as refusal:
            self._report_refusal(f"{wish}: {refusal}", time)
        if safety.mode is Mode.RUNNING and state.sit_deadline is not None:
            at_rest = state.answer is not None and state.answer.at_rest
            if at_rest or time > state.sit_deadline:
                safety.soft_stop(time)
        elif safety.mode is Mode.RUNNING and state.waits and time - state.load_time > HANG_TIME:
            safety.soft_stop(time, self._hangs)  # hoisted: it would stretch its legs
        elif safety.mode is Mode.SOFT_STOP and self._motions.down.is_over(time):
            safety.is_down(time)
        elif safety.mode is state.mode is Mode.STANDING_UP and self._motions.up.is_over(time):
            self._end_standing_up(time, is_up)
        if safety.mode is not state.mode:
            self._on_mode_change(safety.mode, time)

    def _end_standing_up(self, time: float, is_up: bool) -> None:
        """Let the controller balance if the feet bear, with an estimate; else go down again."""
        if is_up:
            self.safety.run(time)
        elif self._motions.up.is_over(time - UNBALANCED_TIME):
            missing = f"no estimate: {self._state.error or 'no answer'}"
            self.safety.soft_stop(time, missing if self._state.answer is None else self._hangs)

    @property
    def _load(self) -> float:
        """The part of the weight that the feet bear before the problem begins, or 0: not known."""
        answer = self._state.answer
        return 0.0 if answer is None else answer.load

    @property
    def _hangs(self) -> str:
        """What is wrong where the feet bear too little."""
        return f"{HANGS}{100.0 * max(self._load, 0.0):.0f} % of the weight"

    def _report_refusal(self, refusal: str, time: float) -> None:
        """Report why a wish is refused, at most once a second for the same reason."""
        events = self.safety.events
        if not events or events[-1].what != refusal or time - events[-1].time >= REPEAT_NOTICE:
            events.append(Event(time, refusal, self.safety.mode))
            self._say(refusal)

    def _grant(self, wish: Wish, time: float, is_up: bool) -> None:
        state, safety = self._state, self.safety
        actions = {Wish.ARM: safety.arm, Wish.STAND: safety.stand_up, Wish.RESET: safety.reset}
        if wish in actions:
            actions[wish](time)
        elif wish is Wish.RUN:
            self._begin_problem(time, is_up)
        elif wish is Wish.SIT:
            if safety.mode is Mode.RUNNING and state.sit_deadline is None:
                state.sit_deadline = time + REST_TIME
                self._say("sit: it comes to rest first")
            elif safety.mode is Mode.STANDING_UP:
                safety.soft_stop(time)
            elif safety.mode is Mode.DAMPING:
                safety.reset(time)
        elif wish is Wish.STOP:
            safety.stop(time)
        else:
            if safety.mode not in PASSIVE_MODES:
                raise ForbiddenTransition(f"sit, or stop, first: {safety.mode}")
            state.ended = "asked to quit"

    def _begin_problem(self, time: float, is_up: bool) -> None:
        """Begin the problem: now if the robot is up, else as soon as it is."""
        state, safety = self._state, self.safety
        if safety.mode is Mode.RUNNING and not state.waits:
            raise ForbiddenTransition("the problem has begun already")
        if safety.mode is Mode.RUNNING:
            if state.sit_deadline is not None:
                raise ForbiddenTransition("it is about to sit down")
            state.waits = False
            safety.events.append(Event(time, PROBLEM_BEGINS, safety.mode))
            self._say(f"{time - self._start:8.3f} s  {safety.mode}: {PROBLEM_BEGINS}")
        elif safety.mode is Mode.STANDING_UP and not is_up:
            if not state.runs_when_up:
                missing = f"; no estimate yet: {state.error}" if state.error else ""
                self._say(f"run: as soon as it is up{missing}")
            state.runs_when_up = True
        else:
            safety.run(time)
            state.runs_when_up = True

    def _on_mode_change(self, mode: Mode, time: float) -> None:
        """Record a mode that began; schedule a log after a fault's stop."""
        state = self._state
        self._say(f"{time - self._start:8.3f} s  {mode}: {self.safety.events[-1].what}")
        state.mode, state.mode_start, state.load_time = mode, time, time
        state.is_commanding = state.is_observing = False
        state.is_stale = mode is not Mode.RUNNING and self._worker.busy
        state.waits = mode is Mode.RUNNING and not state.runs_when_up
        if state.waits:
            self._say("it balances where the problem begins: run begins it, sit goes down")
        if mode is Mode.STANDING_UP:
            state.answer, state.error, state.runs_when_up = None, "", False
            self._motions.up.end()
            self._motions.down.end()
        state.sit_deadline = None if mode is not Mode.RUNNING else state.sit_deadline
        event = self.safety.events[-1]
        if is_fault(event):
            state.had_fault = True
            if state.log_time is None:
                state.log_time, state.event = time + AFTER, event.what

    # ------------------------------------------------------------------ time and log

    def _time_left(self) -> float:
        """Return the time left for the controller in this cycle [s]."""
        if not self._forked or self._clock is None:
            return 0.0
        return self._clock.due - CYCLE_RESERVE - clock_now()

    def _log(self, beat: Beat, command: Command) -> None:
        state = self._state
        self._ring.add(log_row(beat, self.safety, command, state, self._feet))
        if state.log_time is not None and beat.time >= state.log_time:
            self._write_log(state.event)

    def _write_log(self, event: str) -> None:
        state = self._state
        state.log_time, state.event = None, ""
        if self._writer is None:
            return
        events = [f"{one.time:.4f} {one.mode}: {one.what}" for one in self.safety.events]
        self._writer.write(events, event)


def _refuse_second(bus: Bus) -> None:
    """Refuse a bus on which another program commands, where it can hear that.

    The first command of this loop would switch off the motors under a robot that stands.
    """
    commands_heard: Callable[[], int] | None = getattr(bus, "commands_heard", None)
    until = monotonic() + LISTENING
    while commands_heard is not None and monotonic() < until:
        if commands_heard():
            bus.close()
            raise BusError("another program commands this robot: end it, or wait until it is done")
        sleep(0.01)


def cycles_per_tick(dt: float) -> int:
    """Return the number of cycles in the controller's period."""
    cycles = round(dt / PERIOD)
    if cycles < 1 or abs(cycles * PERIOD - dt) > 1e-9:
        raise InvalidInputError(
            f"hardware: controller.dt {dt:g} s is no multiple of the cycle, {PERIOD:g} s"
        )
    return cycles
