"""A torque-controlled robot in MuJoCo."""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Sequence
from copy import deepcopy
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wbc.attributes import DeclaredAttributes
from wbc.errors import InvalidInputError, listed
from wbc.extras import quietly, require
from wbc.gait.walls import Hand, check_hands
from wbc.kinds import check_kind, switch
from wbc.robot import Robot, Snapshot
from wbc.robot.limits import BASE_NQ, BASE_NV
from wbc.robot.model import check_robot
from wbc.robot.postures import STANDING
from wbc.simulation.build import build
from wbc.simulation.contacts import Contacts, read_contacts, self_contacts, touched_by_links
from wbc.simulation.engine import check_state
from wbc.simulation.mismatch import EXACT, ModelMismatch
from wbc.simulation.push import AppliedWrench, Push, apply, push_point, sum_by_frame
from wbc.simulation.sensors import Measurements, Sensors, doubt_delays
from wbc.simulation.shapes import ShapeOptions
from wbc.simulation.states import ContactDrift, StateMap
from wbc.simulation.terrain import Terrain
from wbc.validate import Array, finite_array, finite_number, finite_vector, read_only, time_step

_STEP_TOLERANCE = 1e-6  # of a control period's number of physics steps, from an integer
SUNK = 1e-3  # m, below which links of a bolted robot are in the ground, not on it
PERFECT = Sensors()


