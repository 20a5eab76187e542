"""Recorded humans: markers and skeletons read, a body of rigid segments fitted, its pendulum."""

from wbc.human.body import HumanBody
from wbc.human.comparison import Comparison, compared
from wbc.human.files import is_human_recording, read_markers
from wbc.human.markers import ForcePlate, MarkerRecording
from wbc.human.motion_fit import HumanMotion, human_motion
from wbc.human.skeleton import human_robot

__all__ = [
    "Comparison",
    "ForcePlate",
    "HumanBody",
    "HumanMotion",
    "MarkerRecording",
    "compared",
    "human_motion",
    "human_robot",
    "is_human_recording",
    "read_markers",
]
