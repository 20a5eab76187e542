"""Keywords that tasks hand on to their laws, in words for type checkers and for messages."""

from __future__ import annotations

from dataclasses import fields
from typing import TypedDict

from numpy.typing import ArrayLike

from wbc.laws import AccelerationLaw, VelocityLaw


class LawKeywords(TypedDict, total=False):
    """The entries of :class:`~wbc.laws.VelocityLaw` and :class:`~wbc.laws.AccelerationLaw`."""

    gain: float
    gain_per_second: float | None
    lm_damping: float
    singular_threshold: float
    curvature_damping: bool
    kp: float
    kd: float | None


class Gains(LawKeywords, total=False):
    """Keywords that every kind of task hands on to :class:`~wbc.tasks.task.Task`."""

    weight: ArrayLike
    priority: int


FIRST_ORDER = frozenset(field.name for field in fields(VelocityLaw))
SECOND_ORDER = frozenset(field.name for field in fields(AccelerationLaw))
# What acts on the error alone: of no use to tasks that are about a rate.
OF_ERRORS = frozenset(("gain", "gain_per_second", "lm_damping", "curvature_damping", "kp"))
