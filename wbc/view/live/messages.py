"""Messages between the control process and the page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from wbc.constraints.friction import FrictionCone
from wbc.robot import Robot
from wbc.robot.collision import Body, Shape
from wbc.simulation.terrain import LEVEL, Terrain
from wbc.validate import Array

# ---------------------------------------------------------------------- to the page


@dataclass(frozen=True, eq=False)
class Setup:
    """Once, before anything else."""

    robot: Robot
    title: str
    clock: bool  # whether the loop can be paused, stepped, slowed down and begun again
    steer: bool  # whether targets and weights can be changed
    push: float = 0.0  # the largest push that is offered [N s]; 0: the robot cannot be pushed
    terrain: Terrain = LEVEL  # what the robot stands on
    beside: Robot | None = None  # another one that is shown, as the human that it moves like


class TaskInfo(NamedTuple):
    """A task, for the page."""

    name: str
    kind: str  # com, position, orientation, pose, axis, inertia, principal or other
    frame: str  # the frame it moves, or in whose axes its inertia is
    rows: tuple[str, ...]
    units: tuple[str, ...]  # of the entries of its error


class PullForce(NamedTuple):
    """The pull on the robot now: a force (3,) [N] at a point (3,) [m] of a frame, world axes."""

    frame: str
    point: Array
    force: Array


class ContactInfo(NamedTuple):
    """A contact; ``friction`` is None if it has no cone."""

    frame: str
    friction: FrictionCone | None


class PairsInfo(NamedTuple):
    """The bodies that a constraint keeps apart."""

    name: str
    bodies: tuple[Body, ...]
    pairs: tuple[tuple[int, int], ...]  # N pairs of indices of bodies
    margins: Array  # (N,) distance that each pair keeps [m]
    # Names and shapes of the last bodies, which are not attached to the robot.
    obstacles: tuple[tuple[str, Shape], ...]


@dataclass(frozen=True, eq=False)
class ControllerInfo:
    """Tasks, contacts and constraints; sent again whenever these change."""

    dt: float
    tasks: tuple[TaskInfo, ...]
    contacts: tuple[ContactInfo, ...]
    pairs: tuple[PairsInfo, ...]


@dataclass(frozen=True, eq=False)
class TickInfo:
    """Results of a tick."""

    ok: bool
    report: str
    seconds: float  # the tick's time, of which solve was spent in the solver; None: not recorded
    errors: Mapping[str, Array]
    solve: float | None = None
    step_scale: float = 1.0
    # Rows that hold the command back, the strongest first; None: not recorded.
    active: tuple[str, ...] | None = None
    # Joints at a bound of their velocity (their range, with braking distance, or their rate),
    # with lower or upper.
    at_limit: tuple[str, ...] | None = None
    relaxed: Mapping[str, float] = field(default_factory=dict)  # what gave way, and by how much
    # (6,) wrench at each contact's frame, world axes, by contact; empty at the velocity level.
    forces: Mapping[str, Array] = field(default_factory=dict)
    acceleration: Array | None = None  # (nv,), or None at the velocity level
    # (6,) known from outside, at frames' origins, world axes, by frame.
    wrenches: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Frame:
    """The robot at one instant."""

    time: float  # [s]
    q: Array
    v: Array
    told: TickInfo | None = None
    # Target of each task, by name: position; rotation; position and rotation; direction; inertia
    # xx xy xz yy yz zz or principal moments [kg m^2].
    targets: Mapping[str, tuple[Array, ...]] = field(default_factory=dict)
    # Rotation and origin of each obstacle, by its name.
    obstacles: Mapping[str, tuple[Array, Array]] = field(default_factory=dict)
    phase: str = ""
    remark: str = ""  # what the user should know, such as why the loop ended
    playing: bool = True
    # (3,) force that pushes the robot now [N], world axes; None where nothing can.
    push: Array | None = None
    pull: PullForce | None = None  # what the user pulls at, and how; None while nobody does
    beside: Array | None = None  # configuration of the one beside


@dataclass(frozen=True, eq=False)
class WholeRun:
    """A whole run, replacing the frames sent while it ran."""

    frames: tuple[Frame, ...]


# ---------------------------------------------------------------------- from the page

PUSH_DURATION = 0.1  # s: of a push from the page


class SetTarget(NamedTuple):
    """Give a task another target, in the form of :attr:`Frame.targets`."""

    task: str
    target: tuple[Array, ...]


class SetWeight(NamedTuple):
    """Multiply a task's weight by a factor."""

    task: str
    factor: float


class Release(NamedTuple):
    """Restore all targets and weights that the page has changed."""


class Play(NamedTuple):
    """Continue, or pause."""

    playing: bool


class StepRequest(NamedTuple):
    """Do one tick, and pause."""


class Speed(NamedTuple):
    """Run this many times as fast as real time; 0: as fast as can be."""

    factor: float


class Restart(NamedTuple):
    """Start the run again."""


class PushRobot(NamedTuple):
    """Push the robot at its CoM, by an impulse (3,) [N s] in world axes."""

    impulse: Array


class PullRobot(NamedTuple):
    """Pull a point of the robot by a spring from now on, until :class:`ReleasePull`."""

    # frame and point: what is pulled: (3,) in the frame's axes from its origin [m].
    frame: str
    point: Array
    target: Array  # where it is pulled to (3,) [m], world axes
    stiffness: float  # [N/m]


class ReleasePull(NamedTuple):
    """End a pull."""


TaskRequest = SetTarget | SetWeight | Release  # the others are for the loop
Request = TaskRequest | PushRobot | PullRobot | ReleasePull | Play | StepRequest | Speed | Restart
