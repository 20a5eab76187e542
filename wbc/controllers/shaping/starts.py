"""Where searches begin: the current posture, and postures spread evenly over all that is allowed.

A Sobol sequence fills the box of the joints (and the turns of the base, where these matter) more
evenly than random numbers do. With closed chains a sample is brought onto the contacts first.
More are drawn than searched from: one evaluation costs a hundredth of a search, or less.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from wbc.controllers.shaping.nlp import BuiltNlp, Start
from wbc.controllers.shaping.unknowns import with_joints
from wbc.robot import Robot
from wbc.validate import Array

DRAWN_PER_START = 8
DRAWN_PER_CLOSED_START = 3  # a sample brought onto contacts costs a tenth of a search
CLOSED = 1e-3  # m, rad: near enough to the contacts to begin from; IPOPT does the rest
NEWTON_STEPS = 40
LONGEST_STEP = 0.5  # rad
SMALLEST_COST = 1e-12  # of a middling sample: below it there is nothing to optimise


@dataclass(frozen=True, eq=False)
class Starts:
    """Starts in the order in which they are to be tried; the first is the current posture.

    Attributes
    ----------
    starts:
        Scaled so that the cost is about 1 at a middling sample.
    scale:
        The factor on the cost that does it.
    unclosed:
        For each sample that could not be brought onto the contacts: how far it stayed away.
    drawn:
        How many samples were drawn.
    """

    starts: tuple[Start, ...]
    scale: float
    unclosed: tuple[float, ...]
    drawn: int


def make_starts(built: BuiltNlp, q_start: Array, count: int, seed: int) -> Starts:
    """Return ``count`` starts, or fewer if too few samples reach the contacts."""
    robot, evaluate = built.unknowns.problem.robot, built.nlp.functions
    per_start = DRAWN_PER_CLOSED_START if built.nlp.closures else DRAWN_PER_START
    drawn = per_start * (count - 1)
    postures = sample_postures(robot, q_start, drawn, seed, built.turns_base)
    first = built.start(q_start)
    samples, unclosed = [built.start(q) for q in postures], tuple[float, ...]()
    if built.nlp.closures:
        closing = Closing(built)
        first, _ = closing.closed(first)
        brought = [closing.closed(start) for start in samples]
        samples = [start for start, gap in brought if gap <= CLOSED]
        unclosed = tuple(gap for _, gap in brought if gap > CLOSED)
    costs = np.array([float(evaluate(start.x, start.p)[0]) for start in (first, *samples)])
    scale = 1.0 / max(float(np.median(costs)), SMALLEST_COST)
    chosen = [first, *(samples[k] for k in picked(costs[1:], count - 1))]
    return Starts(tuple(built.scaled(start, scale) for start in chosen), scale, unclosed, drawn)


def picked(costs: Array, count: int) -> list[int]:
    """Return indices of samples to search from: by turns the cheapest left and the next drawn.

    The cheapest alone would crowd into the widest valley.
    """
    cheapest, drawn = list(np.argsort(costs, kind="stable")), list(range(costs.size))
    chosen = dict.fromkeys(
        int(k) for pair in zip(cheapest, drawn, strict=True) for k in pair
    )  # a dict keeps the order
    return list(chosen)[:count]


def sample_postures(
    robot: Robot, q_start: Array, count: int, seed: int, turn_base: bool
) -> list[Array]:
    """Return configurations spread over the joints' ranges and, if asked, the base's turns.

    A joint without limits is moved by pi either way. The base stays where it is in ``q_start``.
    """
    if count == 0:
        return []
    joints, limits = robot.limits.joint_positions(q_start), robot.limits
    lower = np.where(np.isfinite(limits.lower), limits.lower, joints - np.pi)
    upper = np.where(np.isfinite(limits.upper), limits.upper, joints + np.pi)
    sequence = qmc.Sobol(joints.size + 3, scramble=True, seed=np.random.default_rng(seed))
    points = sequence.random_base2(int(np.ceil(np.log2(count))))[:count]
    found = []
    for point in points:
        q = with_joints(robot, lower + point[3:] * (upper - lower))
        q[:7] = q_start[:7]
        if turn_base:
            q[3:7] = (uniform_rotation(point[:3]) * Rotation.from_quat(q_start[3:7])).as_quat()
        found.append(q)
    return found


def uniform_rotation(u: Array) -> Rotation:
    """Return the rotation that maps (3,) uniform numbers to uniform rotations (Shoemake 1992)."""
    inner, outer = np.sqrt(1.0 - u[0]), np.sqrt(u[0])
    a, b = 2.0 * np.pi * u[1:]
    return Rotation.from_quat(
        (inner * np.sin(a), inner * np.cos(a), outer * np.sin(b), outer * np.cos(b))
    )


class Closing:
    """Brings unknowns onto the contacts by Gauss-Newton steps within the bounds."""

    def __init__(self, built: BuiltNlp) -> None:
        nlp = built.nlp
        x, p = ca.SX.sym("x", nlp.lower.size), ca.SX.sym("p", nlp.functions.size1_in(1))
        gap = nlp.functions(x, p)[1][: nlp.closures]
        self._gap = ca.Function("gap", [x, p], [gap, ca.jacobian(gap, x)])
        self._lower, self._upper = nlp.lower, nlp.upper

    def closed(self, start: Start) -> tuple[Start, float]:
        """Return the start on the contacts, and how far off them its worst row still is.

        Unknowns that a step takes beyond a bound are put on it and left out of the next step.
        """
        x, free = start.x, np.ones(start.x.size, dtype=bool)
        gap, slope = self._evaluate(x, start.p)
        for _ in range(NEWTON_STEPS):
            if np.abs(gap).max() < 0.01 * CLOSED:
                break
            step = np.zeros(x.size)
            step[free] = -np.linalg.lstsq(slope[:, free], gap, rcond=1e-6)[0]
            step *= min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), 1e-12))
            moved = np.clip(x + step, self._lower, self._upper)
            free = np.isclose(moved, x + step, rtol=0.0, atol=1e-12)
            x = moved
            gap, slope = self._evaluate(x, start.p)
        return start._replace(x=x), float(np.abs(gap).max())

    def _evaluate(self, x: Array, p: Array) -> tuple[Array, Array]:
        gap, slope = self._gap(x, p)
        return np.array(gap, dtype=float).ravel(), np.array(slope, dtype=float)
