"""Global inertia shaping: the same tasks as the QP's, minimised over all postures.

The QP goes downhill from where the robot is, and rests in the nearest valley. Here the same cost is
minimised by IPOPT from many starts; then the QP is run towards the best posture that it can reach,
so that the answer is a motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from time import perf_counter

from numpy.typing import ArrayLike

from wbc.constraints import Contact, Limits
from wbc.controllers.shaping.capsules import CapsulePair
from wbc.controllers.shaping.motion import Motion, Watch
from wbc.controllers.shaping.nlp import build_nlp
from wbc.controllers.shaping.outcome import ShapingOutcome, ShapingStatistics, Stopped
from wbc.controllers.shaping.parallel import search_all
from wbc.controllers.shaping.problem import ShapingProblem, check_parts, support_half_planes
from wbc.controllers.shaping.reach import AT_REST, MakeController, Terms, reach_best
from wbc.controllers.shaping.starts import make_starts
from wbc.controllers.shaping.verdicts import Progress, Verdicts
from wbc.robot import Robot
from wbc.tasks import Task
from wbc.validate import finite_number


class GlobalShaping:
    """Search for the globally best posture, and move there.

    Parameters
    ----------
    robot, tasks, contacts:
        As for :class:`~wbc.controllers.kinematic.KinematicController`. Tasks are read when
        :meth:`solve` is called; momentum tasks and several priorities are refused.
    limits:
        Joint limits, by default ``Limits(robot)``.
    support_margin:
        Keep the CoM this far inside the polygon of the held soles [m], or None for no such
        constraint.
    capsules:
        Pairs of capsules that must not touch.

    Raises
    ------
    InvalidInputError
        Parts that do not fit together, or a task that says nothing about postures.
    UnknownNameError
        A capsule's frame does not exist.
    """

    def __init__(
        self,
        robot: Robot,
        tasks: Sequence[Task],
        contacts: Sequence[Contact] = (),
        limits: Limits | None = None,
        support_margin: float | None = None,
        capsules: Sequence[CapsulePair] = (),
    ) -> None:
        limits = Limits(robot) if limits is None else limits
        check_parts(robot, tasks, contacts, limits, capsules)
        support = None
        if support_margin is not None:
            support = support_half_planes(robot, contacts, support_margin)
        self.problem = ShapingProblem(
            robot, tuple(tasks), tuple(contacts), limits, support, tuple(capsules)
        )
        build_nlp(self.problem)  # a task that cannot be used is an error now, not after an hour

    def solve(
        self,
        q_start: ArrayLike,
        starts: int = 64,
        seconds: float | None = None,
        workers: int = 2,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> ShapingOutcome:
        """Search from the current posture and from others spread over all that is allowed.

        The answer depends on ``starts`` and ``seed``, and not on ``workers`` nor on which search
        ends first, unless the time runs out. When four starts have met every task, no others are
        tried. Ctrl-C ends the search and returns what was found.

        Parameters
        ----------
        q_start:
            The current posture (nq,); where it matters, also where the base is.
        starts:
            How many searches, the one from ``q_start`` included.
        seconds:
            Wall time after which no search is begun [s]; no single one takes longer either. The
            search from ``q_start`` is always made. Starts are drawn before, at some 1,000 to
            10,000 a second, which counts but is not cut short.
        workers:
            Processes, this one included; see :func:`~wbc.controllers.shaping.parallel.search_all`.
        seed:
            Of the samples.
        progress:
            Called after every search.

        Raises
        ------
        InvalidInputError
            An unusable configuration or number.
        KeyboardInterrupt
            Interrupted before anything was found.
        """
        began = perf_counter()
        q = self.problem.robot.check_configuration(q_start)
        count = int(finite_number("global shaping, starts", starts, least=1))
        workers = int(finite_number("global shaping, workers", workers, least=1))
        seconds = _positive("global shaping, seconds", seconds)
        built = build_nlp(self.problem)
        drawn = make_starts(built, q, count, seed)
        verdicts = Verdicts(built, drawn, progress)
        ready = perf_counter()
        left = None if seconds is None else max(seconds - (ready - began), 0.0)
        searches = search_all(built.nlp, drawn.starts, workers, left, verdicts.note)
        if searches.stopped is Stopped.INTERRUPTED and not searches.found:
            raise KeyboardInterrupt
        statistics = ShapingStatistics(
            drawn=drawn.drawn,
            searched=verdicts.searched,
            iterations=sum(local.iterations for local in searches.found.values()),
            build_seconds=ready - began,
            search_seconds=perf_counter() - ready,
            workers=workers,
            stopped=searches.stopped,
        )
        return ShapingOutcome(verdicts.candidates(), verdicts.rejected(), statistics)

    def reach(
        self,
        q_start: ArrayLike,
        outcome: ShapingOutcome,
        tolerance: float = 0.01,
        attempts: int = 5,
        dt: float = 0.005,
        make_controller: MakeController | None = None,
        longest: float | None = None,
        rest_speed: float | None = AT_REST,
        watch: Watch | None = None,
    ) -> Motion:
        """Run the QP controller from ``q_start`` to the best posture that it can reach.

        Parameters
        ----------
        outcome:
            What :meth:`solve` returned.
        tolerance:
            How much the cost at the end may be above the candidate's, relative to it.
        attempts:
            How many candidates to try, the best first.
        dt:
            Time step [s].
        make_controller:
            Makes the controller from its tasks, for more constraints or another solver; by default
            a :class:`~wbc.controllers.kinematic.KinematicController` with this problem's contacts
            and limits.
        longest:
            How long the motion may take [s]; None: 4 s longer than the way there.
        rest_speed:
            The motion ends when no velocity is above this [rad/s, m/s] for ten ticks in a row;
            None: always after ``longest``.
        watch:
            Called with every tick of every attempt.

        Returns
        -------
        A motion; ``arrived`` tells whether it ends at a candidate. If it does not, it is the
        attempt that came to the least cost, and its attempts say what went wrong.

        Raises
        ------
        NoPostureError
            The outcome has no candidate.
        """
        terms = Terms(
            tolerance=finite_number("reach, tolerance", tolerance, least=0.0),
            attempts=int(finite_number("reach, attempts", attempts, least=1)),
            dt=finite_number("reach, dt", dt, above=0.0),
            longest=_positive("reach, longest", longest),
            rest_speed=_positive("reach, rest_speed", rest_speed),
        )
        q = self.problem.robot.check_configuration(q_start)
        return reach_best(self.problem, q, outcome, terms, make_controller, watch)


def _positive(what: str, value: float | None) -> float | None:
    return None if value is None else finite_number(what, value, above=0.0)
