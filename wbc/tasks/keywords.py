"""Keywords that tasks hand on to their laws, in words for type checkers, help and messages.

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


class RateKeywords(TypedDict, total=False):
    """What laws say of a task that is about a rate, and has no error."""

    singular_threshold: float
    kd: float | None


class LawKeywords(RateKeywords, total=False):
    """The entries of :class:`~wbc.laws.VelocityLaw` and :class:`~wbc.laws.AccelerationLaw`."""

    gain: float
    gain_per_second: float | None
    lm_damping: float
    curvature_damping: bool
    kp: float


class RateGains(RateKeywords, total=False):
    """Keywords of a task that is about a rate."""

    weight: ArrayLike
    priority: int


class Gains(LawKeywords, total=False):
    """Keywords that every other kind of task hands on to :class:`~wbc.tasks.task.Task`."""

    weight: ArrayLike
    priority: int


_LAWS = (*fields(VelocityLaw), *fields(AccelerationLaw))
FIRST_ORDER = frozenset(field.name for field in fields(VelocityLaw))
SECOND_ORDER = frozenset(field.name for field in fields(AccelerationLaw))
# What acts on the error alone: of no use to tasks that are about a rate.
OF_ERRORS = (FIRST_ORDER | SECOND_ORDER) - RateKeywords.__annotations__.keys()

WEIGHT, PRIORITY = 1.0, 0
DEFAULTS = {"weight": WEIGHT, "priority": PRIORITY} | {one.name: one.default for one in _LAWS}


def spell_out(function: Function) -> Function:
    """Let the signature of a function that takes ``**law: Unpack[...]`` show each keyword.

    Other functions stay as they are.
    """
    signature = inspect.signature(function)
    *shown, last = signature.parameters.values()
    keywords = _unpacked(last, function)
    for name in sorted(keywords, key=[*DEFAULTS, *keywords].index):
        default = DEFAULTS.get(name, inspect.Parameter.empty)
        annotation = getattr(keywords[name], "__forward_arg__", keywords[name])
        kind = inspect.Parameter.KEYWORD_ONLY
        shown.append(inspect.Parameter(name, kind, default=default, annotation=annotation))
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
