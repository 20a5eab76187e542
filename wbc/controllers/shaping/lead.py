"""Tasks that lead the controller from one configuration to another."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wbc.controllers.shaping.outcome import Candidate
from wbc.controllers.shaping.problem import ShapingProblem
from wbc.minimum_jerk import PEAK, minimum_jerk
from wbc.robot import Snapshot
from wbc.robot.names import BASE
from wbc.tasks import ComTask, PoseTask, PostureTask, Task
from wbc.validate import Array

AXES = ("x", "y")
COM_WEIGHT = 30.0  # 1/(m/s); the joints' and the base's weight is 1
LEADING = 1000.0  # factor by which the CoM's squared weight exceeds the tasks' afterwards
LEANING = 0.01  # m: a posture with its CoM nearer to the edge of the support leans on it
USED_SPEED = 0.5  # fraction of the velocity limits that the lead asks for at its fastest
SHORTEST, LONGEST = 2.0, 20.0  # s


class Lead:
    """Tasks that lead along the shortest way from one configuration to another.

    The problem's own tasks are not among them. They pull towards valleys on both sides of the way,
    and with weights of which nothing is known.

    Attributes
    ----------
    tasks:
        The posture's; the base's if no contact says where it is and it is to move; the CoM's if it
        is to stay over the support, which is convex: the straight line stays inside.
    lasting:
        What goes on when the problem's tasks take over: where the best posture leans on the edge of
        the support, they alone would fall over it, so the CoM is held.
    duration:
        Of the way [s]; it respects the joints' speed limits by a factor.
    """

    def __init__(self, problem: ShapingProblem, start: Array, candidate: Candidate) -> None:
        robot = problem.robot
        self._robot, self._start = robot, start
        self._way = robot.difference(start, candidate.q)
        self._posture = PostureTask(robot, start, name="way: posture")
        self._base: PoseTask | None = None
        self._com: ComTask | None = None
        here, there = robot.snapshot(start), robot.snapshot(candidate.q)
        self._com_start, self._com_way = here.com, there.com - here.com
        if problem.anchor is None and np.abs(self._way[:6]).max() > 0.0:
            self._base = PoseTask(
                robot, BASE, here.position(BASE), here.rotation(BASE), name="way: base"
            )
        if problem.supports:
            self._com = ComTask(robot, here.com, axes=AXES, name="way: com", weight=COM_WEIGHT)
        tasks = (self._posture, self._base, self._com)
        self.tasks: tuple[Task, ...] = tuple(task for task in tasks if task is not None)
        self.lasting: tuple[Task, ...] = ()
        if candidate.kept.support is not None and candidate.kept.support < LEANING:
            weight = float(np.sqrt(LEADING * _stiffness(problem.tasks, there)))
            level = problem.tasks[0].priority
            self.lasting = (
                ComTask(
                    robot, there.com, axes=AXES, name="way: com", weight=weight, priority=level
                ),
            )
        speed = USED_SPEED * problem.limits.speed
        slowest = float((np.abs(self._way[6:]) / speed).max(initial=0.0))
        self.duration = min(max(PEAK * slowest, SHORTEST), LONGEST)

    def move_to(self, time: float) -> None:
        """Set the targets to those of a time [s]."""
        x = min(time / self.duration, 1.0)
        along = minimum_jerk(x)
        q = self._robot.integrate(self._start, self._way, along)
        self._posture.set_target(q)
        if self._base is not None:
            here = self._robot.snapshot(q)
            self._base.set_target(here.position(BASE), here.rotation(BASE))
        if self._com is not None:
            self._com.set_target(self._com_start + along * self._com_way)


def _stiffness(tasks: Sequence[Task], snapshot: Snapshot) -> float:
    """Return the largest curvature of the tasks' cost, 1 if they have none here."""
    nv = snapshot.robot.nv
    total = np.zeros((nv, nv))
    for task in tasks:
        weighted = task.weight[:, None] * task.residual(snapshot).jacobian
        total += weighted.T @ weighted
    largest = float(np.linalg.eigvalsh(total)[-1])
    return largest if largest > 0.0 else 1.0
