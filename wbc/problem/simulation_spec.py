"""The simulation section of a problem of the torque level: physics, pushes, sensors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from wbc.estimation import StateEstimator
from wbc.gait.walls import Hand, Wall
from wbc.problem.devices_spec import DevicesSpec, Seed
from wbc.problem.hands_spec import WallKeys
from wbc.problem.mistakes import Misplaced, Mistakes
from wbc.problem.section import (
    Forms,
    KeysOf,
    ListOf,
    Name,
    NonNegative,
    Number,
    Pair,
    Point,
    Positive,
    PositiveOrInfinite,
    Section,
    Size,
    Three,
    Words,
    default_of,
)
from wbc.robot import Snapshot
from wbc.rotations import quaternion_from, rotation_from, upright_on
from wbc.simulation import (
    AppliedWrench,
    FallLimits,
    ModelMismatch,
    Plant,
    Push,
    SensedPlant,
    Sensors,
    Step,
    Terrain,
    capture_impulse,
)
from wbc.simulation.push import PROFILES
from wbc.validate import Array

Strength = Annotated[
    Positive | Point, Forms("a number (with angle or direction), or a list [x, y, z]")
]
STRENGTHS = ("force", "impulse", "impulse_ratio")
LEAST_FELT = 0.5  # of the weight, at which an estimator begins: see source/gravity_alignment.c
STEP_TOLERANCE = 1e-6  # in physics steps: tolerance of a time that is a whole number of them
StepKeys = Annotated[
    dict[str, Any],
    KeysOf(Step, centre=Point, size=Three[Size], yaw=Number, friction=NonNegative, slope=Pair),
]


class TerrainSpec(Section):
    """The ground."""

    slope: Pair = default_of(Terrain, "slope")
    """Rise over run along x and y. The robot, and with it everything that is relative to its
    start, is turned with the ground, so that its soles are flat on it."""
    steps: ListOf[StepKeys] = ()
    """Boxes on the ground."""
    time_constant: Positive = default_of(Terrain, "time_constant")
    """How fast a contact returns from penetration [s]: larger is softer ground."""
    walls: ListOf[WallKeys] = ()
    """Plates and rails that stand beside the robot; see the section hands."""
    drift: bool = default_of(Terrain, "drift")
    """Whether contacts follow J' q' as well, which MuJoCo leaves out: feet then rest while legs
    fold quickly, as in a landing."""


class PushSpec(Section):
    """A force on a body for a while: one of force, impulse and impulse_ratio."""

    body: Name = "base"
    """A link or frame; what it is fixed to is pushed."""
    force: Strength | None = None
    """[N]: a number with angle or direction, or [x, y, z] in world axes; the peak of a
    half_sine."""
    impulse: Strength | None = None
    """[N s], likewise: the time integral of the force."""
    impulse_ratio: Positive | None = None
    """Horizontal impulse in parts of M omega d, after which the capture point is at the edge of the
    soles that stand at the start, in the direction of the push."""
    angle: Number | None = None
    """Direction in the horizontal plane [rad]: 0 is forwards (world x), pi/2 to the left."""
    direction: Point | None = None
    """Direction in world axes; its length does not matter."""
    point: Annotated[Literal["com"] | Point, Forms("com, or [x, y, z] in the body's axes")] = "com"
    """Where it acts: com, where the CoM is at the start, carried along with the body; or a place
    in the body's axes [m]."""
    at: NonNegative
    """When it begins, in simulated time [s]."""
    duration: Positive = 0.1
    """How long it lasts [s]."""
    profile: Annotated[str, Words(PROFILES)] = PROFILES[0]
    """How the force goes over time."""

    def push(self, start: Snapshot, feet: Sequence[str]) -> Push:
        """Return the push, of a robot that stands on ``feet`` at the start.

        Raises WbcError: an unknown body, or no strength or direction, or more than one of either.
        """
        start.robot.frame_id(self.body)
        place = np.array(self.point) if isinstance(self.point, tuple) else np.zeros(3)
        if self.point == "com":
            place = start.rotation(self.body).T @ (start.com - start.position(self.body))
        shape = Push(self.body, np.ones(3), place, self.at, self.duration, self.profile)
        force = self._strength(start, feet, float(shape.impulse[0]))
        return Push(self.body, force, place, self.at, self.duration, self.profile)

    def _strength(self, start: Snapshot, feet: Sequence[str], per_newton: float) -> Array:
        """Return the largest force (3,) [N]; ``per_newton`` is the impulse of one [N s]."""
        given = [key for key in STRENGTHS if getattr(self, key) is not None]
        if len(given) != 1:
            below = given[1:2]  # the redundant key
            raise Misplaced(f"give one of {', '.join(STRENGTHS)}", *below)
        (key,) = given
        value = getattr(self, key)
        if isinstance(value, tuple):
            for other in ("angle", "direction"):
                if getattr(self, other) is not None:
                    raise Misplaced(f"{key} is a vector and has a direction of its own", other)
            vector = np.array(value)
        else:
            vector = value * self._direction(key)
            if key == "impulse_ratio":
                if not feet:
                    raise Misplaced("the robot stands on no feet at the start; give impulse", key)
                vector = vector * capture_impulse(start, feet, vector)
        return vector if key == "force" else vector / per_newton

    def _direction(self, key: str) -> Array:
        """Return the direction, of unit length."""
        if (self.angle is None) == (self.direction is None):
            raise Misplaced(f"{key} is a number: give angle or direction, one of them", key)
        if self.angle is not None:
            return np.array((math.cos(self.angle), math.sin(self.angle), 0.0))
        direction = np.array(self.direction)
        length = float(np.linalg.norm(direction))
        if length < 1e-9:
            raise Misplaced("needs some length", "direction")
        if key == "impulse_ratio" and abs(direction[2]) > 1e-9 * length:
            raise Misplaced("impulse_ratio is about horizontal pushes; z must be 0", "direction")
        return direction / length


