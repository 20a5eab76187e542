"""Which pairs of bodies have to brake first.

Where velocities cannot change at once, these are not the nearest pairs, but those with the least
clearance left once they have stopped.
"""

from __future__ import annotations

import numpy as np

from wbc.native import lib
from wbc.robot.collision.closing import Closing, PairMotion
from wbc.robot.collision.covers import smallest
from wbc.robot.collision.model import CollisionModel, PairDistances
from wbc.robot.model import Snapshot
from wbc.validate import Array

CANDIDATES = 3  # pairs measured at first for each asked for
EVEN: float = lib.wbc_even  # m: clearances that differ by less are equal


def soonest(
    model: CollisionModel, snapshot: Snapshot, count: int, kept: Array, closing: Closing
) -> tuple[PairDistances, Array]:
    """Return the pairs that have to brake first, in order, and what they have left (k,) [m].

    That is their distance, less the one to keep (``kept``, (N,)), less the one that stopping takes.
    Returned are the ``count`` pairs with the least, and all with less than nothing. Balls round the
    bodies bound distances and closing speeds, and so tell which pairs need to be measured.
    """
    pairs, total = model.pairs, len(model.pairs)
    count = min(count, total)
    twists, placed = model.twists(snapshot), model.covers.placed(snapshot)
    first = pairs[:, 0]
    reach = model.covers.sizes[:, 2]
    speed = PairMotion(twists, pairs).most(placed[2].take(first, axis=1), reach.take(first))
    lower = model.covers.balls(placed)
    lower -= kept
    lower -= closing.way(speed)
    limit = max(0.0, smallest(lower, min(CANDIDATES * count, total)))
    while True:
        found = model.measure(snapshot, np.flatnonzero(lower <= limit))
        motion = PairMotion(twists, pairs.take(found.pairs, axis=0))
        speed = motion.closing(found.normal, found.point)
        left = found.distance - kept.take(found.pairs) - closing.way(speed)
        last = smallest(left, count)
        if last <= limit or len(found.pairs) == total:
            break
        limit = last  # those that were left out may have less
    chosen = left < last - EVEN
    last_ones = np.flatnonzero(~chosen & (left <= last + EVEN))
    chosen[last_ones[: count - np.count_nonzero(chosen)]] = True
    chosen |= left < 0.0
    which = np.flatnonzero(chosen)
    return found.take(which), left.take(which)
