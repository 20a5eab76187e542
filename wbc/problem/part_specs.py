"""Robot, start, support, limits and stop as a problem file describes them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, Strict

from wbc.problem.section import (
    MAPPING,
    NUMBER,
    WORD,
    Fraction,
    Name,
    Names,
    NonNegative,
    Number,
    Pair,
    Positive,
    PositiveOrInfinite,
    Section,
    forms,
)


class FootSpec(Section):
    """A foot: the link that stands on the ground, and its sole."""

    link: Name
    """The foot's link, or any frame fixed to it."""
    polygon: Annotated[tuple[Pair, ...], Strict(False), Field(min_length=3)] | None = None
    """Corners [x, y] of the sole [m] in that frame; found from the collision shapes if missing."""
    height: Number = 0.0
    """How far the frame's origin is above the sole [m]; used with polygon only."""


class RobotSpec(Section):
    """A robot with settings of its own."""

    model: Name
    """A name that `wbc robots` lists, or a .urdf or .xml file, relative to this file."""
    locked: dict[Name, Number] = Field(default_factory=dict)
    """Joints to hold rigid, by name or pattern, and their values [rad or m]."""
    feet: dict[Name, FootSpec] | None = None
    """The feet by name (left, right, ...); guessed from the names of the links if missing."""
    base: Literal["floating", "fixed"] | None = None
    """fixed: bolted to the world; left out: fixed if nothing stands and the root link is called
    world or base."""
    srdf: Name | None = None
    """File with named postures, relative to this file."""
    package_dirs: Names | None = None
    """Folders to look for package:// meshes in, relative to this file."""


RobotChoice = Annotated[
    Annotated[Name, WORD] | Annotated[RobotSpec, MAPPING],
    forms("a robot's name, a .urdf or .xml file, or {model: ..., locked: ...}"),
]


class StartSpec(Section):
    """Where the robot starts; its lowest sole is set on the ground, z = 0."""

    posture: Name = "standing"
    """A posture of the robot: neutral, standing, or one from its SRDF."""
    joints: dict[Name, Number] = Field(default_factory=dict)
    """Joint values [rad or m] by name or pattern, over those of the posture."""


class LimitsSpec(Section):
    """What joints and base may do; on by default."""

    position: bool = True
    """Keep joints inside the model's position limits."""
    margin: NonNegative = 0.0
    """Distance to keep from them [rad or m]."""
    velocity: Positive | None = 1.0
    """Factor on the model's velocity limits; null: no velocity limit."""
    acceleration: (
        Annotated[
            Annotated[Positive, NUMBER] | Annotated[dict[Name, Positive], MAPPING],
            forms("a number, or {joint or pattern: number}"),
        ]
        | None
    ) = None
    """Largest acceleration [rad/s^2 or m/s^2], one number or by joint name or pattern; where none
    is given, the velocity limit divided by 0.1 s."""
    braking: Annotated[Literal["free", "bounded"], WORD] = "free"
    """free: a joint may stop in one tick; bounded: it slows down by no more than the acceleration,
    except where limits, contacts or margins leave nothing else, and far from their targets tasks
    pull with lower gains, so that they do not overshoot."""
    base_twist: (
        Annotated[tuple[PositiveOrInfinite, ...], Strict(False), Field(min_length=6, max_length=6)]
        | None
    ) = None
    """Largest base velocity in base axes, three linear [m/s] then three angular [rad/s]; .inf: no
    limit."""
    recovery: Fraction = 0.2
    """Fraction of a violation to take back in one tick, in (0, 1]."""


LimitsChoice = Annotated[
    Annotated[Literal["none"], WORD] | Annotated[LimitsSpec, MAPPING],
    forms("none, or keys such as margin: and velocity: (leave limits out for the defaults)"),
]


class StopSpec(Section):
    """When a run ends, and what must hold then."""

    duration: Positive = 20.0
    """Longest time to run [s]."""
    speed: Positive | None = 1e-5
    """The robot is at rest, and the run over, when no velocity is above this [rad/s, m/s] for ten
    ticks in a row; null: always run for the whole duration."""
    accept: dict[Name, Positive] = Field(default_factory=dict)
    """Tolerance on the norm of a task's error at the end, by the task's name."""
