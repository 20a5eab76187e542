"""Basin hopping: new starts made of the best postures so far.

The cost has many local minima, and deep ones lie near each other: a nearly optimal posture usually
differs in one limb only. So a search begins at a mixture of two good postures (Deaven and Ho, Phys.
Rev. Lett. 75 (1995)), or at a good one with some joints resampled
(monotonic basin hopping: Leary, "Global optimization on funneling landscapes", J. Global Optim. 18
(2000), after Wales and Doye, J. Phys. Chem. A 101 (1997)). The elite are several different
postures, so that hops do not stay around one minimum (Grosso, Locatelli and Schoen, Math. Program.
110 (2007)), and every fourth posture is sampled completely.

Measured on seven targets with many minima: of mixtures of postures that differ in eight joints or
more 5 % end lower than anything before, of those that differ in less than four none, of postures
with joints resampled 1 %, of whole ones 1 %.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from wbc.robot import Robot
from wbc.shaping.nlp import Start
from wbc.shaping.outcome import Candidate
from wbc.shaping.starts import CLOSED, Sampling, uniform_rotation
from wbc.validate import Array

ELITE = 8  # number of postures from which hops start
DIFFERENT_SHARE, DIFFERENT_BY = 0.15, 0.05  # of the joints, differ by this [rad or m]
MIXED_SHARE = 0.75  # of the hops from the elite, the part that mixes two
MOST_RESAMPLED = 0.4  # of the joints, the largest part that is resampled
WHOLE_EVERY = 4  # hops: how often a whole posture is sampled
PROJECTION_TRIES = 4  # at a hop that can be projected onto the contacts


class Elite:
    """The best few postures of those added that differ in more than a joint or two."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self.best: list[Candidate] = []  # the very best first

    def add(self, candidate: Candidate) -> None:
        """Add a posture if it is among the best; of similar ones only the best is kept."""
        rivals = [one for one in self.best if self._are_similar(one.q, candidate.q)]
        if any(one.cost <= candidate.cost for one in rivals):
            return
        others = [one for one in self.best if all(one is not rival for rival in rivals)]
        self.best = sorted([*others, candidate], key=lambda c: (c.cost, c.starts))[:ELITE]

    def _are_similar(self, one: Array, other: Array) -> bool:
        apart = np.abs(self._robot.difference(one, other)[6:]) > DIFFERENT_BY
        return int(apart.sum()) < DIFFERENT_SHARE * apart.size


class BasinHopping:
    """Makes starts; each depends only on its number, the seed and the elite."""

    def __init__(self, sampling: Sampling, scale: float, seed: int) -> None:
        self._sampling, self._scale, self._seed = sampling, scale, seed

    def start(self, number: int, elite: Sequence[Candidate]) -> Start:
        """Return the start of this number, or the nearest to the contacts if projection fails."""
        rng = np.random.default_rng((self._seed, number))
        found: list[tuple[float, Start]] = []
        for _ in range(PROJECTION_TRIES):
            start, gap = self._sampling.start(self._posture(number, elite, rng))
            found.append((gap, start))
            if gap <= CLOSED:
                break
        _, nearest = min(found, key=lambda one: one[0])
        return self._sampling.built.scaled(nearest, self._scale)

    def _posture(self, number: int, elite: Sequence[Candidate], rng: np.random.Generator) -> Array:
        if not elite or number % WHOLE_EVERY == 0:
            return self._sampled(rng)
        first = elite[int(rng.integers(len(elite)))]
        others = [one for one in elite if one is not first]
        if not others or rng.random() >= MIXED_SHARE:
            return self._resampled(first.q, rng)
        return self._mixed(first.q, others[int(rng.integers(len(others)))].q, rng)

    def _sampled(self, rng: np.random.Generator) -> Array:
        sampling = self._sampling
        base = sampling.q_start[:7].copy()
        if sampling.built.turns_base:
            turn = uniform_rotation(rng.random(3))
            base[3:] = (turn * Rotation.from_quat(base[3:])).as_quat()
        return sampling.posture(rng.uniform(sampling.lower, sampling.upper), base)

    def _resampled(self, q: Array, rng: np.random.Generator) -> Array:
        sampling = self._sampling
        joints = sampling.robot.limits.joint_positions(q).copy()
        count = int(rng.integers(1, max(1, round(MOST_RESAMPLED * joints.size)) + 1))
        some = rng.choice(joints.size, count, replace=False)
        joints[some] = rng.uniform(sampling.lower[some], sampling.upper[some])
        return sampling.posture(joints, q[:7])

    def _mixed(self, q: Array, other: Array, rng: np.random.Generator) -> Array:
        """Return a posture with about half of the other's joints."""
        limits = self._sampling.robot.limits
        joints, theirs = limits.joint_positions(q), limits.joint_positions(other)
        taken = rng.random(joints.size) < 0.5
        return self._sampling.posture(np.where(taken, theirs, joints), q[:7])
