"""Contacts that tasks about forces name: each must be one, at some time."""

from __future__ import annotations

from collections.abc import Sequence

from wbc.errors import UnknownNameError
from wbc.problem.mistakes import Mistakes
from wbc.problem.spec import ProblemSpec
from wbc.robot import Snapshot
from wbc.run.phases import Phase


def check_borne(
    spec: ProblemSpec, phases: Sequence[Phase], start: Snapshot, mistakes: Mistakes
) -> None:
    """Note the frames that a task names as contacts and that are none whenever it is in use.

    In phases in which some of them are contacts, the task rests as to the others: a foot in the air
    bears nothing.
    """
    held = [{contact.frame for contact in phase.hold(start)} for phase in phases]
    for name, task in spec.tasks.items():
        used = [k for k, phase in enumerate(phases) if phase.changes[name].weight is not None]
        known = set[str]().union(*(held[k] for k in used))
        for frame in task.contact_frames if used else ():
            with mistakes.at("tasks", name):
                if frame not in known:
                    held_then = ", ".join(sorted(known)) or "nothing"
                    remedy = f"the support never holds it while the task is on (held: {held_then})"
                    raise UnknownNameError("contact", frame, known, remedy)
