"""Every fault has its answer: which mode the loop is in afterwards, and what it was told."""

import copy
import gc
import io
import multiprocessing
import os
import signal
import subprocess
import sys
import textwrap
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hardware_faults import (
    CONTROLLER_FAULTS,
    DT,
    READING_FAULTS,
    HungWorker,
    Rig,
    after,
    shifted,
    soak,
)

from tests.command import wbc_command
from wbc.cli.hardware_run import _print, _printer
from wbc.errors import InvalidInputError, WbcError
from wbc.hardware.bus import Bus, BusError, Reading
from wbc.hardware.loop import PROBLEM_BEGINS, HardwareLoop
from wbc.hardware.operator import Keyboard, Script, Wish
from wbc.hardware.real_time import Beat, CycleClock, check_cpus
from wbc.hardware.robot_controller import ControllerAnswer, EstimateError
from wbc.hardware.safety import RULES, TRANSITIONS, Event, Fault, Mode
from wbc.hardware.worker import ForkedWorker, Job, can_fork


@pytest.fixture(scope="module")
def running() -> Rig:
    made = Rig()
    made.start()
    return made


@pytest.fixture
def rig(running: Rig) -> Rig:
    """Return a copy of a loop that runs, which shares nothing that changes with the others."""
    copied = copy.deepcopy(running)
    assert copied.loop.bus is copied.bus is not running.bus
    return copied


def ask(rig: Rig, seconds: float, *wishes: Wish) -> None:
    """Wish for something, and let the loop go on."""
    rig.wanted.extend(wishes)
    rig.cycles(seconds)


def heard(rig: Rig) -> list[str]:
    """Return what the loop says from now on."""
    said = list[str]()
    rig.loop._say = said.append
    return said


def told(rig: Rig) -> list[str]:
    return [event.what for event in rig.safety.events]


def loop_on(rig: Rig, bus: Callable[[], Bus], **given: Any) -> HardwareLoop:
    """Return a loop of the rig's parts on a bus of its own."""
    parts: Any = rig.controller, rig.safety, rig.loop._checks, rig.loop._motions, rig
    return HardwareLoop(bus, *parts, priority=0, **given)


@pytest.mark.parametrize("name", READING_FAULTS)
def test_a_fault_of_readings_is_answered(name: str, rig: Rig) -> None:
    change, mode = READING_FAULTS[name]
    rig.cycles(0.13)  # the swing is neither in its middle nor at its end
    rig.bus.inject(change)
    for _ in range(250):
        command = rig.cycle()
        assert not rig.excess(command)
    assert not after(name, mode, rig)


