"""Keywords that tasks pass on to their laws, typed for type checkers, help and messages.

A task takes them as ``**law: Unpack[Gains]``: their names, types and defaults are written here and
in :mod:`wbc.laws`, once for all tasks. Type checkers and editors show each of them; what
:func:`inspect.signature` and ``help`` show is made by :func:`spell_out`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import fields
from typing import Any, TypedDict, TypeVar, Unpack, get_args, get_origin

from numpy.typing import ArrayLike

from wbc.laws import AccelerationLaw, VelocityLaw

Function = TypeVar("Function", bound=Callable[..., Any])


class ErrorKeywords(TypedDict, total=False):
    """Gains on an error; not for tasks that control a rate."""

    gain: float
    gain_per_second: float | None
    lm_damping: float
    curvature_damping: bool
    weighs_error: bool
    kp: float


class RateKeywords(TypedDict, total=False):
    """Gains on a rate."""

    kd: float | None
    singular_threshold: float


class LawKeywords(ErrorKeywords, RateKeywords, total=False):
    """The entries of :class:`~wbc.laws.VelocityLaw` and :class:`~wbc.laws.AccelerationLaw`."""


class Importance(TypedDict, total=False):
    """How tasks are weighed against each other."""

    weight: ArrayLike
    priority: int


class RateGains(Importance, RateKeywords, total=False):
    """Keywords of a task that controls a rate."""


class Gains(Importance, LawKeywords, total=False):
    """Keywords that every other kind of task hands on to :class:`~wbc.tasks.task.Task`."""


FIRST_ORDER = frozenset(field.name for field in fields(VelocityLaw))
SECOND_ORDER = frozenset(field.name for field in fields(AccelerationLaw))
ERROR_ONLY = frozenset(ErrorKeywords.__annotations__)

WEIGHT, PRIORITY = 1.0, 0
# Defaults of all keywords.
DEFAULTS = {"weight": WEIGHT, "priority": PRIORITY} | {
    field.name: field.default for law in (VelocityLaw, AccelerationLaw) for field in fields(law)
}


def spell_out(function: Function) -> Function:
    """Let the signature of a function that takes ``**law: Unpack[...]`` show each keyword.

    Other functions stay as they are.
    """
    signature = inspect.signature(function)
    *shown, last = signature.parameters.values()
    keywords = _unpacked(last, function)
    for name, annotation in keywords.items():
        default = DEFAULTS.get(name, inspect.Parameter.empty)
        written = getattr(annotation, "__forward_arg__", annotation)
        kind = inspect.Parameter.KEYWORD_ONLY
        shown.append(inspect.Parameter(name, kind, default=default, annotation=written))
    if keywords:
        function.__signature__ = signature.replace(parameters=shown)  # type: ignore[attr-defined]
    return function


def _unpacked(parameter: inspect.Parameter, function: Callable[..., Any]) -> dict[str, Any]:
    """Return the types by keyword that a parameter such as ``**law: Unpack[Gains]`` stands for."""
    given = parameter.annotation
    if parameter.kind is not parameter.VAR_KEYWORD:
        return {}
    if isinstance(given, str) and "Unpack" in given:
        try:
            given = eval(given, function.__globals__)
        except NameError:  # known to type checkers alone
            return {}
    if get_origin(given) is not Unpack:
        return {}
    (keywords,) = get_args(given)
    return dict(keywords.__annotations__)
