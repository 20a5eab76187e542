"""Global inertia shaping: search for the best posture for the tasks, and a motion to it."""

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
