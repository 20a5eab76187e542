"""Global inertia shaping: the globally best posture for the tasks, and a motion that reaches it."""

from wbc.shaping.outcome import (
    Attempt,
    Candidate,
    Motion,
    NoPostureError,
    Rejected,
    ShapingOutcome,
    ShapingStatistics,
    Stopped,
)
from wbc.shaping.shaping import GlobalShaping

__all__ = [
    "Attempt",
    "Candidate",
    "GlobalShaping",
    "Motion",
    "NoPostureError",
    "Rejected",
    "ShapingOutcome",
    "ShapingStatistics",
    "Stopped",
]
