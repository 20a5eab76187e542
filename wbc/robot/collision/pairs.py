"""Which pairs of a robot's bodies are worth keeping apart, and why the others are not."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wbc.errors import ModelError
from wbc.robot.collision.model import CollisionModel
from wbc.robot.collision.shapes import Body
from wbc.robot.formats.xml import read_xml
from wbc.robot.model import Robot
from wbc.robot.names import matching
from wbc.robot.postures import STANDING
from wbc.validate import Array, finite_number

SAMPLES = 200  # random postures
ALWAYS = 0.95  # of them: pairs that touch this often cannot be kept apart
SEED = 0
Pattern = tuple[str, str]
Pair = tuple[int, int]


@dataclass(frozen=True)
class Selection:
    """Pairs of bodies to keep apart.

    Attributes
    ----------
    pairs:
        Indices of bodies.
    excluded:
        Every other pair of different joints, by its label, and the reason.
    """

    pairs: tuple[Pair, ...]
    excluded: Mapping[str, str]


def select_pairs(
    robot: Robot,
    bodies: Sequence[Body],
    *,
    include: Iterable[Pattern] = (),
    exclude: Iterable[Pattern] = (),
    clearance: float = 0.0,
    never_closer: float | None = None,
) -> Selection:
    """Return the pairs of bodies that can and may meet.

    Left out, in this order: what ``exclude`` names; pairs of a joint and its parent; those that
    the robot's SRDF disables; those nearer than ``clearance`` when standing; those that touch in
    95 % of 200 random postures (always the same ones); those that never come near. ``include``
    brings back whatever it names but ``exclude`` does not.

    Parameters
    ----------
    include, exclude:
        Two names or patterns of links each, such as ``("left_wrist*", "torso*")``, in any order.
    clearance:
        Distance that the pairs kept have in the posture ``standing`` [m].
    never_closer:
        Leave out pairs that are never nearer than this in the random postures [m]; None: keep.

    Raises
    ------
    UnknownNameError
        A pattern that matches no link.
    ModelError
        The SRDF cannot be read.
    """
    finite_number("collision pairs, clearance", clearance)
    wanted, unwanted = _links(bodies, include), _links(bodies, exclude)
    disabled, parents = _disabled(robot), robot.model.parents
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
            reasons[a, b] = "excluded by name"
        elif parents[joints[0]] == joints[1] or parents[joints[1]] == joints[0]:
            reasons[a, b] = "adjacent"
        elif frozenset(links) in disabled:
            reasons[a, b] = "disabled in the SRDF"
    left = [pair for pair in pairs if pair not in reasons]
    model = CollisionModel(robot, bodies, left)
    for k, reason in _unfit(model, clearance, never_closer).items():
        reasons[left[k]] = reason
    for (a, b), reason in list(reasons.items()):
        if reason != "excluded by name" and frozenset((bodies[a].link, bodies[b].link)) in wanted:
            del reasons[a, b]
    return Selection(
        tuple(pair for pair in pairs if pair not in reasons),
        {f"{bodies[a].name} vs {bodies[b].name}": why for (a, b), why in reasons.items()},
    )


def _unfit(model: CollisionModel, clearance: float, never_closer: float | None) -> dict[int, str]:
    """Return the pairs that postures speak against, and why."""
    if not len(model.pairs):
        return {}
    robot = model.robot
    standing = model.nearest(robot.snapshot(robot.postures[STANDING])).distance
    sampled = np.stack([model.nearest(robot.snapshot(q)).distance for q in _postures(robot)])
    touches = (sampled < 0.0).mean(axis=0) >= ALWAYS
    reasons = dict.fromkeys(np.flatnonzero(touches).tolist(), "almost always touching")
    for k in np.flatnonzero(standing < clearance).tolist():
        reasons[k] = f"{standing[k] * 1e3:.1f} mm apart when standing"
    if never_closer is not None:
        far = np.minimum(sampled.min(axis=0), standing) > never_closer
        reasons.update(dict.fromkeys(np.flatnonzero(far).tolist(), "never near"))
    return reasons


def _postures(robot: Robot) -> list[Array]:
    """Return random postures within the limits (a turn either way where there are none)."""
    rng = np.random.default_rng(SEED)
    limits = robot.limits
    lower, upper = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    neutral = robot.postures["neutral"]
    start = limits.joint_positions(neutral)
    steps = rng.uniform(lower, upper, (SAMPLES, lower.size)) - start
    base = np.zeros(6)
    return [robot.integrate(neutral, np.concatenate((base, step)), 1.0) for step in steps]


def _links(bodies: Sequence[Body], patterns: Iterable[Pattern]) -> set[frozenset[str]]:
    """Return the pairs of links that the patterns name."""
    links = tuple(dict.fromkeys(body.link for body in bodies))
    named = set()
    for first, second in patterns:
        ones, others = matching(first, links, "link"), matching(second, links, "link")
        named |= {frozenset((links[a], links[b])) for a in ones for b in others}
    return named


def _disabled(robot: Robot) -> set[frozenset[str]]:
    """Return the pairs of links that the SRDF's ``disable_collisions`` elements name."""
    if robot.srdf is None:
        return set()
    named = set()
    for element in read_xml(robot.srdf).findall("disable_collisions"):
        links = element.get("link1"), element.get("link2")
        if None in links:
            raise ModelError(f"{robot.srdf}: <disable_collisions> without link1 or link2")
        named.add(frozenset(str(link) for link in links))
    return named
