"""Recorded motion: read, resampled, filtered, and reduced to its pendulum."""

from wbc.motion.analysis import analyze
from wbc.motion.columns import UnknownColumnError
from wbc.motion.dropouts import Dropout
from wbc.motion.noise import Noise
from wbc.motion.recording import Motion, read_motion
from wbc.motion.series import RmpSeries, Uncertainty
from wbc.motion.table import RecordingError

analyse = analyze  # its name until 0.2

__all__ = [
    "Dropout",
    "Motion",
    "Noise",
    "RecordingError",
    "RmpSeries",
    "Uncertainty",
    "UnknownColumnError",
    "analyze",
    "read_motion",
]