@pytest.mark.parametrize("jump", [-5.0, -0.3, 0.3, 5.0])
def test_times_go_on_for_the_controller_where_the_robots_clock_jumped(
    jump: float, rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Back, its estimate stayed where it was; ahead, one reading was to stand for seconds."""
    asked, command = list[float](), rig.controller.command

    def noted(reading: Reading, waits: bool) -> ControllerAnswer:
        asked.append(reading.time)
        return command(reading, waits)

    monkeypatch.setattr(rig.controller, "command", noted)
    for shift in (0.0, jump, 2.0 * jump):
        rig.bus.inject(shifted(shift))
        rig.cycles(0.1)
    assert rig.safety.mode is Mode.RUNNING and rig.safety.counts[Fault.CLOCK_JUMPED] == 10
    apart = np.diff(asked)
    assert apart.min() > 0.5 * DT and apart.max() < 0.02
    assert asked[-1] == pytest.approx(rig.time - DT, abs=1e-6)


@pytest.mark.parametrize("name", CONTROLLER_FAULTS)
def test_a_fault_of_the_controller_is_answered_by_going_down(name: str, rig: Rig) -> None:
    if name == "hangs":
        rig.loop._worker = HungWorker()  # type: ignore[assignment]
    rig.controller.wrong = name
    seen = set()
    for _ in range(250):
        command = rig.cycle()
        assert not rig.excess(command)
        seen.add(rig.safety.mode)
    assert not after(name, CONTROLLER_FAULTS[name], rig)
    assert Mode.SOFT_STOP in seen or name == "huge"


def test_late_cycles_are_answered_by_going_down(rig: Rig) -> None:
    for _ in range(40):
        rig.cycle(late=0.005, missed=2)
    assert rig.safety.counts[Fault.LATE_CYCLE] == 40
    assert any(event.mode is Mode.SOFT_STOP for event in rig.safety.events)


def test_one_late_cycle_is_only_noted(rig: Rig) -> None:
    rig.cycle(late=0.006, missed=3)
    rig.cycles(0.2)
    assert rig.safety.mode is Mode.RUNNING and rig.safety.counts[Fault.LATE_CYCLE] == 1


def test_a_process_that_was_stopped_commands_nothing_old(rig: Rig) -> None:
    assert np.abs(rig.bus.command.torque).max() > 0.0
    command = rig.cycle(late=0.3, missed=150)
    assert rig.safety.mode is Mode.STOP and command.is_passive


def test_a_robot_that_is_gone_ends_the_loop_within_50_ms_and_is_logged(tmp_path: Path) -> None:
    rig = Rig(log=tmp_path / "log.npz")
    rig.start()
    rig.bus.inject(READING_FAULTS["messages lost for good"][0])
    began = rig.time
    while not rig.loop._state.ended:
        rig.cycle()
    assert rig.time - began <= 0.050
    rig.loop._shut_down()
    result = rig.loop.result()
    assert "gone" in result.reason and not result.good
    with np.load(result.logs[0]) as log:
        assert log["time"][0] <= DT and len(log["position"]) == len(log["time"]) > 125
        assert any("no usable reading" in line for line in log["events"])


def test_cycles_leave_no_garbage_for_the_collector_does_not_run(rig: Rig) -> None:
    """A handle of the C library made in each cycle took 1.4 MB a second of locked memory."""
    clock = CycleClock(1e-5)
    rig.cycles(0.2)
    gc.collect()
    gc.disable()
    try:
        rig.cycles(0.5)
        for _ in range(100):
            clock.wait()
        assert gc.collect() == 0
    finally:
        gc.enable()


def test_a_robot_that_is_not_there_is_missed_in_words() -> None:
    rig = Rig()
    said = heard(rig)
    rig.bus.inject(READING_FAULTS["messages lost for good"][0])
    rig.cycles(3.0)
    assert rig.safety.mode is Mode.IDLE and not rig.loop._state.ended
    (missed,) = (line for line in said if "heard" in line)
    assert missed == "nothing heard for 2 s: is the robot on, and on this bus?"
    rig.bus.inject(None)
    rig.cycles(0.1)
    assert said[-1] == "the robot is heard"


def test_a_robot_that_was_long_away_stands_up_when_it_is_asked_to() -> None:
    """Silence was borne without an end: after a minute of it nobody stood up for two."""
    rig = Rig()
    rig.bus.inject(READING_FAULTS["messages lost for good"][0])
    rig.cycles(5.0)
    rig.bus.inject(None)
    rig.cycles(0.1)
    ask(rig, 0.01, Wish.ARM, Wish.STAND)
    assert rig.safety.mode is Mode.STANDING_UP


def test_run_on_the_way_up_begins_when_the_robot_is_up() -> None:
    rig = Rig()
    said = heard(rig)
    ask(rig, 0.05, Wish.ARM, Wish.STAND, Wish.RUN, Wish.RUN)
    assert rig.safety.mode is Mode.STANDING_UP and said.count("run: as soon as it is up") == 1
    rig.cycles(0.1)
    assert rig.safety.mode is Mode.RUNNING


def test_a_robot_that_is_up_balances_until_it_is_asked_to_run() -> None:
    """It leant by 0.25 rad after three seconds, and fell when it was then asked to run."""
    rig = Rig()
    said = heard(rig)
    ask(rig, 3.0, Wish.ARM, Wish.STAND)
    assert rig.safety.mode is Mode.RUNNING and rig.controller.waits
    assert said[-1] == "it balances where the problem begins: run begins it, sit goes down"
    ask(rig, 0.1, Wish.RUN)
    assert rig.safety.mode is Mode.RUNNING and not rig.controller.waits
    assert PROBLEM_BEGINS in told(rig)
    ask(rig, 0.1, Wish.RUN)  # once more: refused
    assert said[-1].startswith("run: the problem has begun already")
    ask(rig, 0.5, Wish.SIT)
    assert rig.safety.mode is Mode.DAMPING and rig.loop.result().good


@pytest.mark.parametrize(
    ("hangs", "why"),
    [(False, "no estimate: not yet"), (True, "it hangs: its feet bear 3 % of the weight")],
)
def test_a_robot_that_cannot_balance_goes_down_again(hangs: bool, why: str) -> None:
    """In a gantry the controller would stretch the legs at once."""
    rig = Rig()

    def observe(reading: Reading) -> ControllerAnswer:
        if not hangs:
            raise EstimateError("not yet")
        return ControllerAnswer(None, *rig.controller.state, load=0.03)

    rig.controller.observe = observe  # type: ignore[method-assign]
    ask(rig, 1.4, Wish.ARM, Wish.STAND)
    ask(rig, 0.1, Wish.RUN)
    assert rig.safety.mode is Mode.STANDING_UP
    rig.cycles(0.5)
    result = rig.loop.result()
    assert rig.safety.mode is Mode.DAMPING and result.good is result.hung is hangs
    assert why in told(rig)


def test_a_robot_that_is_hoisted_while_it_balances_goes_down() -> None:
    rig = Rig()
    ask(rig, 1.0, Wish.ARM, Wish.STAND)
    assert rig.safety.mode is Mode.RUNNING and rig.controller.waits
    rig.controller.load = 0.2
    rig.cycles(0.08)
    assert rig.safety.mode is Mode.RUNNING
    rig.cycles(0.1)
    assert rig.safety.mode is Mode.SOFT_STOP
    assert "it hangs: its feet bear 20 % of the weight" in told(rig)


def test_an_answer_to_a_request_of_the_mode_before_is_dropped(rig: Rig) -> None:
    """It counted as an estimate on the way up, with the weight on the feet."""
    rig.cycle()
    late = rig.loop._worker
    rig.loop._worker = HungWorker()  # type: ignore[assignment]
    rig.cycles(0.5)
    rig.loop._worker = late
    late.submit(Job(rig.loop._state.reading, begins=False, wants_command=True, comes_to_rest=False))
    rig.loop._state.is_stale = True
    rig.loop._state.answer = None
    rig.cycle()
    assert rig.loop._state.answer is None and not rig.loop._state.is_stale


def test_after_a_late_answer_ticks_are_due_as_before(rig: Rig, monkeypatch) -> None:
    """The next one came a cycle early: that of the answer counted twice."""
    worker, asked, busy = rig.loop._worker, list[int](), iter([True] * 6)

    class Late:
        """Answers the first job after six cycles."""

        busy = False

        def submit(self, job: Job) -> None:
            asked.append(job.reading.sequence)
            self.busy = True
            worker.submit(job)

        def result(self, timeout: float) -> object:
            if not self.busy or next(busy, False):
                return None
            self.busy = False
            return worker.result(timeout)

    rig.loop._worker = Late()  # type: ignore[assignment]
    monkeypatch.setattr(rig.loop, "_cycles", 5)
    rig.cycles(0.07)
    assert np.diff(asked).tolist() == [5] * 6


def test_a_refusal_is_told_once_a_second_to_a_script_that_asks_in_each_cycle() -> None:
    rig = Rig()
    said = heard(rig)
    rig.wanted.extend([Wish.RUN] * 600)
    rig.cycles(1.2)
    assert [line.startswith("run: running is not allowed in idle") for line in said] == [True] * 2


def test_a_fault_whose_words_say_asked_is_a_fault_and_is_not_forgotten(rig: Rig) -> None:
    """The words of an error of the controller's made it a stop that somebody wanted."""
    rig.safety.report(Fault.CONTROLLER_RAISED, "asked for 3 m/s")
    rig.cycles(0.3)
    for _ in range(1200):  # more events than are kept
        rig.safety.events.append(Event(rig.time, "command clipped", Mode.RUNNING))
    assert not rig.loop.result().good


def stands_up_beside(error: WbcError) -> Rig:
    """Return a robot that was told to stand up, whose estimator raises an error."""
    rig = Rig()

    def observe(reading: Reading) -> ControllerAnswer:
        raise error

    rig.controller.observe = observe  # type: ignore[method-assign]
    ask(rig, 0.03, Wish.ARM)
    ask(rig, 0.3, Wish.STAND)
    return rig


def test_an_estimator_that_raises_ends_standing_up_in_words() -> None:
    """It stood on, and nobody was told that it would never run."""
    rig = stands_up_beside(InvalidInputError("are its units g?"))
    assert rig.safety.mode is Mode.DAMPING
    assert any("controller raised are its units g?" in what for what in told(rig))


def test_what_there_is_no_estimate_for_is_told_who_wants_to_run() -> None:
    rig, said = stands_up_beside(EstimateError("it moves")), list[str]()
    rig.loop._say = said.append
    ask(rig, DT, Wish.RUN)
    assert said == ["run: as soon as it is up; no estimate yet: it moves"]


def test_a_bus_that_does_not_open_leaves_the_log_of_the_run_before(tmp_path: Path) -> None:
    log = tmp_path / "log.npz"
    log.write_text("of the run before")
    rig = Rig()

    def watch(ring: object) -> None:
        threading.Event().wait(60.0)

    def taken() -> Bus:
        raise BusError("port 9751 is taken")

    before = set(multiprocessing.active_children())
    with pytest.raises(BusError, match="taken"):
        loop_on(rig, taken, log=log, watch=watch)
    assert set(multiprocessing.active_children()) == before
    assert log.read_text() == "of the run before"


@pytest.mark.skipif(
    not (can_fork() and hasattr(os, "sched_getaffinity")), reason="processes are not pinned here"
)
def test_only_the_loop_is_on_the_cpu_of_the_loop(tmp_path: Path) -> None:
    """What packs a log, and what draws it, ran there as well."""
    rig, allowed = Rig(), os.sched_getaffinity(0)
    before = set(multiprocessing.active_children())
    cpu = min(allowed)
    try:
        watch = {"watch": lambda ring: threading.Event().wait(60.0), "log": tmp_path / "log.npz"}
        loop = loop_on(rig, lambda: rig.bus, cpus=(cpu,), **watch)
        places = {
            one.name: os.sched_getaffinity(one.pid or 0)
            for one in set(multiprocessing.active_children()) - before
        }
        assert os.sched_getaffinity(0) == {cpu}
        loop._worker.close()
        loop._end_processes()
    finally:
        os.sched_setaffinity(0, allowed)
    assert places["log"] == places["watch"] == allowed


def test_a_second_loop_on_a_bus_is_refused_before_it_commands(monkeypatch) -> None:
    """Idle, it switched the motors off under a robot that the first one held up."""
    rig, heard, said = Rig(), [0, 0, 1], list[str]()
    monkeypatch.setattr(rig.bus, "commands_heard", lambda: heard.pop(0), raising=False)
    monkeypatch.setattr(rig.bus, "write", lambda command: said.append("a command"))
    monkeypatch.setattr(rig.bus, "close", lambda: said.append("closed"))
    with pytest.raises(BusError, match="another program commands this robot"):
        loop_on(rig, lambda: rig.bus)
    assert said == ["closed"]


@pytest.mark.skipif(not can_fork(), reason="the controller has no process of its own here")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_signals_to_all_processes_of_a_loop_leave_it_its_controller(name: str) -> None:
    """A stop of the whole group took the controller first, and a robot in the middle of a step."""
    rig = Rig()
    worker = ForkedWorker(rig.controller)  # type: ignore[arg-type]
    rig.cycles(0.01)
    reading = rig.loop._state.reading
    assert reading is not None
    try:
        for _ in range(2):
            worker.submit(Job(reading, False, False, False))
            outcome = worker.result(20.0)
            assert outcome is not None and outcome.answer is not None
            os.kill(worker.pid, getattr(signal, name))
    finally:
        worker.close()


def test_an_interrupt_ends_a_loop_that_commands_nothing() -> None:
    rig = Rig()
    rig.loop.interrupted = lambda: True
    assert rig.loop.run(most=5.0).reason == "interrupted"
    with pytest.raises(InvalidInputError, match="this loop has run"):
        rig.loop.run(most=5.0)  # it returned the first result


def test_an_interrupt_makes_a_robot_sit_down_whoever_its_operator_is(rig: Rig, monkeypatch) -> None:
    """It ran on: the loop only said so, and left it to the operator of the command line."""
    began = rig.time

    def wait() -> Beat:
        rig.bus.move(rig.time)
        rig.time += DT
        return Beat(rig.time - DT, 0.0, 0)

    clock = SimpleNamespace(due=began, wait=wait)
    monkeypatch.setattr("wbc.hardware.loop.CycleClock", lambda dt: clock)
    rig.loop.interrupted = lambda: rig.time > began + 0.1
    assert rig.loop.run(most=3.0).reason == "interrupted"
    assert [one.mode for one in rig.safety.events][-3:] == [Mode.SOFT_STOP, Mode.DAMPING, Mode.STOP]


def test_commands_that_cannot_be_sent_stop_it(rig: Rig) -> None:
    rig.bus.refuses = True
    rig.cycles(0.1)
    assert rig.safety.mode is Mode.STOP and rig.safety.counts[Fault.BUS_FAILED]


@pytest.mark.parametrize("error", [OSError(5, "Input/output error"), BusError("unplugged")])
def test_a_bus_that_fails_stops_it_in_words(error: Exception, rig: Rig, monkeypatch) -> None:
    """Errors of a bus of one's own ended the loop without its log, its controller left behind."""

    def fail(*_: object) -> None:
        raise error

    monkeypatch.setattr(rig.bus, "read", fail)
    rig.cycles(0.05)
    assert rig.safety.mode is Mode.STOP and rig.bus.command.is_passive
    assert any(str(error) in event.what for event in rig.safety.events)
    monkeypatch.setattr(rig.bus, "write", fail)
    rig.loop._shut_down()
    assert rig.safety.counts[Fault.BUS_FAILED] == 0 and "gone" in rig.loop.result().reason


@pytest.mark.parametrize(("part", "name"), [("_operator", "wish"), ("bus", "write")])
def test_an_error_of_an_operator_or_a_bus_leaves_a_log_and_no_controller(
    part: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bus's came once more from the last commands, before log and controller were closed."""
    rig, closed = Rig(log=str(tmp_path / "log.npz")), list[str]()  # type: ignore[arg-type]
    rig.start()
    monkeypatch.setattr(getattr(rig.loop, part), name, lambda given: 1 / 0)
    monkeypatch.setattr(rig.loop._worker, "close", lambda: closed.append("closed") or ())
    with pytest.raises(ZeroDivisionError):
        rig.loop.run(most=1.0)
    result = rig.loop.result()
    assert "ZeroDivisionError: division by zero" in result.reason and result.logs and closed
    assert rig.safety.mode is Mode.STOP and (part == "bus" or rig.bus.command.is_passive)


def test_words_are_wishes_and_others_are_refused(rig: Rig) -> None:
    """Any text that is no Wish was taken for quit: "stop" did not stop."""
    rig.wanted += ["dance", "stop"]  # type: ignore[list-item]
    rig.cycle()
    assert rig.safety.mode is Mode.RUNNING and "'dance'" in rig.safety.events[-1].what
    rig.cycle()
    assert rig.safety.mode is Mode.STOP and not rig.loop._state.ended


def test_readings_may_be_lists_and_their_numbers_of_any_kind_of_integer(rig: Rig) -> None:
    """As drivers make them; differences of unsigned numbers wrapped around, and nothing was old."""
    names = ("position", "velocity", "torque", "temperature")
    names += ("quaternion", "angular_velocity", "specific_force")

    def listed(r: Reading, since: int, memory: object) -> list[Reading]:
        lists = {name: getattr(r, name).tolist() for name in names}
        number = np.uint32(max(r.sequence - since % 2, 0))
        return [replace(r, sequence=number, **lists)]  # type: ignore[arg-type]

    rig.bus.inject(listed)
    rig.cycles(0.1)
    assert rig.safety.mode is Mode.RUNNING and rig.safety.counts[Fault.OUT_OF_ORDER] == 25


@pytest.mark.parametrize("name", ["time", "sequence", "quaternion"])
def test_a_reading_whose_field_is_no_number_is_told_by_its_name(name: str, rig: Rig) -> None:
    """Without a time, or a number of its own, it ended the loop in a TypeError."""
    wrong: dict[str, Any] = {name: np.full(4, np.nan) if name == "quaternion" else None}
    for shift in (0.0, 1.0):  # then the robot's clock has jumped
        rig.bus.inject(shifted(shift))
        rig.cycles(0.1)
    rig.bus.inject(lambda r, since, memory: [replace(r, **wrong)])
    rig.cycles(0.1)
    assert rig.safety.mode is Mode.STOP and any(f"NaN: {name}" in what for what in told(rig))


def test_a_full_disk_loses_the_log_with_a_word_and_nothing_else(tmp_path, monkeypatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("wbc.hardware.ring_log.write_arrays", full)
    rig = Rig(log=tmp_path / "log.npz")
    rig.start()
    rig.bus.inject(READING_FAULTS["stop button"][0])
    rig.cycles(1.2)
    assert rig.safety.mode is Mode.STOP and rig.bus.command.is_passive
    result = rig.loop.result()
    assert not result.logs
    assert any("No space left" in note and "lost" in note for note in result.notes)


def test_wishes_that_are_not_allowed_change_nothing(rig: Rig) -> None:
    for wish in (Wish.ARM, Wish.STAND, Wish.RUN, Wish.RESET, Wish.QUIT):
        ask(rig, DT, wish)
        assert rig.safety.mode is Mode.RUNNING, wish
    assert sum("not allowed" in event.what for event in rig.safety.events) == 3
    assert "run: the problem has begun already" in told(rig)


def test_sitting_down_ends_in_damping_and_stands_up_again(rig: Rig) -> None:
    ask(rig, 0.3, Wish.SIT)
    assert rig.safety.mode is Mode.DAMPING and rig.bus.command.is_passive
    ask(rig, 0.2, Wish.STAND)
    ask(rig, DT, Wish.RUN)
    assert rig.safety.mode is Mode.RUNNING


def test_after_a_stop_only_a_reset_by_hand_leads_on(rig: Rig) -> None:
    ask(rig, 0.1, Wish.STOP)
    for wish in (Wish.ARM, Wish.STAND, Wish.RUN, Wish.SIT):
        ask(rig, DT, wish)
        assert rig.safety.mode is Mode.STOP
    rig.wanted.append(Wish.RESET)
    assert not rig.cycle().enabled
    assert rig.safety.mode is Mode.IDLE


def test_nobody_stands_up_while_a_fault_is_there() -> None:
    rig = Rig()
    ask(rig, 0.1, Wish.ARM)
    rig.bus.inject(READING_FAULTS["motor warm"][0])
    rig.cycles(0.01)
    ask(rig, DT, Wish.STAND)
    assert rig.safety.mode is Mode.DAMPING
    assert any("cannot stand up: motor warm" in what for what in told(rig))


@pytest.mark.slow
def test_no_command_is_outside_the_limits_whatever_goes_wrong() -> None:
    found = soak(10_000, seed=3)
    assert found["outside limits"] == {}
    assert set(found["modes"]) == {str(mode) for mode in Mode}
    assert len(found["faults found"]) >= 15  # of 29; a million cycles find 25


def test_the_page_has_the_tables_of_the_code() -> None:
    page = (Path(__file__).parents[2] / "docs" / "howto" / "hardware.md").read_text()
    for fault, rule in RULES.items():
        answer = rule.answer.name.lower().replace("_", " ")
        assert f"| {fault} | {1e3 * rule.patience:.0f} | {answer} |" in page, fault
    for mode in Mode:
        line = next(line for line in page.splitlines() if line.startswith(f"| {mode} |"))
        assert all(str(one) in line.split("|")[3] for one in TRANSITIONS[mode]), mode


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ("run nothing.yaml --log x.txt", "--log x.txt: expected a name ending in .npz"),
        ("run nothing.yaml --log nowhere/x.npz", "--log nowhere/x.npz: there is no folder nowhere"),
        ("run nothing.yaml --report x", "--report x: expected a name ending in .json"),
        ("run problems/rmp_spin.yaml --log {log}", "a pendulum's problem runs on no robot"),
        *(
            (f"run problems/walk_g1.yaml --interface eth0 --log {{log}} {asked}", told)
            for asked, told in (
                ("--slower 2", "--slower: a robot on 'eth0' would not be slower"),
                ("--unattended 5", "--unattended: nobody would stop a robot on 'eth0'"),
            )
        ),
        *(
            (f"sim g1 --bus udp --domain {{domain}} --duration 0.01 {asked}", told)
            for asked, told in (
                ("--push nan,1,1,1", "push, at: must be finite, got nan"),
                ("--push 1,1,inf,1", "push, force: NaN or infinite"),
                ("--push 1,1,1,0", "push, duration: must be greater than 0, got 0"),
                ("--interface eth99", "expected an address as 192.168.1.2, got 'eth99'"),
                ("--report nowhere/x.json", "--report nowhere/x.json: there is no folder"),
            )
        ),
    ],
)
def test_what_cannot_be_done_is_refused_before_it_matters(asked: str, told: str, tmp_path) -> None:
    domain = 100 + os.getpid() % 10_000  # of ports of this process
    words = asked.format(log=tmp_path / "log.npz", domain=domain).split()
    answer = wbc_command("hardware", *words)
    assert answer.exit_code == 1 and told in answer.stderr


def test_a_cpu_that_is_not_there_is_named_before_anything_is_forked() -> None:
    with pytest.raises(InvalidInputError, match="CPU 4711: this process may run on"):
        check_cpus((4711,))


def test_words_are_read_from_a_terminal_and_an_empty_line_stops(monkeypatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("arm\nStand \nfly\n\n"))
    said: list[str] = []
    keyboard, status, wishes = Keyboard(said.append), SimpleNamespace(), []
    while not wishes or wishes[-1] is not Wish.SIT:  # the terminal is gone in the end
        wish = keyboard.wish(status)  # type: ignore[arg-type]
        if wish is not None:
            wishes.append(wish)
    assert wishes == [Wish.ARM, Wish.STAND, Wish.STOP, Wish.SIT]
    assert said and said[0].startswith("not understood: fly; one of: arm")
    keyboard.ask(Wish.QUIT)
    assert keyboard.wish(status) is Wish.QUIT and keyboard.wish(status) is None  # type: ignore[arg-type]


def test_bytes_that_are_no_text_leave_the_keyboard_listening(monkeypatch) -> None:
    typed = io.TextIOWrapper(io.BytesIO(b"arm\n\xff\xfe\n\nsit\n"), encoding="utf-8")
    monkeypatch.setattr("sys.stdin", typed)
    said: list[str] = []
    keyboard = Keyboard(said.append)
    wishes = [keyboard._wishes.get(timeout=10.0) for _ in range(3)]
    assert wishes == [Wish.ARM, Wish.STOP, Wish.SIT]
    assert said[0].startswith("not understood: ")


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="there are no such terminals here")
def test_a_terminal_that_is_closed_makes_the_robot_sit_down(monkeypatch) -> None:
    """Without SIGHUP, as of a program that opened it: reading failed, and nobody was told."""
    terminal, descriptor = os.openpty()
    with open(descriptor, encoding="utf-8") as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        keyboard = Keyboard(print)
        os.write(terminal, b"arm\n")
        assert keyboard._wishes.get(timeout=10.0) is Wish.ARM
        os.close(terminal)
        assert keyboard._wishes.get(timeout=10.0) is Wish.SIT


