"""Recorded motion: read, made even in time, filtered, and reduced to its pendulum."""

from wbc.motion.analysis import analyse
from wbc.motion.columns import UnknownColumnError
from wbc.motion.dropouts import Dropout
from wbc.motion.recording import Motion, read_motion
from wbc.motion.series import RmpSeries
from wbc.motion.table import RecordingError

__all__ = [
    "Dropout",
    "Motion",
    "RecordingError",
    "RmpSeries",
    "UnknownColumnError",
    "analyse",
    "read_motion",
]
