"""Which pairs of bodies have to brake first.

Where velocities cannot change at once, these are not the nearest pairs, but those with the least
clearance left once they have stopped.
"""

from __future__ import annotations

import numpy as np

from wbc.robot.collision.closing import Closing
from wbc.robot.collision.model import CollisionModel, PairDistances
from wbc.robot.model import Snapshot
from wbc.validate import Array


def soonest(
    model: CollisionModel, snapshot: Snapshot, count: int, kept: Array, closing: Closing
) -> tuple[PairDistances, Array]:
    """Return the pairs that have to brake first, in order, and what they have left (k,) [m].

    That is their distance, less the one to keep (``kept``, (N,)), less the one that stopping takes.
    Returned are the ``count`` pairs with the least, and all with less than nothing.
    """
    total = len(model.pairs)
    asked = count = min(count, total)
    twists = model.twists(snapshot)
    while True:
        found = model.native.soonest(snapshot.native_state, asked, kept, twists, closing)
        if asked == total or (found is not None and found.complete):
            break
        asked = min(2 * asked, total)
    if found is None:  # all pairs are inside each other
        every = model.measure(snapshot, np.arange(total))
        return every, every.distance - kept
    distances, left = model.filled_in(snapshot, found.pairs, found.nearest), found.left
    unknown = left == -np.inf
    left[unknown] = (distances.distance - kept.take(found.pairs))[unknown]
    if asked == count:
        return distances, left
    late = np.flatnonzero(left < 0.0)
    return distances.take(late), left.take(late)
