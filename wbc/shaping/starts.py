"""Where searches begin at first: the current posture, and others spread over all that is allowed.

A Sobol sequence fills the box of the joints (and the rotations of the base, where these matter)
more evenly than random numbers do. With closed chains a sample is projected onto the contacts
first. More are drawn than searched from: one evaluation costs a hundredth of a search, or less.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from wbc.robot import Robot
from wbc.shaping.nlp import BuiltNlp, Start
from wbc.shaping.unknowns import with_joints
from wbc.validate import Array

DRAWN_PER_START = 8
DRAWN_PER_CLOSED_START = 3  # projecting a sample onto contacts costs a tenth of a search
FAR = 10.0  # rad or m, from the current position: limits beyond it stand for none in many files
SMALLEST_COST = 1e-12  # of a middling sample: below it there is nothing to optimise
CLOSED = 1e-3  # m, rad: near enough to the contacts to begin from; IPOPT does the rest
NEWTON_STEPS = 40
LONGEST_STEP = 0.5  # rad


class ContactProjection:
    """Projects unknowns onto the contacts by Gauss-Newton steps within the bounds."""

    def __init__(self, built: BuiltNlp) -> None:
        nlp = built.nlp
        x, p = ca.SX.sym("x", nlp.lower.size), ca.SX.sym("p", nlp.functions.size1_in(1))
        gap = nlp.functions(x, p)[1][: nlp.closures]
        self._gap = ca.Function("gap", [x, p], [gap, ca.jacobian(gap, x)])
        self._lower, self._upper = nlp.lower, nlp.upper

    def project(self, start: Start) -> tuple[Start, float]:
        """Return the start on the contacts, and how far off them its worst row still is.

        Unknowns that a step takes beyond a bound are put on it and left out of the next step.
        """
        x, free = start.x, np.ones(start.x.size, dtype=bool)
        gap, jacobian = self._evaluate(x, start.p)
        for _ in range(NEWTON_STEPS):
            if np.abs(gap).max() < 0.01 * CLOSED:
                break
            step = np.zeros(x.size)
            step[free] = -np.linalg.lstsq(jacobian[:, free], gap, rcond=1e-6)[0]
            step *= min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), 1e-12))
            moved = np.clip(x + step, self._lower, self._upper)
            free = np.isclose(moved, x + step, rtol=0.0, atol=1e-12)
            x = moved
            gap, jacobian = self._evaluate(x, start.p)
        return start._replace(x=x), float(np.abs(gap).max())

    def _evaluate(self, x: Array, p: Array) -> tuple[Array, Array]:
        gap, jacobian = self._gap(x, p)
        return np.array(gap, dtype=float).ravel(), np.array(jacobian, dtype=float)


@dataclass(frozen=True, eq=False)
class Starts:
    """Starts in the order in which they are to be tried; the first is the current posture."""

    starts: tuple[Start, ...]  # scaled so that the cost is about 1 at a middling sample
    scale: float  # the factor on the cost that does it
    unclosed: tuple[float, ...]  # distances of samples not to be projected onto the contacts
    drawn: int  # how many samples were drawn


@dataclass(frozen=True, eq=False)
class Sampling:
    """Which joint positions (nv-6,) may be drawn, and how a posture of them becomes a start."""

    built: BuiltNlp
    q_start: Array
    # The joints' ranges; a joint without limits, or with one that is farther off than any that are
    # meant as limits, is moved by pi that way from q_start.
    lower: Array
    upper: Array
    projection: ContactProjection | None  # None if the program has no contacts

    @classmethod
    def of(cls, built: BuiltNlp, q_start: Array) -> Sampling:
        """Return the sampling of a problem from a current posture."""
        limits = built.unknowns.problem.robot.limits
        joints = np.clip(limits.joint_positions(q_start), limits.lower, limits.upper)
        return cls(
            built,
            q_start,
            np.where(joints - limits.lower <= FAR, limits.lower, joints - np.pi),
            np.where(limits.upper - joints <= FAR, limits.upper, joints + np.pi),
            ContactProjection(built) if built.nlp.closures else None,
        )

    def start(self, q: Array) -> tuple[Start, float]:
        """Return the start at a posture and how far off the contacts it is [m or rad]."""
        start = self.built.start(q)
        return (start, 0.0) if self.projection is None else self.projection.project(start)

    def posture(self, joints: Array, base: Array) -> Array:
        """Return the configuration of joint positions (nv-6,) and a base (7,)."""
        q = with_joints(self.robot, joints)
        q[:7] = base
        return q

    @property
    def robot(self) -> Robot:
        """The robot that is posed."""
        return self.built.unknowns.problem.robot


def make_starts(sampling: Sampling, count: int, seed: int) -> Starts:
    """Return ``count`` starts, or fewer if too few samples reach the contacts."""
    built = sampling.built
    evaluate = built.nlp.functions
    per_start = DRAWN_PER_START if sampling.projection is None else DRAWN_PER_CLOSED_START
    drawn = per_start * (count - 1)
    first, _ = sampling.start(sampling.q_start)
    reached = [sampling.start(q) for q in _sample_postures(sampling, drawn, seed)]
    samples = [start for start, gap in reached if gap <= CLOSED]
    costs = np.array([float(evaluate(start.x, start.p)[0]) for start in (first, *samples)])
    scale = 1.0 / max(float(np.median(costs)), SMALLEST_COST)
    chosen = [first, *(samples[k] for k in _chosen(costs[1:], count - 1))]
    return Starts(
        tuple(built.scaled(start, scale) for start in chosen),
        scale,
        tuple(gap for _, gap in reached if gap > CLOSED),
        drawn,
    )


def _chosen(costs: Array, count: int) -> list[int]:
    """Return indices of samples to search from: by turns the cheapest left and the next drawn.

    The cheapest alone would crowd into the widest basin.
    """
    cheapest, drawn = list(np.argsort(costs, kind="stable")), list(range(costs.size))
    turns = (int(k) for pair in zip(cheapest, drawn, strict=True) for k in pair)
    return list(dict.fromkeys(turns))[:count]  # a dict keeps the order


def _sample_postures(sampling: Sampling, count: int, seed: int) -> list[Array]:
    """Return configurations spread over the joints' ranges and, if it matters, base rotations.

    The base stays where it is in the current posture.
    """
    from scipy.stats import qmc  # only here: it takes half a second to load

    if count == 0:
        return []
    lower, upper = sampling.lower, sampling.upper
    sequence = qmc.Sobol(lower.size + 3, scramble=True, seed=np.random.default_rng(seed))
    points = sequence.random_base2(int(np.ceil(np.log2(count))))[:count]
    base = sampling.q_start[:7]
    found = []
    for point in points:
        q = sampling.posture(lower + point[3:] * (upper - lower), base)
        if sampling.built.turns_base:
            q[3:7] = (uniform_rotation(point[:3]) * Rotation.from_quat(base[3:7])).as_quat()
        found.append(q)
    return found


def uniform_rotation(u: Array) -> Rotation:
    """Return the rotation of (3,) uniform numbers that makes them uniform (Shoemake 1992)."""
    inner, outer = np.sqrt(1.0 - u[0]), np.sqrt(u[0])
    a, b = 2.0 * np.pi * u[1:]
    return Rotation.from_quat(
        (inner * np.sin(a), inner * np.cos(a), outer * np.sin(b), outer * np.cos(b))
    )
