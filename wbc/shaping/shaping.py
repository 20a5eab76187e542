"""Global inertia shaping: the same tasks as the QP's, minimised over all postures.

The QP descends from the current posture to the nearest local minimum. Here IPOPT minimises the same
cost from many starts; then the QP controller runs to the best posture that it can reach, so that
the result is a motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from time import perf_counter, time

from numpy.typing import ArrayLike

from wbc.constraints import Constraint, Contact, Limits
from wbc.controllers.kinematic import KinematicController
from wbc.kinds import whole_number
from wbc.robot import Robot
from wbc.shaping.motion import AT_REST, MakeController, PostureReach, Watch
from wbc.shaping.multi_start import MultiStart, Progress
from wbc.shaping.nlp import build_nlp
from wbc.shaping.outcome import ShapingMotion, ShapingOutcome, ShapingStatistics, Stopped
from wbc.shaping.problem import DT, ShapingProblem, check_parts
from wbc.shaping.search_all import search_all
from wbc.tasks import Task
from wbc.validate import LARGEST, finite_number


class GlobalShaping:
    """Search for the globally best posture, and move there.

    Parameters
    ----------
    robot, tasks, contacts:
        As for :class:`~wbc.controllers.kinematic.KinematicController`. Tasks are read when
        :meth:`solve` is called; momentum tasks and several priorities are refused.
    limits:
        Joint limits, by default ``Limits(robot)``.
    constraints:
        Constraints on the posture and on the motion to it: those of a
        :class:`~wbc.controllers.kinematic.KinematicController`, here all hard. Distances between
        bodies are those of their actual shapes: capsules, boxes and hulls, exactly (see
        :mod:`.separation`). Obstacles are taken at their positions when :meth:`solve` is called;
        moving ones are refused.
    dt:
        Time step of the controller that moves there [s], in which a ``gain_per_second`` is a gain.

    Raises
    ------
    InvalidInputError
        Parts that do not match, or a task or constraint that does not depend on the posture alone.
    """

    def __init__(
        self,
        robot: Robot,
        tasks: Sequence[Task],
        contacts: Sequence[Contact] = (),
        limits: Limits | None = None,
        constraints: Sequence[Constraint] = (),
        dt: float = DT,
    ) -> None:
        dt = finite_number("global shaping, dt", dt, above=0.0)
        limits = Limits(robot) if limits is None else limits
        known = check_parts(robot, tasks, contacts, limits, constraints)
        self.problem = ShapingProblem(robot, tuple(tasks), tuple(contacts), limits, known, dt)
        build_nlp(self.problem)  # a task that cannot be used is an error now, not after an hour

    def solve(
        self,
        q_start: ArrayLike,
        starts: int = 64,
        seconds: float | None = None,
        workers: int = 2,
        seed: int = 0,
        progress: Progress | None = None,
        patience: int | None = None,
    ) -> ShapingOutcome:
        """Search from the current posture, from others spread over the feasible ones, and by hops.

        The first two dozen starts are spread evenly over the feasible postures; later ones are
        derived from the best postures found so far (:mod:`.basin_hopping`).

        The answer depends on ``starts``, ``patience`` and ``seed``, and not on ``workers`` nor on
        which search ends first, unless the time runs out. When four starts have met every task, no
        more are tried. Ctrl-C ends the search and returns what was found.

        Parameters
        ----------
        q_start:
            The current posture (nq,), with the base's pose, where that matters.
        starts:
            Largest number of searches, including the one from ``q_start``.
        seconds:
            Wall time after which no search is started [s]; it also limits each single search (to no
            less than a second). The search from ``q_start`` is always made. The time to draw the
            starts beforehand, some 300 to 10,000 a second, counts but is not limited.
        workers:
            Number of processes, including this one; more than 16 seldom help. The others are
            started fresh, see :class:`~wbc.workers.Workers`.
        seed:
            Seed of the samples and the hops.
        progress:
            Called after every search.
        patience:
            The search ends after so many starts in a row without a posture that is better by 0.1 %;
            None: never. With many starts and some patience, hard problems get the time that easy
            ones do not need.

        Raises
        ------
        InvalidInputError
            An unusable configuration or number.
        KeyboardInterrupt
            Interrupted before anything was found.
        """
        began, now = perf_counter(), time()
        q = self.problem.robot.check_configuration(q_start)
        count = whole_number("global shaping, starts", starts, least=1)
        workers = whole_number("global shaping, workers", workers, least=1)
        seconds = _positive("global shaping, seconds", seconds)
        if patience is not None:
            patience = whole_number("global shaping, patience", patience, least=1)
        seed = whole_number("global shaping, seed", seed, most=LARGEST)
        built = build_nlp(self.problem, None if seconds is None else max(seconds, 1.0))
        deadline = None if seconds is None else now + seconds
        multi_start = MultiStart(built, q, count, patience, seed, progress)
        ready = perf_counter()
        searches = search_all(multi_start, built.nlp, min(workers, count) - 1, deadline)
        if searches.stopped is Stopped.INTERRUPTED and not searches.found:
            raise KeyboardInterrupt
        statistics = ShapingStatistics(
            drawn=multi_start.spread.drawn,
            searched=len(searches.found),
            iterations=sum(local.iterations for local in searches.found.values()),
            build_seconds=ready - began,
            search_seconds=perf_counter() - ready,
            workers=workers,
            stopped=searches.stopped,
        )
        return ShapingOutcome(multi_start.candidates(), multi_start.rejected(), statistics)

    def reach(
        self,
        q_start: ArrayLike,
        outcome: ShapingOutcome,
        tolerance: float = 0.01,
        attempts: int = 5,
        dt: float | None = None,
        make_controller: MakeController | None = None,
        longest: float | None = None,
        rest_speed: float | None = AT_REST,
        watch: Watch | None = None,
    ) -> ShapingMotion:
        """Run the QP controller from ``q_start`` to the best posture that it can reach.

        Parameters
        ----------
        outcome:
            The result of :meth:`solve`.
        tolerance:
            Largest excess of the final cost over the candidate's, relative to it.
        attempts:
            Number of candidates to try, the best first.
        dt:
            Time step [s]; None: that of this object.
        make_controller:
            A function that makes the controller from its tasks, for more constraints or another
            solver; by default a :class:`~wbc.controllers.kinematic.KinematicController` with this
            problem's contacts, limits and constraints.
        longest:
            Longest duration of the motion [s]; None: 4 s longer than the targets' ramp.
        rest_speed:
            The motion ends when no velocity is above this [rad/s, m/s] for ten ticks in a row;
            None: always after ``longest``.
        watch:
            Called with every tick of every attempt.

        Returns
        -------
        A motion; ``arrived`` tells whether it ends at a candidate. If not, it is the attempt with
        the least final cost, and its ``attempts`` hold the reasons.

        Raises
        ------
        NoPostureError
            The outcome has no candidate.
        """
        problem = self.problem
        dt = problem.dt if dt is None else finite_number("reach, dt", dt, above=0.0)

        def default(tasks: Sequence[Task]) -> KinematicController:
            return KinematicController(
                problem.robot,
                tasks,
                contacts=problem.contacts,
                limits=problem.limits,
                constraints=problem.constraints,
                dt=dt,
            )

        reach = PostureReach(
            problem,
            problem.robot.check_configuration(q_start),
            finite_number("reach, tolerance", tolerance, least=0.0),
            dt,
            _positive("reach, longest", longest),
            _positive("reach, rest_speed", rest_speed),
            make_controller or default,
            watch,
        )
        return reach.best(outcome, whole_number("reach, attempts", attempts, least=1))


def _positive(what: str, value: float | None) -> float | None:
    return None if value is None else finite_number(what, value, above=0.0)
