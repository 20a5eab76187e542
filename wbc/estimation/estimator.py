"""The base's state from IMU, encoders and contacts: one update per message."""

from __future__ import annotations

from wbc.estimation.estimate import Estimate
from wbc.estimation.measurement import Measurement
from wbc.robot import Robot
from wbc.validate import Array


class StateEstimator:
    """Estimates the base of a robot from its sensors; see the page *Estimate*.

    Before it can answer, the robot stands still for a moment (``standing_time``): ``update``
    returns None until then. :meth:`reset` begins anew, with a known configuration if one is given.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot

    def reset(self, q: Array | None = None, time: float = 0.0) -> None:
        """Forget everything; stand at ``q`` (nq,), or by the encoders on level ground."""
        raise NotImplementedError

    def update(self, measurement: Measurement) -> Estimate | None:
        """Take in a message; return the estimate at its time, None while standing to begin.

        A message that comes late is filed where it belongs, and what followed is taken in again.
        """
        raise NotImplementedError
