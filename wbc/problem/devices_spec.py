"""The section of a problem file about the sensors of a robot whose state is estimated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from wbc.estimation import EstimatorSettings, FilterNoise
from wbc.problem.section import KeysOf, ListOf, Name, Point, Positive, Section, Three
from wbc.simulation import Devices, Encoders, FootSwitches, Imu, MessageBus, MotorTorques

Seed = Annotated[int, Field(ge=0)]
ImuKeys = Annotated[
    dict[str, Any],
    KeysOf(Imu, name=Name, frame=Name, position=Point, rotation=Three[Point], rate=Positive),
]
NoiseKeys = Annotated[dict[str, Any], KeysOf(FilterNoise)]


class DevicesSpec(Section):
    """The sensors of the robot, from which its state is estimated.

    Defaults are those of a common humanoid; see :mod:`wbc.simulation.sensors_devices`.
    """

    imus: ListOf[ImuKeys] = ()
    """Positions and accuracies of IMUs; left out: one at the base."""
    encoders: Annotated[dict[str, Any], KeysOf(Encoders, rates=bool)] = Field(default_factory=dict)
    """Accuracy of the encoders of all joints."""
    torques: Annotated[dict[str, Any], KeysOf(MotorTorques)] | None = Field(default_factory=dict)
    """Torques of the motors; null: not measured. Without foot switches contacts are detected by
    them."""
    feet: Annotated[dict[str, Any], KeysOf(FootSwitches)] | None = None
    """Switches under the soles; {} for defaults; left out: none."""
    bus: Annotated[dict[str, Any], KeysOf(MessageBus)] = Field(default_factory=dict)
    """The bus that carries the robot's messages."""
    seed: Seed = 0
    """Seed of the random numbers."""
    estimator: Annotated[
        dict[str, Any], KeysOf(EstimatorSettings, noise=NoiseKeys, velocity_window=int, history=int)
    ] = Field(default_factory=dict)
    """Noise that the estimator assumes; it knows the encoders' delay."""

    def made(self) -> Devices:
        """Return the sensors. Raises InvalidInputError: numbers that contradict each other."""
        others = {"imus": tuple(Imu(**one) for one in self.imus)} if self.imus else {}
        return Devices(
            **others,
            encoders=Encoders(**self.encoders),
            torques=None if self.torques is None else MotorTorques(**self.torques),
            feet=None if self.feet is None else FootSwitches(**self.feet),
            bus=MessageBus(**self.bus),
            seed=self.seed,
        )

    def settings(self) -> EstimatorSettings:
        """Return the estimator's noise."""
        known: Mapping[str, Any] = {"encoder_delay": Encoders(**self.encoders).delay}
        given = {**known, **self.estimator}
        return EstimatorSettings(**{**given, "noise": FilterNoise(**given.get("noise", {}))})
