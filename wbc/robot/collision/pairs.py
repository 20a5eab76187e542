"""Selection of the pairs of bodies to keep apart, with the reasons for excluding others."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wbc.errors import InvalidInputError
from wbc.robot.collision.bodies import named_surfaces
from wbc.robot.collision.model import CollisionModel
from wbc.robot.collision.refine import FinerPair, FinerShapes, Pair
from wbc.robot.collision.shapes import Body
from wbc.robot.formats.srdf import read_srdf
from wbc.robot.model import Robot
from wbc.robot.names import matching
from wbc.robot.postures import STANDING
from wbc.validate import Array, Bools, finite_number

SAMPLES = 200  # random postures
ALMOST_ALWAYS = 0.95  # share of them: pairs that touch this often cannot be kept apart
SEED = 0
TOUCHING = 1e-3  # m: raw shapes nearer than this when standing are in contact by design
RESOLVED_SHARE = 0.75  # of the raw distance, that finer shapes should have
CLEARANCE_RESERVE = 1e-3  # m, that they should have beyond the clearance
STANDING_SHARE = 0.5  # of a pair's distance when standing: its margin if that is the smaller one
BY_NAME, ADJACENT, DISABLED = "excluded by name", "adjacent", "disabled in the SRDF"
EXCLUDED, UNPAIRED = "excluded in the MJCF", "meets only what the MJCF pairs it with"
BY_DESCRIPTION = BY_NAME, ADJACENT, DISABLED, EXCLUDED, UNPAIRED  # reasons that need no postures
Pattern = tuple[str, str]


@dataclass(frozen=True)
class Selection:
    """Pairs of bodies to keep apart."""

    # The given ones, then finer ones for pairs that the simple shapes show too near.
    bodies: tuple[Body, ...]
    pairs: tuple[Pair, ...]  # indices of bodies
    # Margin of each pair [m]: the clearance, or half of its distance when standing if smaller.
    margins: tuple[float, ...]
    # Every other pair of different joints, by its label, and the reason.
    excluded: Mapping[str, str]
    # Pairs with finer shapes, by label, with the distances of these and of the raw shapes.
    finer: Mapping[str, str]


def select_pairs(
    robot: Robot,
    bodies: Sequence[Body],
    *,
    include: Iterable[Pattern] = (),
    exclude: Iterable[Pattern] = (),
    clearance: float = 0.0,
) -> Selection:
    """Return the pairs of bodies that can and may meet.

    Left out, in this order: what ``exclude`` names; pairs of a joint and its parent; those that
    the robot's SRDF disables or its MJCF excludes; those whose raw shapes (meshes as they are)
    touch when standing; those that touch in 95 % of 200 random postures (always the same ones).
    ``include`` brings back whatever it names but ``exclude`` does not, and an MJCF what it lists as
    ``<pair>``. Pairs that only the simple shapes show nearer than
    ``clearance`` and a millimetre, or almost always touching, get finer ones: see
    :mod:`wbc.robot.collision.refine`.

    Parameters
    ----------
    include, exclude:
        Two names or patterns of links each, such as ``("left_wrist*", "torso*")``, in any order.
    clearance:
        Distance to be kept [m].

    Raises
    ------
    UnknownNameError
        A pattern that matches no link.
    InvalidInputError
        What is to be included or excluded is no list of pairs.
    ModelError
        The SRDF cannot be read.
    """
    finite_number("collision pairs, clearance", clearance)
    wanted = _links(bodies, include, "include")
    unwanted = _links(bodies, exclude, "exclude")
    disabled = frozenset[frozenset[str]]()
    if robot.srdf is not None:
        disabled = read_srdf(robot.srdf, robot.model).disabled
    parents, rules = robot.model.parents, robot.geometry.rules
    surfaces = named_surfaces(robot) if rules.watched else []
    shape_of = {one.name: one.described for one in surfaces}
    reasons: dict[Pair, str] = {}
    pairs = [
        (a, b)
        for a in range(len(bodies))
        for b in range(a + 1, len(bodies))
        if bodies[a].joint != bodies[b].joint
    ]
    for a, b in pairs:
        links, joints = (bodies[a].link, bodies[b].link), (bodies[a].joint, bodies[b].joint)
        if frozenset(links) in unwanted:
            reasons[a, b] = BY_NAME
        elif parents[joints[0]] == joints[1] or parents[joints[1]] == joints[0]:
            reasons[a, b] = ADJACENT
        elif frozenset(links) in disabled:
            reasons[a, b] = DISABLED
        elif frozenset(links) in rules.excluded:
            reasons[a, b] = EXCLUDED
        elif rules.paired_only & {shape_of.get(bodies[k].name, "") for k in (a, b)}:
            reasons[a, b] = UNPAIRED
    left = _Candidates(robot, bodies, [pair for pair in pairs if pair not in reasons], clearance)
    touching = left.refine()
    reasons |= left.rejected() | touching
    for (a, b), reason in list(reasons.items()):
        shapes = frozenset(shape_of.get(bodies[k].name, "") for k in (a, b))
        links = bodies[a].link, bodies[b].link
        if reason != BY_NAME and (shapes in rules.watched or frozenset(links) in wanted):
            del reasons[a, b]
    chosen = {pair: left.finer.get(pair) for pair in pairs if pair not in reasons}
    return _selection(bodies, chosen, reasons, clearance)


class _Candidates:
    """Pairs that only their distances can exclude, and finer shapes for some of them."""

    def __init__(
        self, robot: Robot, bodies: Sequence[Body], pairs: list[Pair], clearance: float
    ) -> None:
        self._robot, self._bodies, self._pairs, self._clearance = robot, bodies, pairs, clearance
        self._postures = [robot.snapshot(robot.postures[STANDING])]
        self._postures += [robot.snapshot(q) for q in _postures(robot)] if pairs else []
        # (1 + SAMPLES, pairs), of the posture "standing" first
        self._distance = self._sample_distances(CollisionModel(robot, bodies, pairs))
        self.finer: dict[Pair, FinerPair] = {}

    def _sample_distances(self, model: CollisionModel) -> Array:
        return np.stack([model.nearest(here).distance for here in self._postures])

    def refine(self) -> dict[Pair, str]:
        """Give finer shapes to the pairs that need them; return those that touch, and why."""
        distance, touching = self._distance, dict[Pair, str]()
        finer = list[int]()
        near = (distance[0] < self._clearance + CLEARANCE_RESERVE) | self._almost_always_touching()
        shapes = FinerShapes(self._robot, self._bodies) if near.any() else None
        for k in np.flatnonzero(near).tolist():
            pair = self._pairs[k]
            if shapes is None or not shapes.are_described(pair):
                touching[pair] = f"{distance[0, k] * 1e3:.1f} mm apart when standing"
                continue
            raw = shapes.raw_distance(pair)
            if raw < TOUCHING:
                touching[pair] = "in contact when standing"
                continue
            found = shapes.pair(
                pair, min(self._clearance + CLEARANCE_RESERVE, RESOLVED_SHARE * raw)
            )
            if found.distance < STANDING_SHARE * TOUCHING:
                touching[pair] = f"{raw * 1e3:.1f} mm apart when standing, too near to tell"
                continue
            self.finer[pair] = found
            finer.append(k)
        if finer:
            distance[:, finer] = self._finer_distances([self.finer[self._pairs[k]] for k in finer])
        return touching

    def _finer_distances(self, finer: Sequence[FinerPair]) -> Array:
        """Return the distances (1 + SAMPLES, k) of finer pairs."""
        bodies, pairs, starts = list[Body](), list[Pair](), list[int]()
        for found in finer:
            starts.append(len(pairs))
            pairs += _all_pairs(found, len(bodies))
            bodies += (*found.first, *found.second)
        measured = self._sample_distances(CollisionModel(self._robot, bodies, pairs))
        return np.minimum.reduceat(measured, starts, axis=1)

    def _almost_always_touching(self) -> Bools:
        """Return the mask of pairs that almost always touch in random postures."""
        samples = self._distance[1:]
        return np.count_nonzero(samples < 0.0, axis=0) >= ALMOST_ALWAYS * max(len(samples), 1)

    def rejected(self) -> dict[Pair, str]:
        """Return the pairs that random postures exclude, and why."""
        touches = self._almost_always_touching()
        return {self._pairs[k]: "almost always touching" for k in np.flatnonzero(touches)}


def _all_pairs(finer: FinerPair, start: int) -> list[Pair]:
    """Return each first with each second body of a finer pair, numbered from ``start`` on."""
    middle = start + len(finer.first)
    seconds = range(middle, middle + len(finer.second))
    return [(a, b) for a in range(start, middle) for b in seconds]


def _selection(
    bodies: Sequence[Body],
    chosen: Mapping[Pair, FinerPair | None],
    reasons: Mapping[Pair, str],
    clearance: float,
) -> Selection:
    every, numbers = list(bodies), {}
    pairs, margins, finer = [], [], {}

    def number(body: Body) -> int:
        if body not in numbers:
            numbers[body] = len(every)
            every.append(body)
        return numbers[body]

    def label(pair: Pair) -> str:
        return f"{bodies[pair[0]].name} vs {bodies[pair[1]].name}"

    for pair, found in chosen.items():
        if found is None:
            pairs.append(pair)
            margins.append(clearance)
            continue
        margin = clearance if found.distance >= clearance else STANDING_SHARE * found.distance
        several = [(number(one), number(two)) for one in found.first for two in found.second]
        pairs += several
        margins += [margin] * len(several)
        finer[label(pair)] = (
            f"{len(found.first)} x {len(found.second)} hulls, {found.distance * 1e3:.1f} mm apart"
            f" when standing ({found.raw * 1e3:.1f} mm by their raw shapes)"
            + ("" if margin == clearance else f"; they keep {margin * 1e3:.1f} mm")
        )
    excluded = {label(pair): why for pair, why in reasons.items()}
    return Selection(tuple(every), tuple(pairs), tuple(margins), excluded, finer)


def _postures(robot: Robot) -> list[Array]:
    """Return random postures within the limits (a turn either way where there are none)."""
    rng = np.random.default_rng(SEED)
    limits = robot.limits
    lower, upper = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    neutral = robot.postures["neutral"]
    start = limits.joint_positions(neutral)
    steps = rng.uniform(lower, upper, (SAMPLES, lower.size)) - start
    return [robot.integrate(neutral, np.concatenate((np.zeros(6), step)), 1.0) for step in steps]


def _links(bodies: Sequence[Body], patterns: Iterable[Pattern], what: str) -> set[frozenset[str]]:
    """Return the pairs of links that the patterns name."""
    patterns = tuple(patterns) if isinstance(patterns, Iterable) else (patterns,)
    for pair in patterns:
        if isinstance(pair, str) or not isinstance(pair, Iterable) or len([*pair]) != 2:
            raise InvalidInputError(
                f"collision pairs, {what}: expected a list of two links or patterns each, such as"
                f" [('left_wrist*', 'torso*')], got {pair!r}"
            )
    links = tuple(dict.fromkeys(body.link for body in bodies))
    named = set()
    for first, second in patterns:
        ones, others = matching(first, links, "link"), matching(second, links, "link")
        named |= {frozenset((links[a], links[b])) for a in ones for b in others}
    return named
