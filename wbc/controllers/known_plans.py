"""Plans that were made before: a walk that comes back to its contacts needs no new one.

Making one takes a millisecond, in a loop of two; coming back to it, a twentieth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from wbc.constraints.contact import Contact, PointContact
from wbc.constraints.mechanics import Mechanics
from wbc.controllers.blocks import planned_as
from wbc.tasks.task import Task

MOST_KNOWN = 8  # sets of contacts; a walk has four, in both orders while forces ramp
Key = tuple[object, ...]


class KnownPlans:
    """What a controller planned for its last sets of contacts, as its attributes.

    A plan reads where its contacts are anchored in each tick, so that it serves the same objects
    elsewhere. Not so those on one link, or along a line: which rows they have depends on that.
    """

    def __init__(self) -> None:
        self._known: dict[Key, tuple[Sequence[Task], Mapping[str, Any]]] = {}

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), ()  # a copy plans anew: its contacts may be others

    def find(
        self, contacts: Sequence[Task], leaving: Mapping[str, float]
    ) -> Mapping[str, Any] | None:
        """Return the attributes for these contacts, those ``leaving`` with slack among them."""
        key = _key(contacts, leaving)
        found = self._known.pop(key, None)
        if found is None:
            return None
        self._known[key] = found  # the last to be forgotten
        return found[1]

    def keep(
        self, contacts: Sequence[Task], leaving: Mapping[str, float], planned: Mapping[str, Any]
    ) -> None:
        """Remember a plan, and forget the one that was not used for longest."""
        own = _own(contacts)
        if not all(type(one) in (Contact, PointContact) for one in own):
            return
        links = {one.robot.frame(one.frame).parentJoint for one in own}  # type: ignore[attr-defined]
        if len(links) < len(own):
            return
        key = _key(contacts, leaving)
        self._known.pop(key, None)
        while len(self._known) >= MOST_KNOWN:
            del self._known[next(iter(self._known))]
        self._known[key] = own, planned  # contacts are kept, as their ids are in the key


def _own(contacts: Sequence[Task]) -> list[Task]:
    return [one for one in contacts if not isinstance(one, Mechanics)]


def _key(contacts: Sequence[Task], leaving: Mapping[str, float]) -> Key:
    return *((id(one), planned_as(one)) for one in _own(contacts)), *leaving.items()
