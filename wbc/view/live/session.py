"""An interactive run of a problem in the browser: paced, paused, steered, restarted."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from wbc.controllers import Controller
from wbc.controllers.closed_loop import LoopTick, Update, closed_loop
from wbc.errors import InvalidInputError
from wbc.robot import Snapshot
from wbc.run.supervisor import Supervisor
from wbc.validate import Array
from wbc.view.live.clock import Clock
from wbc.view.live.messages import PullForce, Request
from wbc.view.live.viewer import Viewer

if TYPE_CHECKING:
    from wbc.problem.problem import Problem

ENDLESS = 10**9  # ticks
WAITING = "the run has ended; Restart begins it again"


class Session:
    """Runs a problem in a closed loop and shows it, until the page ends or the user interrupts.

    The loop goes on when the problem's time is over: its controller holds what it has reached and
    follows what the user drags.

    ``problem``: see :func:`checked`.

    ``ticks``: how many there were.
    """

    def __init__(self, problem: Problem, viewer: Viewer, clock: Clock | None = None) -> None:
        self._problem, self._viewer = problem, viewer
        self.clock = clock or Clock()
        self.ticks = 0
        self._phase = ""

    def run(self, ticks: int | None = None) -> None:
        """Run until the page ends, or for so many ticks."""
        last = ENDLESS if ticks is None else self.ticks + ticks
        while self.ticks < last and not self._viewer.closed:
            now, remark = self._run_once(last)
            if self.ticks < last and not self.clock.restart:
                self._wait_for_restart(now, remark)
            self.clock.restart = False

    def _run_once(self, last: int) -> tuple[LoopTick | None, str]:
        """Run from the start until the loop ends, and return its last tick and why it ended."""
        viewer, phases = self._viewer, self._supervisor()

        def update(tick: int, snapshot: Snapshot) -> Controller | None:
            controller = phases.update(tick, snapshot)
            if controller is not None:
                viewer.controller = controller
                viewer.steer()
            return controller

        now: LoopTick | None = None
        for now in self._loop(phases, update):
            self.ticks += 1
            self._phase = phases.standing.phase
            self._show(now)
            if self.ticks >= last or not self._wait(now):
                return now, ""
        complaint = phases.complaint or self._why_ended(now)
        return now, f"{complaint}; {WAITING}"

    def _supervisor(self) -> Supervisor:
        """Return the supervisor of the phases, from the start."""
        return self._problem.executor()

    def _loop(self, phases: Supervisor, update: Update) -> Iterator[LoopTick]:
        """Return the ticks of the loop, without end unless the robot cannot go on."""
        return closed_loop(phases.controller, self._problem.parts.start, ENDLESS, update)

    def _why_ended(self, now: LoopTick | None) -> str:
        return "" if now is None else now.tick.report()

    def _push_now(self) -> Array | None:
        """Return the present push force (3,) [N]; None if the robot cannot be pushed."""
        return None

    def _pull_now(self) -> PullForce | None:
        """Return the user's present pull; None if there is none."""
        return None

    def _show(self, now: LoopTick, remark: str = "") -> None:
        self._viewer.update(
            now.snapshot,
            now.tick,
            now.time,
            seconds=now.seconds,
            phase=self._phase,
            remark=remark,
            playing=self.clock.playing,
            push=self._push_now(),
            pull=self._pull_now(),
        )

    def _wait(self, now: LoopTick) -> bool:
        """Wait until the next tick is due; False if the run ends."""
        viewer, clock = self._viewer, self.clock
        while not viewer.closed:
            changed = self._take_requests()
            left = clock.remaining(self._problem.spec.controller.dt)
            if not left:
                return not clock.restart
            if changed:  # so that the page shows targets and buttons as they are now
                self._show(now)
            viewer.wait_for_user(left)
        return False

    def _wait_for_restart(self, now: LoopTick | None, remark: str) -> None:
        while not self._viewer.closed:
            self._take_requests()
            if self.clock.restart:
                return
            if now is not None:
                self._show(now, remark)
            self._viewer.wait_for_user()

    def _take_requests(self) -> bool:
        """Apply the user's requests; True if there were any."""
        found = self._viewer.has_wishes
        while (request := self._viewer.next_request()) is not None:
            self._receive(request)
            found = True
        return found

    def _receive(self, request: Request) -> None:
        self.clock.receive(request)


def checked(problem: object) -> Problem:
    """Return a problem that has a controller to show while it runs or is simulated.

    Raises InvalidInputError: a pendulum's problem, or a search for a posture.
    """
    from wbc.problem.controller_spec import GlobalSpec
    from wbc.problem.problem import Problem

    if not isinstance(problem, Problem):
        raise InvalidInputError(
            "the viewer shows robots, and this is a pendulum's problem; draw it with:"
            " wbc run --plot"
        )
    if isinstance(problem.spec.controller, GlobalSpec):
        raise InvalidInputError(
            "method global searches first and moves then: there is no controller to steer; watch"
            " the motion with: wbc run --view"
        )
    return problem