class Plant(DeclaredAttributes):
    """A robot on its ground: torques in, states and contact forces out.

    The physics has the robot's joints, limits, inertias, armature, damping and dry friction (see
    :mod:`wbc.simulation.build`); the same input gives the same bits.

    Parameters
    ----------
    robot:
        Floating or fixed base; mimic joints and closed loops are coupled by stiff springs. Mimic
        joints take torques, too, unactuated ones none.
    dt:
        Control period: how long :meth:`step` holds a torque [s].
    physics_dt:
        Step of the physics [s]; the control period is a multiple.
    terrain:
        Ground and steps; ``friction`` is short for ``Terrain(friction=...)``.
    shapes:
        Whether the links' collision shapes collide with the ground, not only the soles. A robot
        without such shapes gets a note.
    self_collision:
        Whether links collide with each other: the pairs of self-collision constraints.
    saturate:
        Clip torques to the robot's effort limits, as motors would; see :attr:`saturated`.
    hands:
        Balls that may lean on the terrain's walls; that is no touch in the sense of falls.
    sensors:
        Noise, delay and loss of :meth:`measure`, and latency of torques.
    mismatch:
        Differences of the simulated robot from ``robot``, the controllers' model.
    gravity:
        (3,) [m/s^2]; None: that of the robot's model, which controllers use.

    Attributes
    ----------
    model, data:
        MuJoCo's ``MjModel`` and ``MjData``, for its viewer and for anything not offered here.
    states:
        Converts states between MuJoCo's coordinates and the robot's.
    pushes:
        Pushes that are not over.
    wrenches:
        Wrenches that are not over; see :meth:`apply`.
    torque:
        The last command (nv-6,), within the effort limits.
    push_force:
        Sum of the pushes (3,) in the last step of the physics [N].
    applied:
        Mean wrenches (6,) of the last period, by frame.
    saturated:
        Number of control periods in which each joint's (nv-6,) command was beyond its effort limit.

    Raises
    ------
    MissingPackageError
        MuJoCo is not installed.
    ModelError
        MuJoCo refuses the robot.
    InvalidInputError
        Hands that are not at the ends of arms; unusable numbers.
    """

    _fixed = dict.fromkeys(
        ("robot", "dt", "physics_dt", "terrain", "hands", "sensors", "mismatch", "model", "data"),
        "make another Plant",
    )

    robot: Robot
    dt: float
    physics_dt: float
    terrain: Terrain
    hands: tuple[Hand, ...]
    sensors: Sensors
    mismatch: ModelMismatch
    model: Any
    data: Any
    states: StateMap
    pushes: list[Push]
    wrenches: list[AppliedWrench]
    saturated: NDArray[np.int64]
    torque: Array
    push_force: Array
    applied: dict[str, Array]

    def __init__(
        self,
        robot: Robot,
        *,
        dt: float = 0.002,
        physics_dt: float = 0.001,
        friction: float | None = None,
        terrain: Terrain | None = None,
        shapes: bool = True,
        self_collision: bool = False,
        saturate: bool = True,
        hands: Sequence[Hand] = (),
        sensors: Sensors = PERFECT,
        mismatch: ModelMismatch = EXACT,
        gravity: ArrayLike | None = None,
    ) -> None:
        check_robot("plant, robot", robot)
        if friction is not None and terrain is not None:
            raise InvalidInputError("plant: give friction or a terrain that has it, not both")
        check_kind("plant, terrain", terrain, Terrain, "Terrain(friction=0.6)", or_none=True)
        check_kind("plant, sensors", sensors, Sensors, "Sensors(delay=0.002)")
        check_kind("plant, mismatch", mismatch, ModelMismatch, "ModelMismatch(mass=1.1)")
        shapes = switch("plant, shapes", shapes)
        self_collision = switch("plant, self_collision", self_collision)
        saturate = switch("plant, saturate", saturate)
        require("mujoco", "simulation")
        self.robot = robot
        self.physics_dt = finite_number("plant, physics_dt", physics_dt, above=0.0)
        self.dt = time_step("plant", dt)
        self._substeps("dt", self.dt)
        self.sensors, self.mismatch = sensors, mismatch
        self._delay = self._substeps("sensors, delay", sensors.delay, least=0)
        self._latency = self._substeps("sensors, latency", sensors.latency, least=0)
        doubt_delays(sensors)
        terrain = terrain or (Terrain() if friction is None else Terrain(friction=friction))
        self.terrain = terrain
        self.hands = check_hands("plant", hands)
        options = ShapeOptions(
            shapes, bool(terrain.steps or terrain.walls), self_collision, self.hands
        )
        self._compiled = build(self._mujoco, robot, terrain, mismatch, options, self.physics_dt)
        self.model = self._compiled.model
        if gravity is not None:
            self.model.opt.gravity = finite_array("plant, gravity", gravity, (3,))
        self.data = self._mujoco.MjData(self.model)
        self._drift = ContactDrift(self.model) if terrain.drift else None
        self.states = StateMap(robot, self.model)
        most = robot.limits.effort if saturate else np.full(robot.nv - BASE_NV, np.inf)
        self._max_torque = most.copy()
        self._max_torque[[robot.joint_index(name) - BASE_NV for name in robot.unactuated]] = 0.0
        self.reset(robot.postures[STANDING])

    def __repr__(self) -> str:
        return (
            f"Plant({self.robot.name!r}, t={self.time:.3f} s, dt={self.dt:g},"
            f" physics_dt={self.physics_dt:g})"
        )

    def __copy__(self) -> Self:
        """Return a plant of the same robot, whose snapshots its controllers take, that goes on."""
        return deepcopy(self, {id(self.robot): self.robot})

    @property
    def _mujoco(self) -> Any:  # a module as an attribute could be neither copied nor pickled
        import mujoco

        return mujoco

    @property
    def notes(self) -> tuple[str, ...]:
        """What the physics omits, in words."""
        return self._compiled.notes

    # ------------------------------------------------------------------ time and state

    @property
    def time(self) -> float:
        """Simulated time since the reset [s]."""
        return float(self.data.time)

    def reset(self, q: ArrayLike, v: ArrayLike | None = None) -> None:
        """Begin at configuration ``q`` (nq,) with velocity ``v`` (at rest if None), at time 0.

        Pushes and wrenches are removed. The simulation is then the same, bit for bit, for any past.

        Raises
        ------
        InvalidInputError
            An unusable state, or a fixed base that moves.
        """
        q = self.robot.check_configuration(q)
        rates = np.zeros(self.robot.nv) if v is None else self.robot.check_velocity(v)
        qpos, qvel = self.states.to_mujoco(q, rates)
        self._mujoco.mj_resetData(self.model, self.data)
        self.data.qpos, self.data.qvel = qpos, qvel
        if not self.states.floating:
            self.states.base = q[:BASE_NQ].copy()
            root = self._compiled.bodies[1]
            self.model.body_pos[root] = q[:3]
            self.model.body_quat[root] = q[[6, 3, 4, 5]]
        self.pushes = []
        self.wrenches = []
        self.saturated = np.zeros(self.robot.nv - BASE_NV, dtype=np.int64)
        self.torque = np.zeros(self.robot.nv - BASE_NV)
        self.push_force = np.zeros(3)
        self.applied = {}
        self._contacts: Contacts | None = None
        self._measurements = Measurements(self.robot, self.sensors)
        self._measurement: tuple[tuple[Array, Array] | None] | None = None
        self._past_states = deque([(qpos, qvel)], maxlen=self._delay + 1)
        self._commands = deque[Array]()  # one for each step of the physics still to come
        with quietly(self._mujoco):
            self._mujoco.mj_forward(self.model, self.data)
        self._check()

    def state(self) -> tuple[Array, Array]:
        """Return the true configuration (nq,) and velocity (nv,) now; fresh arrays."""
        return self.states.from_mujoco(self.data.qpos, self.data.qvel)

    def measure(self) -> tuple[Array, Array] | None:
        """Return configuration and velocity as measured; None if the frame is lost.

        All calls within one control period return the same.
        """
        if self._measurement is None:
            state = self.states.from_mujoco(*self._past_states[0]) if self._delay else self.state()
            self._measurement = (self._measurements.measure(*state),)
        measured = self._measurement[0]
        return None if measured is None else (measured[0].copy(), measured[1].copy())

    def snapshot(self) -> Snapshot:
        """Return the model's snapshot at :meth:`state`."""
        return self.robot.snapshot(*self.state())

    # ------------------------------------------------------------------ what acts

    def step(self, torque: ArrayLike, dt: float | None = None) -> None:
        """Hold joint torques (nv-6,) [N m or N] for one control period, or for ``dt``.

        Raises
        ------
        InvalidInputError
            Torques that are not finite, or a period that is no multiple of the physics' step.
        SimulationError
            The physics blew up, or its memory is full; the message names time and joint.
        """
        if hasattr(torque, "torque"):
            raise InvalidInputError("plant, torque: expected numbers: plant.step(tick.torque)")
        torque = finite_vector("plant, torque", torque, self.robot.nv - BASE_NV)
        count = self._substeps("dt", self.dt if dt is None else dt)
        applied = np.clip(torque, -self._max_torque, self._max_torque)
        self.saturated += applied != torque
        self.torque = read_only(applied)
        self.push_force, self._contacts, self._measurement = np.zeros(3), None, None
        self.applied = sum_by_frame(self.wrenches, self.time, count * self.physics_dt)
        if self.time == 0.0 and not self.states.floating:
            self._tell_sunk_links()
        with quietly(self._mujoco):
            external = self.pushes or self.wrenches
            if external or self._delay or self._latency or self._drift:
                self._step_singly(applied, count)
            else:
                self.states.torques_to_mujoco(applied, self.data.qfrc_applied)
                self._mujoco.mj_step(self.model, self.data, count)
        self._check()

    def _tell_sunk_links(self) -> None:
        """Warn if a bolted robot begins in the ground, which throws its links."""
        depth = -float(self.data.contact.dist.min(initial=0.0))
        if depth > SUNK and (touched := self.touched()):
            logging.getLogger(__name__).warning(
                "plant: %s begins %.0f mm deep in the %s with %s, which will be thrown: raise its"
                " base (q[2]), bend it, or Plant(shapes=False)",
                *(self.robot.name, 1e3 * depth, touched[min(touched)], listed([*touched])),
            )

    def push(
        self,
        body: str,
        force: ArrayLike,
        point: ArrayLike | str | None = None,
        *,
        duration: float = 0.1,
        profile: str = "rectangular",
        start: float | None = None,
    ) -> Push:
        """Push a body for a while, from now on or from ``start``; return the push.

        Parameters
        ----------
        body:
            A link or frame; its body is pushed.
        force:
            (3,) [N], world axes; the peak of a ``half_sine``.
        point:
            Point of application (3,) [m], in the frame's axes from its origin, the default; or
            ``com``: the robot's CoM now, a point that then moves with the body.
        duration:
            [s].
        profile:
            ``rectangular`` or ``half_sine``.
        start:
            In simulated time [s], not before now.

        Raises
        ------
        UnknownNameError
            No such body or profile.
        InvalidInputError
            Not finite numbers, no duration, or a start that is over.
        """
        self.robot.frame_id(body)
        place, begin = push_point(point, body, self.snapshot), self._begin("push", start)
        push = Push(body, finite_array("push, force", force, (3,)), place, begin, duration, profile)
        self.pushes.append(push)
        return push

    def apply(
        self,
        frame: str,
        wrench: ArrayLike,
        *,
        start: float | None = None,
        duration: float = math.inf,
        told: bool = True,
    ) -> AppliedWrench:
        """Let a constant wrench act on the robot, from now on or from ``start``; return it.

        Parameters
        ----------
        frame:
            A link or frame; the wrench moves with its origin.
        wrench:
            (6,) at that origin, world axes, [N] then [N m].
        start:
            In simulated time [s], not before now.
        duration:
            [s]; infinite by default. To end it earlier, remove it from :attr:`wrenches`.
        told:
            Whether controllers know it: whether it is in :meth:`known_wrenches`.

        Raises
        ------
        UnknownNameError
            No such frame.
        InvalidInputError
            Not finite numbers, no duration, or a start that is over.
        """
        self.robot.frame_id(frame)
        begin = self._begin("wrench", start)
        acting = AppliedWrench(frame, finite_array("wrench", wrench, (6,)), begin, duration, told)
        self.wrenches.append(acting)
        return acting

    def known_wrenches(self, dt: float | None = None) -> dict[str, Array]:
        """Return the wrenches (6,) by frame that controllers know, mean of the next period or dt.

        For ``controller.step(snapshot, wrenches=plant.known_wrenches())``.
        """
        known = (wrench for wrench in self.wrenches if wrench.told)
        return sum_by_frame(known, self.time, self.dt if dt is None else dt)

    def _step_singly(self, torque: Array, count: int) -> None:
        """Step the physics one by one, with pushes, latency, and past states for the delay."""
        mujoco, model, data = self._mujoco, self.model, self.data
        if not self._commands:  # the first since the reset
            self._commands.extend([torque] * self._latency)
        self._commands.extend([torque] * count)
        own = data.xfrc_applied.copy()  # that a user, or a gantry, wrote
        for _ in range(count):
            mujoco.mj_step1(model, data)
            self.states.torques_to_mujoco(self._commands.popleft(), data.qfrc_applied)
            data.xfrc_applied[:] = own
            acts: list[Push | AppliedWrench] = [*self.pushes, *self.wrenches]
            self.push_force = apply(acts, self.robot, self._compiled.bodies, data, self.physics_dt)
            if self._drift is not None:
                self._drift.subtract(data)
            mujoco.mj_step2(model, data)
            self._past_states.append((data.qpos.copy(), data.qvel.copy()))
        now = self.time + 1e-9
        self.pushes = [push for push in self.pushes if push.end > now]
        self.wrenches = [wrench for wrench in self.wrenches if wrench.end > now]
        data.xfrc_applied[:] = own

    # ------------------------------------------------------------------ what is felt

    @property
    def contacts(self) -> Contacts:
        """Contacts with the ground in the last step of the physics."""
        if self._contacts is None:
            self._contacts = read_contacts(self._mujoco, self._compiled, self.data)
        return self._contacts

    @property
    def contact_forces(self) -> dict[str, Array]:
        """Wrench (6,) on each sole by its frame, as a tick's ``forces``: at its origin, world axes.

        Zero for a swing foot.
        """
        contacts, data = self.contacts, self.data
        return {
            sole.frame: contacts.wrench(
                sole.foot, data.xpos[sole.body] + data.xmat[sole.body].reshape(3, 3) @ sole.origin
            )
            for sole in self._compiled.soles
        }

    @property
    def felt_forces(self) -> dict[str, Array]:
        """Measured forces on the soles: :attr:`contact_forces` here; see :class:`SensedPlant`."""
        return self.contact_forces

    @property
    def felt_loads(self) -> dict[str, float]:
        """Measured normal force by foot [N]."""
        return {foot: self.contacts.load(foot) for foot in self.robot.feet}

    @property
    def cop(self) -> Array | None:
        """Centre of pressure (3,) of all contacts [m]; None in the air."""
        return self.contacts.cop

    def touching(self) -> tuple[str, ...]:
        """Return the links that touch the ground with anything but a sole."""
        return tuple(self.touched())

    def touched(self) -> dict[str, str]:
        """Return what these touch, by link: ``ground``, ``step 0`` or ``wall 0`` of the terrain."""
        return touched_by_links(self._compiled, self.data)

    def self_contacts(self) -> tuple[tuple[str, str], ...]:
        """Return the pairs of links that touch each other; none without ``self_collision``."""
        return self_contacts(self._compiled, self.data)

    @property
    def com(self) -> Array:
        """CoM (3,) of the simulated robot, at most one step of the physics old [m]."""
        return np.array(self.data.subtree_com[self._compiled.bodies[1]])

    def body_rotation(self, frame: str) -> Array:
        """Return the rotation (3, 3) of a frame to the world, of the same instant."""
        placed = self.robot.frame(frame)
        body = self._compiled.bodies[int(placed.parentJoint)]
        return self.data.xmat[body].reshape(3, 3) @ np.array(placed.placement.rotation)

    # ------------------------------------------------------------------ checks

    def _substeps(self, what: str, time: float, least: int = 1) -> int:
        """Return the number of physics steps in a time."""
        steps = finite_number(f"plant, {what}", time, least=0.0) / self.physics_dt
        count = round(steps)
        if count < least or abs(steps - count) > _STEP_TOLERANCE:
            raise InvalidInputError(
                f"plant, {what}: {time:g} s is no multiple of physics_dt {self.physics_dt:g} s"
            )
        return count

    def _begin(self, what: str, start: float | None) -> float:
        """Return when something begins [s]; the time is a sum of many steps, so not to a digit."""
        begin = self.time if start is None else finite_number(f"{what}, start", start)
        if begin < self.time - 0.5 * self.physics_dt:
            raise InvalidInputError(f"{what}, start: {begin:g} s is over; it is {self.time:g} s")
        return max(begin, self.time)

    def _check(self) -> None:
        names = self.states.coordinates, self.states.velocities
        check_state(self._mujoco, self.data, *names)
