"""State estimation: the base's pose and velocity from IMU, encoders and contacts."""

from wbc.estimation.estimate import Estimate
from wbc.estimation.estimator import StateEstimator
from wbc.estimation.measurement import ImuReading, Measurement

__all__ = ["Estimate", "ImuReading", "Measurement", "StateEstimator"]
