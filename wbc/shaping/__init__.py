"""Global inertia shaping: the globally best posture for the tasks, and a motion that reaches it."""

from wbc.shaping.outcome import (
    Attempt,
    Candidate,
    NoPostureError,
    Rejected,
    ShapingMotion,
    ShapingOutcome,
    ShapingStatistics,
    Stopped,
)
from wbc.shaping.shaping import GlobalShaping

__all__ = [
    "Attempt",
    "Candidate",
    "GlobalShaping",
    "NoPostureError",
    "Rejected",
    "ShapingMotion",
    "ShapingOutcome",
    "ShapingStatistics",
    "Stopped",
]
