"""What an estimator counts on: its sensors' noise, delays, and when a foot is believed to stand."""

from __future__ import annotations

from dataclasses import dataclass, field

from wbc.estimation.contact_filter import FilterNoise
from wbc.kinds import whole_number
from wbc.validate import check_fields, interval, set_fields

POSITIVE = (
    *("encoder_deviation", "place_floor", "turn_floor", "standing_time", "gyroscope_bias"),
    *("accelerometer_bias", "still", "slides", "apart", "lost", "bandwidth"),
)
LOADS = ("load", "estimated_load")


@dataclass(frozen=True)
class EstimatorSettings:
    """Settings of a :class:`~wbc.estimation.StateEstimator`.

    Attributes
    ----------
    noise:
        Of the IMU, and of feet that stand.
    encoder_deviation:
        Standard deviation of a joint's position [rad or m].
    place_floor, turn_floor:
        Of a foot's place beside the encoders': soft ground, links that bend [m], [rad].
    encoder_delay:
        How old joint positions are when an IMU reading of the same message is new [s]; they are
        predicted over it by their velocities.
    velocity_window:
        Readings in the filter of joint velocities, where these are not measured; see
        :class:`~wbc.estimation.joint_velocity.JointVelocityFilter`.
    standing_time:
        How long it stands still in the beginning [s].
    gyroscope_bias, accelerometer_bias:
        Standard deviations of the biases then [rad/s], [m/s^2].
    load:
        A foot bears from the greater share of the robot's weight on, until the lesser: by measured
        forces.
    estimated_load:
        The same by forces estimated from torques, which are less sure.
    bandwidth:
        Of the momentum observer [1/s].
    settle:
        How long a foot bears before it is counted on to stand [s]: it lands with a blow.
    still:
        Largest speed of a foot that is counted on from now on [m/s].
    slides:
        A foot that is counted on, and faster than this [m/s] for ``sliding`` [s], slips: at its
        first, before the estimate follows it.
    sliding:
        See above.
    apart:
        By how much two feet that are counted on may come nearer to each other, or farther [m]:
        beyond it the one that moved faster of late slips.
    lost:
        After how long without any foot the slowest that bears is counted on whatever its speed [s].
    timeout:
        After how long without readings an IMU counts as dead, and another takes over [s].
    history:
        For how many messages one may be late; an older one is dropped.
    """

    noise: FilterNoise = field(default_factory=FilterNoise)
    encoder_deviation: float = 2.0e-4
    place_floor: float = 5.0e-4
    turn_floor: float = 1.0e-3
    encoder_delay: float = 0.0
    velocity_window: int = 5
    standing_time: float = 0.5
    gyroscope_bias: float = 0.02
    accelerometer_bias: float = 0.05
    load: tuple[float, float] = (0.04, 0.1)
    estimated_load: tuple[float, float] = (0.15, 0.25)
    bandwidth: float = 150.0
    settle: float = 0.01
    still: float = 0.1
    slides: float = 0.12
    sliding: float = 0.01
    apart: float = 4.0e-3
    lost: float = 0.1
    timeout: float = 0.05
    history: int = 25

    def __post_init__(self) -> None:
        what = "estimator, "
        check_fields(self, what, *POSITIVE, above=0.0)
        check_fields(self, what, "encoder_delay", "settle", "sliding", "timeout", least=0.0)
        shares = {key: interval(f"estimator {key}", getattr(self, key)) for key in LOADS}
        set_fields(self, **shares)
        for key, least in (("velocity_window", 2), ("history", 0)):
            count = whole_number(f"estimator, {key}", getattr(self, key), least=least)
            set_fields(self, **{key: count})
