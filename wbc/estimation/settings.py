"""Settings of an estimator: its sensors' noise and delays, and criteria of contact."""

from __future__ import annotations

from dataclasses import dataclass, field

from wbc.estimation.contact_filter import FilterNoise
from wbc.kinds import check_kind, whole_number
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
        Of the IMU, and of feet in contact.
    encoder_deviation:
        Standard deviation of a joint's position [rad or m].
    place_floor, turn_floor:
        Standard deviations of a foot's place besides the encoders': soft ground, flexible links
        [m], [rad].
    encoder_delay:
        Age of joint positions relative to the IMU reading of the same message [s]; they are
        predicted over it by their velocities.
    velocity_window:
        Number of readings in the filter of joint velocities, where these are not measured; see
        :class:`~wbc.estimation.joint_velocity.JointVelocityFilter`.
    standing_time:
        Duration of standing still for the initialisation [s].
    gyroscope_bias, accelerometer_bias:
        Standard deviations of the biases then [rad/s], [m/s^2].
    load:
        A foot bears from the larger share of the robot's weight on, until the smaller (hysteresis):
        by measured forces.
    estimated_load:
        The same by forces estimated from torques, which are less certain.
    bandwidth:
        Of the momentum observer [1/s].
    settle:
        How long a foot bears before it becomes a contact [s], after its impact.
    still:
        Largest speed of a foot that becomes a contact [m/s].
    slides:
        A contact that is faster than this [m/s] for ``sliding`` [s] slips, and is removed before
        the estimate follows it.
    sliding:
        See above.
    apart:
        Largest change of the distance of two contacts [m]; beyond it the one that was faster of
        late slips.
    lost:
        Time without contacts after which the slowest foot that bears becomes one at any speed [s].
    timeout:
        Time without readings after which an IMU counts as dead, and another takes over [s].
    history:
        Number of the last messages that are kept; one that is older than these is dropped.
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
        check_kind("estimator, noise", self.noise, FilterNoise, "FilterNoise(creep=0.002)")
        check_fields(self, what, *POSITIVE, above=0.0)
        check_fields(self, what, "encoder_delay", "settle", "sliding", "timeout", least=0.0)
        shares = {key: interval(f"estimator {key}", getattr(self, key)) for key in LOADS}
        set_fields(self, **shares)
        for key, least in (("velocity_window", 2), ("history", 0)):
            count = whole_number(f"estimator, {key}", getattr(self, key), least=least)
            set_fields(self, **{key: count})