def test_processes_forked_while_the_keyboard_waits_begin() -> None:
    """At a terminal controller and log never began: no estimate, and no end after ``quit``."""
    answer = """
        import multiprocessing, os, time
        from wbc.hardware.operator import Keyboard
        Keyboard(print)
        time.sleep(0.2)  # it waits for a line
        context = multiprocessing.get_context("fork")
        ours, theirs = context.Pipe()
        process = context.Process(target=theirs.send, args=("begun",))
        process.start()
        print(ours.recv() if ours.poll(10.0) else "waits for ever", flush=True)
        process.kill()
        os._exit(0)
    """
    command = [sys.executable, "-c", textwrap.dedent(answer)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as run:
        assert run.stdout is not None and run.stdout.read() == b"begun\n"


def test_a_script_arms_stands_runs_sits_and_ends() -> None:
    script, wishes = Script(seconds=2.0, settle=0.5), []
    course = (
        (Mode.IDLE, 0.1, False), (Mode.DAMPING, 0.1, False), (Mode.DAMPING, 0.6, False),
        (Mode.STANDING_UP, 1.0, False), (Mode.STANDING_UP, 2.0, True), (Mode.RUNNING, 1.0, True),
        (Mode.RUNNING, 2.1, True), (Mode.DAMPING, 0.6, False), (Mode.STOP, 0.6, False),
    )  # fmt: skip
    for mode, passed, up in course:
        status = SimpleNamespace(mode=mode, mode_time=passed, is_up=up, hears=True)
        wishes.append(script.wish(status))  # type: ignore[arg-type]
    arm, stand, run, sit, quit_ = Wish.ARM, Wish.STAND, Wish.RUN, Wish.SIT, Wish.QUIT
    assert wishes == [arm, None, stand, None, run, None, sit, quit_, quit_]
    script = Script(seconds=2.0, settle=0.5)
    for mode in (Mode.IDLE, Mode.STANDING_UP, Mode.SOFT_STOP):  # stopped on its way up
        status = SimpleNamespace(mode=mode, mode_time=0.6, is_up=False, hears=True)
        script.wish(status)  # type: ignore[arg-type]
    status.mode = Mode.DAMPING
    assert script.wish(status) is Wish.QUIT  # type: ignore[arg-type]
    script.ask(Wish.STOP)
    assert script.wish(status) is Wish.STOP  # type: ignore[arg-type]


def test_a_reader_of_what_is_said_that_is_gone_ends_no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """As ``wbc hardware run ... | head``: the robot braked, and fell."""

    def broken(text: str) -> None:
        raise BrokenPipeError

    monkeypatch.setattr("typer.echo", broken)
    _print("damping: armed by hand")


def test_a_log_that_will_be_replaced_is_told(tmp_path: Path) -> None:
    """That of a fall was overwritten by the next run's, in silence."""
    log, problem = tmp_path / "log.npz", tmp_path / "no.yaml"
    for exists in (False, True):
        told = wbc_command("hardware", "run", problem, "--log", log)
        assert told.exit_code == 1 and ("replaces it" in told.output) == exists
        log.touch()


def test_a_terminal_that_is_stopped_stops_no_cycle(monkeypatch: pytest.MonkeyPatch) -> None:
    """As by Ctrl-S: printing waited, and the robot braked after 20 ms."""
    goes_on, printed = threading.Event(), list[str]()

    def stopped(text: str) -> None:
        goes_on.wait(10.0)
        printed.append(text)

    monkeypatch.setattr("typer.echo", stopped)
    with ThreadPoolExecutor(1) as voice:
        say = _printer(voice)
        say("damping: armed by hand")
        say("standing up: asked to stand up")
        assert not printed  # nobody waited
        goes_on.set()
    assert printed == ["damping: armed by hand", "standing up: asked to stand up"]
    say("nothing more can be typed")  # as the command ends: a traceback of the keyboard's thread
