"""Hops from good postures: a minimum known in closed form, and the same answer in any order."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from tests import urdf
from wbc.constraints import Contact
from wbc.robot import Robot
from wbc.shaping import GlobalShaping, Stopped
from wbc.shaping import multi_start as multi_start_module
from wbc.shaping.basin_hopping import ELITE, Elite
from wbc.shaping.evaluation import SAME_POSTURE, merge_duplicates
from wbc.shaping.multi_start import ENOUGH_ZEROS, HOP_LAG, ZERO_COST, StoppingRule
from wbc.shaping.outcome import Candidate, ConstraintMargins, Rejected
from wbc.tasks import AxisTask, InertiaTask

LIMBS, LIMIT = 12, 3.0  # rad


def limb(k: int, limit: float = LIMIT, kind: str = "revolute") -> str:
    """Return a joint and what it carries."""
    joint = {"kind": kind, "axis": "0 0 1", "limit": urdf.limit(limit, 10, 5)}
    return urdf.link(f"limb{k}", at="0.1 0 0") + urdf.joint(f"j{k}", "base", f"limb{k}", **joint)


@pytest.fixture(scope="module")
def star() -> Robot:
    """A body with twelve limbs of one wide joint each."""
    return Robot.load(urdf.robot("star", urdf.link("base"), *map(limb, range(LIMBS))))


def pointing(robot: Robot, angles: np.ndarray) -> GlobalShaping:
    """Every limb is to point at an angle, the body being held."""
    here = robot.snapshot(robot.postures["neutral"])
    held = Contact(robot, "base", here.position("base"), here.rotation("base"))
    tasks = [
        AxisTask(robot, f"limb{k}", [np.cos(a), np.sin(a), 0.0], axis=[1, 0, 0], gain=1.0)
        for k, a in enumerate(angles)
    ]
    return GlobalShaping(robot, tasks, [held])


@pytest.mark.slow
def test_the_known_best_of_four_thousand_valleys(star: Robot, monkeypatch) -> None:
    """A limb that begins more than half a turn from its angle ends at the wrong limit.

    So there are 2^12 valleys; if every joint is drawn evenly, one begins in the best of them with
    probability (3.05 / 6)^12 = 0.03 %. It lies at the upper limits: the angles are beyond.
    """
    angle = 3.1 - 0.03 * np.arange(LIMBS) / LIMBS
    assert (angle > LIMIT).all()
    least = float(np.sum(1.0 - np.cos(angle - LIMIT)))  # 1/2 |difference of two unit vectors|^2
    shaping, q = pointing(star, angle), star.postures["neutral"].copy()
    q[7:] = -2.0  # in the worst valley
    outcome = shaping.solve(q, 160, workers=1)
    # IPOPT's barrier leaves about 1e-8 of the cost of a middling posture, here some 12.
    assert outcome.best.cost == pytest.approx(least, abs=1e-6)
    np.testing.assert_allclose(outcome.best.q[7:], LIMIT, atol=1e-4)
    assert min(outcome.best.starts) >= 24  # a hop led there
    monkeypatch.setattr(multi_start_module, "SPREAD_STARTS", 160)  # no hops at all
    spread = shaping.solve(q, 160, workers=1)
    assert spread.best.cost > 1.2 * least  # at least one limb is at the wrong limit


def test_patience_counts_searches_without_a_better_posture(hoap2) -> None:
    """The search ends ``patience`` after the last start that gained 0.1 %, and not before."""
    q = hoap2.posture()
    wanted = np.diag(np.diag(hoap2.snapshot(q).inertia_in("base")) * [1.5, 1.5, 0.3])
    shaping = GlobalShaping(hoap2, [InertiaTask(hoap2, wanted, frame="base", per_mass=True)])
    news: list[tuple[int, float]] = []
    outcome = shaping.solve(
        q, 200, workers=1, patience=10, progress=lambda done, _, cost: news.append((done, cost))
    )
    record, at = news[0][1], news[0][0]
    for done, cost in news:
        assert done <= at + 10
        if cost < 0.999 * record:
            record, at = cost, done
    assert outcome.statistics.searched == at + 10
    assert outcome.best.cost == news[-1][1]


@dataclass(frozen=True)
class Scripted:
    """Costs by number, inf for a start that came to nothing."""

    costs: np.ndarray

    def result(self, number: int) -> Candidate | Rejected:
        cost = float(self.costs[number])
        if not np.isfinite(cost):
            return Rejected(number, "none", "none")
        kept = ConstraintMargins(0.0, 1.0, None, None, ())
        q = np.concatenate(([0, 0, 0, 0, 0, 0, 1.0], np.full(25, 0.1 * number)))
        return Candidate(q, cost, {}, kept, "ok", True, 1, (number,))


def run(script: Scripted, patience: int | None, rng: np.random.Generator, window: int) -> Any:
    """Let searches end in any order within a window; stop when told to, finishing what is begun."""
    rule, begun, enough = StoppingRule(1.0, patience), 0, False
    under_way: list[int] = []
    while under_way or (begun < script.costs.size and not enough):
        while len(under_way) < window and begun < script.costs.size and not enough:
            under_way.append(begun)
            begun += 1
        number = under_way.pop(int(rng.integers(len(under_way))))
        rule.add(number, script.result(number))
        enough = rule.last is not None
    return rule


@pytest.mark.parametrize("met", [0.0, 0.05])
def test_stopping_does_not_depend_on_the_order_in_which_searches_end(hoap2, rng, met) -> None:
    for _ in range(20):
        costs = rng.uniform(0.5, 1.0, 80) * 0.97 ** rng.integers(0, 40, 80)
        costs[rng.random(80) < 0.2] = np.inf
        costs[rng.random(80) < met] = 0.1 * ZERO_COST
        script = Scripted(costs)
        alone = run(script, 12, rng, 1)
        # By hand: in the order of the starts, until enough are met or none was better for long.
        record, at, ends, zeros = np.inf, 0, None, 0
        for number, cost in enumerate(costs):
            zeros += cost <= ZERO_COST
            if cost < 0.999 * record:
                record, at = cost, number
            if np.isfinite(record) and number >= at + 12:
                ends = (number, Stopped.SETTLED)
            if zeros == ENOUGH_ZEROS:
                ends = (number, Stopped.MET)
            if ends is not None:
                break
        expected = range(80 if ends is None else ends[0] + 1)
        for rule in (alone, *(run(script, 12, rng, window) for window in (3, HOP_LAG))):
            candidates = [one for one in rule.results_until_stop() if isinstance(one, Candidate)]
            results_until_stop = sorted(
                k for c in merge_duplicates(hoap2, candidates) for k in c.starts
            )
            assert results_until_stop == [k for k in expected if np.isfinite(costs[k])]
            lost = [one.start for one in rule.results_until_stop() if isinstance(one, Rejected)]
            assert lost == [k for k in expected if not np.isfinite(costs[k])]
            assert rule.reason == (None if ends is None else ends[1])


def test_the_elite_are_the_best_that_differ(hoap2, rng) -> None:
    costs = rng.permutation(30) + 1.0
    elite = Elite(hoap2)
    for number in range(30):
        one = Scripted(costs).result(number)
        elite.add(one)
        # The same but for two joints of 25, a little worse and a little better.
        for change in (1e-3, -1e-3):
            q = one.q.copy()
            q[[8, 20]] += 1.0
            elite.add(replace(one, q=q, cost=one.cost + change))
    assert [one.cost for one in elite.best] == pytest.approx(np.arange(1, ELITE + 1) - 1e-3)


def test_postures_are_told_apart_one_by_one(hoap2, rng) -> None:
    """Against every pair in turn: some alike, some turned at the base alone."""
    costs = rng.permutation(120) + 1.0
    ones = [Scripted(costs).result(number) for number in range(30)]
    for number in range(30, 120):
        like = ones[int(rng.integers(30))]
        v = rng.uniform(-0.5, 0.5, hoap2.nv) * rng.choice([0.008, 0.03])
        v[6:] *= rng.random() < 0.7
        q = hoap2.integrate(like.q, v, 1.0)
        ones.append(replace(like, q=q, cost=float(costs[number]), starts=(number,)))
    expected: list[Candidate] = []
    for one in sorted(ones, key=lambda c: c.cost):
        far = [np.abs(hoap2.difference(known.q, one.q)).max() >= SAME_POSTURE for known in expected]
        if all(far):
            expected.append(one)
    found = merge_duplicates(hoap2, ones)
    assert 30 < len(found) < 120
    assert [one.cost for one in found] == [one.cost for one in expected]
    assert sorted(k for one in found for k in one.starts) == list(range(120))


def test_a_limit_that_stands_for_none_is_not_drawn_from() -> None:
    """A slide "of 1e9 m": drawn evenly, every sample's cost would drown that of the start."""
    robot = Robot.load(urdf.robot("slide", urdf.link("base"), limb(0, 1e9, "prismatic")))
    q = robot.postures["neutral"]
    here = robot.snapshot(q)
    held = Contact(robot, "base", here.position("base"), here.rotation("base"))
    there = q.copy()
    there[7] = 0.7
    task = InertiaTask(robot, robot.snapshot(there).inertia_in("base"), frame="base")
    best = GlobalShaping(robot, [task], [held]).solve(q, 4, workers=1).best
    np.testing.assert_allclose(np.abs(best.q[7:]), 0.7, atol=1e-4)  # up or down, it is the same