class WrenchSpec(Section):
    """A constant force and moment on a frame, for longer than a push."""

    frame: Name
    """A link or frame, at whose origin it acts, whatever way the robot goes."""
    force: Point = (0.0, 0.0, 0.0)
    """[N], world axes."""
    moment: Point = (0.0, 0.0, 0.0)
    """[N m], world axes."""
    at: NonNegative = 0.0
    """When it begins, in simulated time [s]."""
    duration: PositiveOrInfinite = math.inf
    """How long it lasts [s]; .inf: for ever."""
    told: bool = default_of(AppliedWrench, "told")
    """Whether the controller knows of it, and bears it; otherwise it is a disturbance."""

    def applied(self) -> AppliedWrench:
        """Return the wrench."""
        wrench = np.array((*self.force, *self.moment))
        return AppliedWrench(self.frame, wrench, self.at, self.duration, self.told)


def rotated_to_plane(q: Array, normal: Array) -> Array:
    """Return a configuration rotated about the world's origin, from level ground to a plane.

    ``normal``: (3,) of the plane, upwards, of unit length.
    """
    R, turned = upright_on(normal), np.array(q, dtype=float)
    turned[:3] = R @ q[:3]
    turned[3:7] = quaternion_from(R @ rotation_from(q[3:7]))
    return turned


class MovingStart(Section):
    """Where the simulated robot begins, other than at rest on the ground."""

    height: NonNegative = 0.0
    """How far above its place by the problem's start [m]."""
    velocity: Point = (0.0, 0.0, 0.0)
    """Of its CoM [m/s], world axes."""
    angular_velocity: Point = (0.0, 0.0, 0.0)
    """At which it turns about its CoM as one body [rad/s], world axes."""

    def state(self, start: Snapshot) -> tuple[Array, Array]:
        """Return configuration (nq,) and velocity (nv,) of the simulated robot."""
        q, v, R = start.q.copy(), np.zeros(start.robot.nv), start.rotation("base")
        w, arm = np.array(self.angular_velocity), start.position("base") - start.com
        v[:3], v[3:6] = R.T @ (self.velocity + np.cross(w, arm)), R.T @ w
        q[2] += self.height
        return q, v


