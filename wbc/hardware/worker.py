"""The controller in a process of its own: a tick that is slow or hangs does not stop the cycles.

A thread would hold the interpreter's lock for 2 ms in ticks with contact changes, as long as a
cycle.
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
from wbc.hardware.real_time import ignore_signals, pin, real_time
from wbc.hardware.robot_controller import ControllerAnswer, EstimateError, RobotController

EXIT_TIMEOUT = 0.5  # s for a process to end by itself


class Job(NamedTuple):
    """A request to the controller."""

    reading: Reading  # the newest one
    begins: bool  # whether the controller begins with it, or, without a command, the estimator
    wants_command: bool  # whether a command is requested, not only an estimate
    comes_to_rest: bool  # whether the robot should come to rest
    waits: bool = False  # whether it balances where the problem begins, which does not begin yet


class WorkerOutcome(NamedTuple):
    """The outcome of a job: an answer, or an error in words."""

    answer: ControllerAnswer | None
    error: str = ""
    no_estimate: bool = False


class Worker:
    """Runs one job at a time, in the calling process: for tests, and systems without fork."""

    def __init__(self, controller: RobotController) -> None:
        self._controller = controller
        self._outcome: WorkerOutcome | None = None

    @property
    def busy(self) -> bool:
        """Whether there is an outcome that was not fetched."""
        return self._outcome is not None

    def submit(self, job: Job) -> None:
        """Begin a job; it must not be busy."""
        self._outcome = run_job(self._controller, job)

    def result(self, timeout: float) -> WorkerOutcome | None:
        """Return the outcome of the job, waiting for at most ``timeout`` [s]; None if not done."""
        outcome, self._outcome = self._outcome, None
        return outcome

    def close(self) -> Sequence[str]:
        """End; return the supervisor's notes."""
        return self._controller.notes


class ForkedWorker:
    """Runs one job at a time in a process that is forked now: open buses afterwards.

    ``controller``: changes to it here have no effect there.
    ``priority``: of ``SCHED_FIFO``; 0: none.
    ``cpu``: on which it runs; None: any.
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
        """Begin a job; it must not be busy. If the process is gone, the outcome says so."""
        self.busy = True
        with contextlib.suppress(OSError):
            self._pipe.send(job)

    def result(self, timeout: float) -> WorkerOutcome | None:
        """Return the outcome of the job, waiting for at most ``timeout`` [s]; None if not done."""
        # poll has a resolution of 1 ms, which would delay the next cycle.
        if not self.busy or not select.select([self._pipe], [], [], max(timeout, 0.0))[0]:
            return None
        self.busy = False
        try:
            outcome = self._pipe.recv()
        except (EOFError, OSError):
            return WorkerOutcome(None, "the controller's process is gone")
        return outcome if isinstance(outcome, WorkerOutcome) else WorkerOutcome(None, "no answer")

    def close(self) -> Sequence[str]:
        """End the process, by force if it hangs; return the supervisor's notes."""
        notes: Sequence[str] = ()
        try:
            self.result(EXIT_TIMEOUT)
            if not self.busy:
                self._pipe.send(None)
                if self._pipe.poll(EXIT_TIMEOUT):
                    notes = self._pipe.recv()
        except (EOFError, OSError):
            notes = ("the controller's process was gone before the end",)
        self._process.join(EXIT_TIMEOUT)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
            notes = (*notes, "the controller's process hung, and was killed")
        self._pipe.close()
        return notes


def can_fork() -> bool:
    """Return whether the controller can have a process of its own."""
    return "fork" in multiprocessing.get_all_start_methods()


def run_job(controller: RobotController, job: Job) -> WorkerOutcome:
    """Run a job, and return its outcome."""
    try:
        if job.begins:
            if job.wants_command:
                controller.begin(job.reading)
            else:
                controller.stand()
        if job.comes_to_rest:
            controller.come_to_rest()
        if not job.wants_command:
            return WorkerOutcome(controller.observe(job.reading))
        return WorkerOutcome(controller.command(job.reading, job.waits))
    except EstimateError as error:
        return WorkerOutcome(None, str(error), no_estimate=True)
    except WbcError as error:
        return WorkerOutcome(None, str(error))
    except Exception as error:  # any error must bring the robot down, not the process
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
    ignore_signals()
    with real_time(priority):
        while True:
            try:
                job = pipe.recv()
            except (EOFError, OSError):  # the loop is gone
                return
            if job is None:
                pipe.send(tuple(controller.notes))
                return
            pipe.send(run_job(controller, job))
