"""Typed errors. Each says what is wrong, where and what to do; the root is :class:`WbcError`."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence


class WbcError(Exception):
    """Root of every error this package raises on purpose."""


class ModelError(WbcError):
    """A robot description cannot be read, or holds something the controller cannot support."""


class InvalidInputError(WbcError):
    """A number, array or option given by the caller is unusable: NaN, wrong size, out of range."""


class ProblemFileError(WbcError):
    """A problem file is not valid: the message names the file, the line and the key path."""


class SolverError(WbcError):
    """A QP backend is missing, refused its input, or reports what its solution contradicts."""


class MissingPackageError(WbcError):
    """An optional package is not installed; the message says how to install it."""


class ControllerFailure(WbcError):
    """A tick produced no usable command and the declared policy is ``raise``.

    The failed tick is the attribute ``tick``, with the evidence.
    """

    def __init__(self, message: str, tick: object) -> None:
        super().__init__(message)
        self.tick = tick


class UnknownNameError(WbcError):
    """A name (robot, joint, frame, task, solver, ...) does not exist.

    Parameters
    ----------
    kind:
        What the name should have been, for instance ``"joint"``.
    name:
        The name that was given.
    choices:
        The names that exist; the nearest is suggested, and all are listed when they are few.
    remedy:
        What to do about it, if that is not to take one of the choices.
    """

    def __init__(self, kind: str, name: str, choices: Iterable[str], remedy: str = "") -> None:
        self.kind, self.name, self.choices = kind, name, tuple(choices)
        tail = f"; {remedy}" if remedy else suggest(name, self.choices)
        given = repr(name) if isinstance(name, str) else shown(name)  # a path is told whole
        super().__init__(f"unknown {kind} {given}{tail}")


# Names of Pink and mink, in lower case, and those of this package; a task has axes or components.
_ELSEWHERE = {
    "axes": "components",
    "components": "axes",
    "configuration": "Snapshot",
    "cost": "weight",
    "dq": "velocity",
    "frametask": "PoseTask",
    "orientation_cost": "weight",
    "position_cost": "weight",
    "relativeframetask": "RelativePoseTask",
    "solve": "step",
    "solve_ik": "KinematicController",
    "tau": "torque",
    "v": "velocity",
}


def nearest(name: str, choices: Iterable[str]) -> str | None:
    """Return the valid name that a wrong one is most like, or None if it is like none."""
    folded = {choice.casefold(): choice for choice in choices}
    meant = _ELSEWHERE.get(str(name).casefold(), "").casefold()
    if meant in folded:
        return folded[meant]
    alike = [(_similarity(str(name).casefold(), choice), choice) for choice in folded]
    likeness, found = max(alike, default=(0.0, ""))
    return folded[found] if likeness >= 0.5 else None


def suggest(name: str, choices: Iterable[str], listed: int = 40) -> str:
    """Return the tail of an error message: the nearest valid name and the list of choices."""
    known = sorted(str(choice) for choice in choices)
    meant = nearest(name, known)
    hint = f"; did you mean {meant!r}?" if meant is not None else ""
    if not known:
        return f"{hint} (there are none to choose from)"
    if not listed:
        return hint
    first = ", ".join(known[:listed])
    more = f", and {len(known) - listed} more" if len(known) > listed else ""
    return f"{hint} (choose from: {first}{more})"


def no_attribute(owner: str, name: str, known: Iterable[str], hint: str = "") -> AttributeError:
    """Return the error for a name that ``owner`` does not have, with the nearest of those known."""
    if not (hint or name.startswith("_")):
        hint = suggest(name, [one for one in known if not one.startswith("_")], listed=0)
    what = f"{owner} has no attribute {name!r}{hint}"
    return AttributeError(what, name=name, obj=None)  # or Python adds a hint of its own


def shown(value: object, most: int = 60) -> str:
    """Return how a value is written in Python, on one line and shortened, for a message."""
    text = " ".join(repr(value).split())
    return text if len(text) <= most else f"{text[: most - 3]}..."


def listed(names: Sequence[str], most: int = 5) -> str:
    """Return the first names, and how many more there are, for a message."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def _similarity(name: str, choice: str) -> float:
    """Return the similarity of two names, 0 to 1; a long prefix of a choice counts as nearly 1."""
    whole = difflib.SequenceMatcher(None, choice, name).ratio()
    if len(name) < 5 or len(choice) <= len(name) + 1:
        return whole
    beginning = difflib.SequenceMatcher(None, choice[: len(name) + 1], name).ratio()
    return max(whole, 0.9 * beginning)
