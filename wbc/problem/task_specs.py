"""Tasks as a problem file describes them, one section per type."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, Strict

from wbc.problem.section import (
    LIST,
    WORD,
    Distinct,
    Fraction,
    Name,
    NonNegative,
    Number,
    OneOf,
    Point,
    Positive,
    Section,
    Weight,
    forms,
)
from wbc.problem.target_specs import (
    ComTarget,
    DirectionTarget,
    InertiaTarget,
    PointTarget,
    PoseTarget,
    PostureTarget,
    RotationTarget,
)

Axis = Literal["x", "y", "z"]
Axes = Annotated[tuple[Axis, ...], Strict(False), Field(min_length=1), Distinct]
Entry = Literal["xx", "xy", "xz", "yy", "yz", "zz"]
MomentumRow = Literal["lx", "ly", "lz", "kx", "ky", "kz"]
ALL_AXES: tuple[Axis, ...] = ("x", "y", "z")

InertiaComponents = Annotated[
    Annotated[Literal["all", "diagonal", "trace", "principal"], WORD]
    | Annotated[tuple[Entry, ...], Strict(False), Field(min_length=1), Distinct, LIST],
    forms("all, diagonal, trace, principal, or a list of xx xy xz yy yz zz"),
]
MomentumComponents = Annotated[
    Annotated[Literal["all", "linear", "angular"], WORD]
    | Annotated[tuple[MomentumRow, ...], Strict(False), Field(min_length=1), Distinct, LIST],
    forms("all, linear, angular, or a list of lx ly lz kx ky kz"),
]


class _Ranked(Section):
    """What all tasks have in common."""

    priority: int = Field(default=0, ge=0, le=9)
    """Strict level, 0 the most important: a level never gives way to a later one."""
    singular_threshold: NonNegative = 0.0
    """Singular values of the Jacobian below this are singular, counting the motions that contacts
    and earlier levels leave [unit of the error/s per rad/s]: the task asks for less in their
    directions, so that joints need not race. 0: never."""
    active: bool = True
    """false: the task is off, until a phase puts it to use."""


class _Settled(_Ranked):
    """What tasks with an error to remove have in common."""

    gain: Fraction = 0.5
    """Fraction of the error to remove in one tick, in (0, 1]."""
    lm_damping: NonNegative = 0.0
    """Levenberg-Marquardt damping: steadies a task whose target cannot be reached."""


class InertiaSpec(_Settled):
    """The robot's centroidal (composite-rigid-body) inertia: size and shape of the whole robot."""

    type: Literal["inertia"]
    components: InertiaComponents = "all"
    """Which entries of the matrix: all six, the diagonal, the trace, the principal moments, or a
    list of entries."""
    frame: Name = "world"
    """Whose axes: world, base (the joints alone then decide) or any frame of the robot."""
    target: InertiaTarget
    """Wanted inertia [kg m^2], or {scale: ...} of the one at the start."""
    weight: Weight = 1.0
    """Weight of the task, one number or one per row [1/(kg m^2/s)]."""
    per_mass: bool = False
    """Divide the error by the robot's mass, so that a weight means the same on every robot."""
    second_order: bool = False
    """Use the curvature of the inertia: for a target out of reach, where it converges much faster
    (about 0.2 ms more per tick). Not for principal moments."""
    ramp: Positive | None = None
    """Time [s] in which the target moves smoothly from the inertia at the start."""


class ComSpec(_Settled):
    """The centre of mass."""

    type: Literal["com"]
    axes: Axes = ALL_AXES
    """Which world axes are controlled."""
    target: ComTarget
    """Wanted place [m], world axes; {over: left} puts it above a foot."""
    weight: Weight = 1.0
    """Weight of the task, one number or one per axis [1/(m/s)]."""
    ramp: Positive | None = None
    """Time [s] in which the target moves smoothly from the place at the start."""


class _FrameSpec(_Settled):
    type: Literal["frame"]
    frame: Name
    """A link, joint or other frame of the robot."""
    weight: Weight = 1.0
    """Weight of the task, one number or one per row [1/(m/s)] or [1/(rad/s)]."""


class PositionSpec(_FrameSpec):
    """The position of a frame's origin."""

    control: Literal["position"]
    axes: Axes = ALL_AXES
    """Which world axes are controlled."""
    target: PointTarget
    """Wanted place [m], world axes."""
    ramp: Positive | None = None
    """Time [s] in which the target moves smoothly from the place at the start."""


class OrientationSpec(_FrameSpec):
    """The orientation of a frame."""

    control: Literal["orientation"]
    target: RotationTarget
    """Wanted orientation."""


class PoseSpec(_FrameSpec):
    """Position and orientation of a frame at once."""

    control: Literal["pose"]
    target: PoseTarget
    """Wanted position and orientation."""


class AxisSpec(_FrameSpec):
    """The direction in which one axis of a frame points; it may turn about that axis."""

    control: Literal["axis"]
    axis: Point = (0.0, 0.0, 1.0)
    """The axis, in the frame's own axes."""
    target: DirectionTarget
    """Wanted direction, world axes; its length does not matter."""


class PostureSpec(_Settled):
    """The joints: at a low weight, where to be as far as the other tasks leave it open."""

    type: Literal["posture"]
    target: PostureTarget = "start"
    """A posture of the robot by name, or joint values [rad or m] by name or pattern; joints that
    are not named keep the value at the start."""
    joints: dict[Name, NonNegative] = Field(default_factory=dict)
    """Factors on the weight by joint name or pattern ("*_knee*"); 0 leaves a joint out."""
    weight: NonNegative = 1.0
    """Weight of the task [1/(rad/s)]."""


class MomentumSpec(_Ranked):
    """Centroidal momentum; a rate already, so there is no error to remove by a gain."""

    type: Literal["momentum"]
    components: MomentumComponents = "all"
    """linear (lx ly lz), angular about the centre of mass (kx ky kz), all, or a list of these."""
    target: Annotated[tuple[Number, ...], Strict(False), Field(min_length=1, max_length=6)] = (
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
    )
    """Wanted momentum, linear [kg m/s] then angular [kg m^2/s], world axes: six numbers, or one for
    each component."""
    weight: Weight = 1.0
    """Weight of the task, one number or one per row [1/(kg m/s)] or [1/(kg m^2/s)]."""


FrameSpec = Annotated[
    PositionSpec | OrientationSpec | PoseSpec | AxisSpec,
    OneOf("control", "{type: frame, frame: left_hand, control: position, target: start}"),
]
TaskSpec = Annotated[
    InertiaSpec | ComSpec | FrameSpec | PostureSpec | MomentumSpec,
    OneOf("type", "{type: com, target: [0, 0, 0.3]}"),
]
