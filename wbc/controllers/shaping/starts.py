"""Where searches begin at first: the current posture, and others spread over all that is allowed.

A Sobol sequence fills the box of the joints (and the turns of the base, where these matter) more
evenly than random numbers do. With closed chains a sample is brought onto the contacts first.
More are drawn than searched from: one evaluation costs a hundredth of a search, or less.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from wbc.controllers.shaping.closing import CLOSED, Closing
from wbc.controllers.shaping.nlp import BuiltNlp, Start
from wbc.controllers.shaping.unknowns import with_joints
from wbc.robot import Robot
from wbc.validate import Array

DRAWN_PER_START = 8
DRAWN_PER_CLOSED_START = 3  # a sample brought onto contacts costs a tenth of a search
FAR = 10.0  # rad or m, from the current position: limits beyond it stand for none in many files
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


@dataclass(frozen=True, eq=False)
class Sampling:
    """Which joint positions (nv-6,) may be drawn, and how a posture of them becomes a start.

    Attributes
    ----------
    lower, upper:
        The joints' ranges; a joint without limits, or with one that is farther off than
        any that are meant as limits, is moved by pi that way from ``q_start``.
    closing:
        Brings starts onto the contacts; None if there are none.
    """

    built: BuiltNlp
    q_start: Array
    lower: Array
    upper: Array
    closing: Closing | None

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
            Closing(built) if built.nlp.closures else None,
        )

    def start(self, q: Array) -> tuple[Start, float]:
        """Return the start at a posture and how far off the contacts it is [m or rad]."""
        start = self.built.start(q)
        return (start, 0.0) if self.closing is None else self.closing.closed(start)

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
    drawn = (DRAWN_PER_START if sampling.closing is None else DRAWN_PER_CLOSED_START) * (count - 1)
    first, _ = sampling.start(sampling.q_start)
    reached = [sampling.start(q) for q in sample_postures(sampling, drawn, seed)]
    samples = [start for start, gap in reached if gap <= CLOSED]
    costs = np.array([float(evaluate(start.x, start.p)[0]) for start in (first, *samples)])
    scale = 1.0 / max(float(np.median(costs)), SMALLEST_COST)
    chosen = [first, *(samples[k] for k in picked(costs[1:], count - 1))]
    return Starts(
        tuple(built.scaled(start, scale) for start in chosen),
        scale,
        tuple(gap for _, gap in reached if gap > CLOSED),
        drawn,
    )


def picked(costs: Array, count: int) -> list[int]:
    """Return indices of samples to search from: by turns the cheapest left and the next drawn.

    The cheapest alone would crowd into the widest valley.
    """
    cheapest, drawn = list(np.argsort(costs, kind="stable")), list(range(costs.size))
    chosen = dict.fromkeys(
        int(k) for pair in zip(cheapest, drawn, strict=True) for k in pair
    )  # a dict keeps the order
    return list(chosen)[:count]


def sample_postures(sampling: Sampling, count: int, seed: int) -> list[Array]:
    """Return configurations spread over the joints' ranges and, if they matter, the base's turns.

    The base stays where it is in the current posture.
    """
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
    """Return the rotation that maps (3,) uniform numbers to uniform rotations (Shoemake 1992)."""
    inner, outer = np.sqrt(1.0 - u[0]), np.sqrt(u[0])
    a, b = 2.0 * np.pi * u[1:]
    return Rotation.from_quat(
        (inner * np.sin(a), inner * np.cos(a), outer * np.sin(b), outer * np.cos(b))
    )