class SimulationSpec(Section):
    """The physics, and what happens in it; of the torque level."""

    duration: Positive = 4.0
    """How long to simulate [s]; with phases it ends after the last, and this is left out."""
    start: MovingStart = MovingStart()
    """Where the simulated robot begins, if not at rest at the problem's start; targets that are
    relative to the start mean the latter."""
    gravity: NonNegative | None = None
    """Downwards [m/s^2]; left out: that of the robot's model, which the controller counts on in any
    case. A robot that nothing holds gets the same torques whatever it is."""
    physics_dt: Positive = default_of(Plant, "physics_dt")
    """Time step of the physics [s], of which the controller's dt is a multiple."""
    friction: NonNegative = default_of(Terrain, "friction")
    """Coefficient of friction of the ground; what the controller counts on is in its section."""
    terrain: TerrainSpec = TerrainSpec()
    """Slope and steps."""
    shapes: bool = default_of(Plant, "shapes")
    """Whether the links' collision shapes meet the ground too, not only the soles."""
    sensors: Annotated[dict[str, Any], KeysOf(Sensors, seed=Seed)] = Field(default_factory=dict)
    """Noise, bias, delay and loss of what is measured; all off by default."""
    estimate: bool = False
    """Whether the controller gets the state that is estimated from devices, in place of the true
    one with the noise of sensors; feet then feel what the estimate says."""
    devices: DevicesSpec = DevicesSpec()
    """The sensors from which the state is estimated, with estimate: true."""
    model_error: Annotated[dict[str, Any], KeysOf(ModelMismatch, com=Point, seed=Seed)] = Field(
        default_factory=dict
    )
    """How the simulated robot differs from the model that the controller has."""
    pushes: ListOf[PushSpec] = ()
    """What pushes the robot, and when."""
    wrenches: ListOf[WrenchSpec] = ()
    """Forces and moments that act for longer, and whether the controller is told of them."""
    falls: Annotated[dict[str, Any], KeysOf(FallLimits, trunk=Name, touch=bool, lifted=Name)] = (
        Field(default_factory=dict)
    )
    """What counts as a fall."""

    def ground(self) -> Terrain:
        """Return what the robot stands on."""
        terrain = self.terrain
        steps = tuple(Step(**step) for step in terrain.steps)
        slope = terrain.slope[0], terrain.slope[1]
        walls = tuple(Wall(**wall) for wall in terrain.walls)
        return Terrain(self.friction, slope, steps, terrain.time_constant, terrain.drift, walls)

    def check(
        self, start: Snapshot, feet: Sequence[str], dt: float, duration: float, mistakes: Mistakes
    ) -> None:
        """Note names and numbers that do not fit the robot."""
        whole = {"dt": dt, **{key: self.sensors.get(key, 0.0) for key in ("delay", "latency")}}
        for key, time in whole.items():
            place = ("controller", key) if key == "dt" else ("simulation", "sensors", key)
            steps = time / self.physics_dt
            if abs(steps - round(steps)) > STEP_TOLERANCE or (key == "dt" and round(steps) < 1):
                step = f"simulation.physics_dt ({self.physics_dt:g})"
                mistakes.note(place, f"{time:g} s is no multiple of {step}")
        if start.robot.fixed_base and self.start.model_fields_set:
            mistakes.note(
                ("simulation", "start"), "the robot is bolted to the world; leave this out"
            )
        for key, make in (("sensors", Sensors), ("model_error", ModelMismatch)):
            with mistakes.at("simulation", key):
                make(**getattr(self, key))
        for k, wall in enumerate(self.terrain.walls):
            with mistakes.at("simulation", "terrain", "walls", k):
                Wall(**wall)
        self._check_devices(start, dt, mistakes)
        with mistakes.at("simulation", "falls"):
            limits = FallLimits(**self.falls)
            start.robot.frame_id(limits.trunk)
            if limits.lifted and start.robot.foot(limits.lifted).name in feet:
                raise Misplaced(f"the {limits.lifted} foot stands at the start", "lifted")
        for k, push in enumerate(self.pushes):
            with mistakes.at("simulation", "pushes", k):
                push.push(start, feet)
                _check_begins(push.at, duration)
        for k, wrench in enumerate(self.wrenches):
            with mistakes.at("simulation", "wrenches", k):
                start.robot.frame_id(wrench.frame)
                if not any((*wrench.force, *wrench.moment)):
                    raise Misplaced("is nothing: give force or moment", "force")
                _check_begins(wrench.at, duration)

    def _check_devices(self, start: Snapshot, dt: float, mistakes: Mistakes) -> None:
        """Note devices that are impossible, or have no effect."""
        if not self.estimate:
            if self.devices.model_fields_set:
                mistakes.note(("simulation", "devices"), "nothing is estimated; add estimate: true")
            return
        with mistakes.at("simulation", "devices"):
            devices = self.devices.made()
            mounts = [one.mount for one in devices.imus]
            StateEstimator(start.robot, mounts, self.devices.settings(), dt=dt)
            for one in devices.imus:
                one.period(dt)
        for key in sorted(set(self.sensors) - {"latency", "seed"}):
            text = "adds to the true state, which is estimated here"
            mistakes.note(("simulation", "sensors", key), text)
        if np.any((*self.start.velocity, *self.start.angular_velocity)) or self.start.height:
            text = "a robot whose state is estimated begins at rest: leave out"
            mistakes.note(("simulation", "start"), text)
        known = start.robot.gravity
        if self.gravity is not None and self.gravity < LEAST_FELT * known:
            text = (
                f"the estimator counts on {known:.3g} m/s^2, as the controller does, and does not"
                " begin where less than half of that is felt; leave out this, or estimate: true"
            )
            mistakes.note(("simulation", "gravity"), text)

    def plant(
        self, start: Snapshot, feet: Sequence[str], dt: float, hands: Sequence[Hand] = ()
    ) -> Plant:
        """Return the robot's plant at its start, with all pushes scheduled.

        ``hands`` may lean on walls.

        Raises MissingPackageError: MuJoCo is not installed; ModelError: MuJoCo refuses the robot.
        """
        settings: dict[str, Any] = {
            "dt": dt,
            "physics_dt": self.physics_dt,
            "terrain": self.ground(),
            "shapes": self.shapes,
            "hands": hands,
            "mismatch": ModelMismatch(**self.model_error),
            "gravity": None if self.gravity is None else (0.0, 0.0, -self.gravity),
            "sensors": Sensors(**self.sensors),
        }
        if self.estimate:
            settings |= {"devices": self.devices.made(), "settings": self.devices.settings()}
            plant: Plant = SensedPlant(start.robot, **settings)
        else:
            plant = Plant(start.robot, **settings)
        self.set_initial_state(plant, start)
        plant.pushes += [push.push(start, feet) for push in self.pushes]
        return plant

    def set_initial_state(self, plant: Plant, start: Snapshot) -> None:
        """Set a plant's initial state, and all that acts on it but pushes."""
        plant.reset(*self.start.state(start))
        plant.wrenches += [wrench.applied() for wrench in self.wrenches]


def _check_begins(at: float, duration: float) -> None:
    if at >= duration:
        raise Misplaced(f"begins after the end of the simulation ({duration:g} s)", "at")
