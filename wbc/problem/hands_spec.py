"""Hands that lean on walls: their section in a problem file."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from wbc.controllers import TorqueController
from wbc.gait.hand_states import LeanSettings
from wbc.gait.hand_support import HandSupport
from wbc.gait.walls import Hand, Wall
from wbc.problem.section import Distinct, KeysOf, Names, Point, Positive, Section, Two, default_of
from wbc.robot import Snapshot

WallKeys = Annotated[
    dict[str, Any], KeysOf(Wall, point=Point, normal=Point, size=Two[Positive], friction=Positive)
]


class HandsSpec(Section):
    """What a robot leans on walls with, when soles alone do not catch it."""

    frames: Annotated[Names, Distinct]
    """Links or frames at the ends of arms; each is the middle of a ball."""
    radius: Positive = default_of(Hand, "radius")
    """Of these balls [m]."""
    friction: Positive | None = None
    """Coefficient of friction that hands count on; left out: the controller's."""
    settings: Annotated[dict[str, Any], KeysOf(LeanSettings)] = Field(default_factory=dict)
    """When they reach, how, and when they let go."""

    @property
    def hands(self) -> tuple[Hand, ...]:
        """The hands."""
        return tuple(Hand(frame, self.radius) for frame in self.frames)

    def support(
        self,
        controller: TorqueController,
        start: Snapshot,
        walls: tuple[dict[str, Any], ...],
        friction: float,
    ) -> HandSupport:
        """Return the support by the hands; ``friction`` is that of other contacts.

        Raises WbcError: no walls, no arms, or walls out of reach.
        """
        counted = friction if self.friction is None else self.friction
        made = [Wall(**wall | {"friction": counted}) for wall in walls]
        return HandSupport(controller, start, self.hands, made, LeanSettings(**self.settings))
