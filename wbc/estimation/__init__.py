"""State estimation: the base's pose and velocity from IMUs, encoders and contacts."""

from wbc.estimation.contact_filter import ContactFilter, FilterNoise
from wbc.estimation.estimate import Estimate
from wbc.estimation.estimator import StateEstimator
from wbc.estimation.joint_velocity import JointVelocityFilter
from wbc.estimation.measurement import ImuMount, ImuReading, Measurement
from wbc.estimation.momentum_observer import MomentumObserver
from wbc.estimation.settings import EstimatorSettings

__all__ = [
    "ContactFilter",
    "Estimate",
    "EstimatorSettings",
    "FilterNoise",
    "ImuMount",
    "ImuReading",
    "JointVelocityFilter",
    "Measurement",
    "MomentumObserver",
    "StateEstimator",
]
