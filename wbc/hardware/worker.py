"""The controller in a process of its own: a tick that takes too long, or hangs, stops no cycle.

A thread would share the interpreter's lock with the cycle, and hold it for 2 ms in the ticks in
which contacts change: for as long as a cycle.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import select
from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import NamedTuple

from wbc.errors import WbcError
from wbc.hardware.bus import Reading
from wbc.hardware.real_time import leave_signals_to_the_loop, pin, real_time
from wbc.hardware.robot_controller import ControllerAnswer, EstimateError, RobotController

WAIT = 0.5  # s that a process gets to end by itself


class Job(NamedTuple):
    """What is asked of the controller about a reading.

    Attributes
    ----------
    reading:
        The newest one.
    begins:
        Whether it begins to run with it, or, without a command, to stand still.
    commands:
        Whether a command is wanted, not only an estimate.
    rests:
        Whether it should come to rest.
    """

    reading: Reading
    begins: bool
    commands: bool
    rests: bool


class WorkerOutcome(NamedTuple):
    """What came of a job: an answer, or the error instead, in words."""

    answer: ControllerAnswer | None
    error: str = ""
    no_estimate: bool = False


class Worker:
    """Does one job at a time, in the process that calls it: for tests, and systems without fork."""

    def __init__(self, controller: RobotController) -> None:
        self._controller = controller
        self._outcome: WorkerOutcome | None = None

    @property
    def busy(self) -> bool:
        """Whether a job's outcome was not fetched yet."""
        return self._outcome is not None

    def submit(self, job: Job) -> None:
        """Begin a job; it must not be busy."""
        self._outcome = done(self._controller, job)

    def result(self, timeout: float) -> WorkerOutcome | None:
        """Return what came of the job, waiting at most so long [s]; None if it is not done."""
        found, self._outcome = self._outcome, None
        return found

    def close(self) -> Sequence[str]:
        """End; return what the supervisor has to say."""
        return self._controller.notes


class ForkedWorker:
    """Does one job at a time in a process that is forked now: open buses afterwards.

    Parameters
    ----------
    controller:
        What is done with it here has no effect there.
    priority:
        Of ``SCHED_FIFO``; 0: none is asked for.
    cpu:
        On which it runs; None: on any.
    """

    def __init__(
        self, controller: RobotController, priority: int = 0, cpu: int | None = None
    ) -> None:
        context = multiprocessing.get_context("fork")
        self._pipe, other = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(controller, other, self._pipe, priority, cpu), name="controller"
        )
        self._process.daemon = True
        self._process.start()
        other.close()
        self.busy = False

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid or 0

    def submit(self, job: Job) -> None:
        """Begin a job; it must not be busy. A process that is gone is told of by its outcome."""
        self.busy = True
        with contextlib.suppress(OSError):
            self._pipe.send(job)

    def result(self, timeout: float) -> WorkerOutcome | None:
        """Return what came of the job, waiting at most so long [s]; None if it is not done."""
        # poll would wait for whole milliseconds: until after the next cycle's time.
        if not self.busy or not select.select([self._pipe], [], [], max(timeout, 0.0))[0]:
            return None
        self.busy = False
        try:
            found = self._pipe.recv()
        except (EOFError, OSError):
            return WorkerOutcome(None, "the controller's process is gone")
        return found if isinstance(found, WorkerOutcome) else WorkerOutcome(None, "no answer")

    def close(self) -> Sequence[str]:
        """End the process, by force if it hangs; return what the supervisor has to say."""
        notes: Sequence[str] = ()
        try:
            while self.result(WAIT) is not None:
                pass
            if not self.busy:
                self._pipe.send(None)
                if self._pipe.poll(WAIT):
                    notes = self._pipe.recv()
        except (EOFError, OSError):
            notes = ("the controller's process was gone before the end",)
        self._process.join(WAIT)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
            notes = (*notes, "the controller's process hung, and was killed")
        self._pipe.close()
        return notes


def can_fork() -> bool:
    """Return whether there is a process of its own for the controller."""
    return "fork" in multiprocessing.get_all_start_methods()


def done(controller: RobotController, job: Job) -> WorkerOutcome:
    """Return what comes of a job."""
    try:
        if job.begins:
            if job.commands:
                controller.begin(job.reading)
            else:
                controller.stand()
        if job.rests:
            controller.come_to_rest()
        ask = controller.command if job.commands else controller.observe
        return WorkerOutcome(ask(job.reading))
    except EstimateError as error:
        return WorkerOutcome(None, str(error), no_estimate=True)
    except WbcError as error:
        return WorkerOutcome(None, str(error))
    except Exception as error:  # whatever it is, the robot must come down
        return WorkerOutcome(None, f"{type(error).__name__}: {error}")


def _serve(
    controller: RobotController,
    pipe: Connection,
    others: Connection,
    priority: int,
    cpu: int | None,
) -> None:
    others.close()
    pin(cpu)
    leave_signals_to_the_loop()
    with real_time(priority):
        while True:
            try:
                job = pipe.recv()
            except (EOFError, OSError):  # the loop is gone
                return
            if job is None:
                pipe.send(tuple(controller.notes))
                return
            pipe.send(done(controller, job))
