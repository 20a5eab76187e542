"""A robot in MuJoCo that is commanded by torques, and read back."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.extras import quietly, require
from wbc.gait.walls import Hand, check_hands
from wbc.kinds import check_kind, switch
from wbc.robot import Robot, Snapshot
from wbc.robot.limits import BASE_NQ, BASE_NV
from wbc.robot.model import check_robot
from wbc.robot.postures import STANDING
from wbc.simulation.build import build
from wbc.simulation.contact_drift import ContactDrift
from wbc.simulation.contacts import Contacts, read_contacts, self_contacts, touched_by_links
from wbc.simulation.engine import check_state
from wbc.simulation.mismatch import EXACT, ModelMismatch
from wbc.simulation.push import Push, push_point
from wbc.simulation.sensors import Measurements, Sensors
from wbc.simulation.shapes import ShapeOptions
from wbc.simulation.states import StateMap
from wbc.simulation.terrain import Terrain
from wbc.simulation.wrench import AppliedWrench, apply, sum_by_frame
from wbc.validate import Array, finite_array, finite_number, finite_vector, read_only, time_step

_EVEN = 1e-6  # a control period is so many physics steps, to this part of one
PERFECT = Sensors()


class Plant:
    """A robot on its ground: torques in, states and contact forces out.

    The physics has the robot's joints, limits, inertias, armature, damping and dry friction (see
    :mod:`wbc.simulation.build`); the same input gives the same bits.

    Parameters
    ----------
    robot:
        Floating or fixed base; mimic joints and closed loops are held by stiff springs. Mimic
        joints take torques, too, unactuated ones none.
    dt:
        Control period: how long :meth:`step` holds a torque [s].
    physics_dt:
        Step of the physics [s], of which the control period is a multiple.
    terrain:
        Ground and steps; ``friction`` is short for ``Terrain(friction=...)``.
    shapes:
        Whether the links' collision shapes meet the ground too, not only the soles. A robot
        without such shapes gets a note.
    self_collision:
        Whether links meet each other, too: the pairs of self-collision constraints.
    saturate:
        Hold torques to the robot's effort limits, as motors would; see :attr:`saturated`.
    hands:
        Balls that may lean on the terrain's walls, which is then no touching.
    sensors:
        Noise, delay and loss of what :meth:`measure` returns, and latency of torques.
    mismatch:
        How the simulated robot differs from ``robot``, which controllers know.
    gravity:
        (3,) [m/s^2]; None: that of the robot's model, which controllers count on.

    Attributes
    ----------
    model, data:
        MuJoCo's own ``MjModel`` and ``MjData``: for its viewer, and for what is not offered here.
    states:
        Converts states between MuJoCo's coordinates and the robot's.
    pushes:
        Pushes that are not over yet.
    wrenches:
        Wrenches that are not over yet; see :meth:`apply`.
    torque:
        What was last commanded (nv-6,), within the effort limits.
    push_force:
        Sum of the pushes (3,) in the last step of the physics [N].
    applied:
        Wrenches (6,) that acted in the last period, by frame: their means.
    saturated:
        How often each joint (nv-6,) was asked for more than its effort limit, in control periods.

    Raises
    ------
    MissingPackageError
        MuJoCo is not installed.
    ModelError
        MuJoCo refuses the robot.
    InvalidInputError
        Hands that are none, or not at the ends of arms; numbers that are unusable.
    """

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
        terrain = terrain or (Terrain() if friction is None else Terrain(friction=friction))
        self.terrain = terrain
        self.hands = check_hands("plant", hands)
        options = ShapeOptions(
            shapes, bool(terrain.steps or terrain.walls), self_collision, self.hands
        )
        self._built = build(self._mujoco, robot, terrain, mismatch, options, self.physics_dt)
        self.model = self._built.model
        if gravity is not None:
            self.model.opt.gravity = finite_array("plant, gravity", gravity, (3,))
        self.data = self._mujoco.MjData(self.model)
        self._drift = ContactDrift(self.model) if terrain.drift else None
        self.states = StateMap(robot, self.model)
        self._most_torque = robot.limits.effort if saturate else np.full(robot.nv - BASE_NV, np.inf)
        if robot.unactuated:
            self._most_torque = self._most_torque.copy()
            without = [robot.joint_index(name) - BASE_NV for name in robot.unactuated]
            self._most_torque[without] = 0.0
        self.reset(robot.postures[STANDING])

    def __repr__(self) -> str:
        return (
            f"Plant({self.robot.name!r}, t={self.time:.3f} s, dt={self.dt:g}"
            f" physics_dt={self.physics_dt:g})"
        )

    @property
    def _mujoco(self) -> Any:  # a module kept as an attribute could be neither copied nor pickled
        import mujoco

        return mujoco

    @property
    def notes(self) -> tuple[str, ...]:
        """What the physics leaves out, in words."""
        return self._built.notes

    # ------------------------------------------------------------------ time and state

    @property
    def time(self) -> float:
        """Simulated time since the reset [s]."""
        return float(self.data.time)

    def reset(self, q: ArrayLike, v: ArrayLike | None = None) -> None:
        """Begin at configuration ``q`` (nq,) moving at ``v`` (at rest if None), at time 0.

        Pushes and wrenches are forgotten. Nothing else is remembered either: what follows is the
        same, bit for bit, whatever was before.

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
            root = self._built.bodies[1]
            self.model.body_pos[root] = q[:3]
            self.model.body_quat[root] = q[[6, 3, 4, 5]]
        self.pushes: list[Push] = []
        self.wrenches: list[AppliedWrench] = []
        self.saturated = np.zeros(self.robot.nv - BASE_NV, dtype=np.int64)
        self.torque: Array = np.zeros(self.robot.nv - BASE_NV)
        self.push_force: Array = np.zeros(3)
        self.applied: dict[str, Array] = {}
        self._contacts: Contacts | None = None
        self._measurements = Measurements(self.robot, self.sensors)
        self._frame: tuple[tuple[Array, Array] | None] | None = None
        self._past = deque([(qpos, qvel)], maxlen=self._delay + 1)
        self._commands = deque[Array]()  # one for each step of the physics still to come
        with quietly(self._mujoco):
            self._mujoco.mj_forward(self.model, self.data)
        self._check()

    def state(self) -> tuple[Array, Array]:
        """Return the true configuration (nq,) and velocity (nv,) now; fresh arrays."""
        return self.states.from_mujoco(self.data.qpos, self.data.qvel)

    def measure(self) -> tuple[Array, Array] | None:
        """Return configuration and velocity as the sensors see them; None if the frame is lost.

        However often it is asked within one control period, the answer is the same.
        """
        if self._frame is None:
            state = self.states.from_mujoco(*self._past[0]) if self._delay else self.state()
            self._frame = (self._measurements.measure(*state),)
        found = self._frame[0]
        return None if found is None else (found[0].copy(), found[1].copy())

    def snapshot(self) -> Snapshot:
        """Return what the robot's own model knows of :meth:`state`."""
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
        applied = np.clip(torque, -self._most_torque, self._most_torque)
        self.saturated += applied != torque
        self.torque = read_only(applied)
        self.push_force, self._contacts, self._frame = np.zeros(3), None, None
        self.applied = sum_by_frame(self.wrenches, self.time, count * self.physics_dt)
        with quietly(self._mujoco):
            acted_on = self.pushes or self.wrenches
            if acted_on or self._delay or self._latency or self._drift:
                self._step_one_by_one(applied, count)
            else:
                self.states.torques_to_mujoco(applied, self.data.qfrc_applied)
                self._mujoco.mj_step(self.model, self.data, count)
        self._check()

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
            A link or frame; what it is fixed to is pushed.
        force:
            (3,) [N], world axes; the peak of a ``half_sine``.
        point:
            Where (3,) [m], in the frame's axes from its origin, which is the default; or ``com``:
            where the robot's CoM is now, carried along with the body.
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
        place = push_point(point, body, self.snapshot)
        when = self.time if start is None else finite_number("push, start", start, least=self.time)
        push = Push(body, finite_array("push, force", force, (3,)), place, when, duration, profile)
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
            A link or frame, whose origin carries it along.
        wrench:
            (6,) at that origin, world axes, [N] then [N m].
        start:
            In simulated time [s], not before now.
        duration:
            [s]; for ever by default. To end it sooner, take it out of :attr:`wrenches`.
        told:
            Whether the controller shall know: it is then in :meth:`known_wrenches`.

        Raises
        ------
        UnknownNameError
            No such frame.
        InvalidInputError
            Not finite numbers, no duration, or a start that is over.
        """
        self.robot.frame_id(frame)
        when = self.time if start is None else finite_number("wrench, start", start, least=0.0)
        if when < self.time:
            raise InvalidInputError(f"wrench, start: {when:g} s is over; it is {self.time:g} s")
        found = AppliedWrench(frame, finite_array("wrench", wrench, (6,)), when, duration, told)
        self.wrenches.append(found)
        return found

    def known_wrenches(self, dt: float | None = None) -> dict[str, Array]:
        """Return the wrenches (6,) by frame that controllers are told for the next period, or dt.

        As ``controller.step(snapshot, wrenches=plant.known_wrenches())`` takes them.
        """
        told = (wrench for wrench in self.wrenches if wrench.told)
        return sum_by_frame(told, self.time, self.dt if dt is None else dt)

    def _step_one_by_one(self, torque: Array, count: int) -> None:
        """Make steps of the physics with pushes, late torques, and states kept for later."""
        mujoco, model, data = self._mujoco, self.model, self.data
        if not self._commands:  # the first since the reset
            self._commands.extend([torque] * self._latency)
        self._commands.extend([torque] * count)
        for _ in range(count):
            mujoco.mj_step1(model, data)
            self.states.torques_to_mujoco(self._commands.popleft(), data.qfrc_applied)
            acting: list[Push | AppliedWrench] = [*self.pushes, *self.wrenches]
            self.push_force = apply(acting, self.robot, self._built.bodies, data, self.physics_dt)
            if self._drift is not None:
                self._drift.subtract(data)
            mujoco.mj_step2(model, data)
            self._past.append((data.qpos.copy(), data.qvel.copy()))
        over = self.time + 1e-9
        self.pushes = [push for push in self.pushes if push.end > over]
        self.wrenches = [wrench for wrench in self.wrenches if wrench.end > over]
        data.xfrc_applied[:] = 0.0

    # ------------------------------------------------------------------ what is felt

    @property
    def contacts(self) -> Contacts:
        """Contacts with the ground, as the last step of the physics had them."""
        if self._contacts is None:
            self._contacts = read_contacts(self._mujoco, self._built, self.data)
        return self._contacts

    @property
    def contact_forces(self) -> dict[str, Array]:
        """Wrench (6,) on each sole by its frame, as a tick's ``forces``: at its origin, world axes.

        Zero for a foot in the air.
        """
        found, data = self.contacts, self.data
        return {
            sole.frame: found.wrench(
                sole.foot, data.xpos[sole.body] + data.xmat[sole.body].reshape(3, 3) @ sole.origin
            )
            for sole in self._built.soles
        }

    @property
    def felt_forces(self) -> dict[str, Array]:
        """What feet feel: :attr:`contact_forces`, without noise; see :class:`SensedPlant`."""
        return self.contact_forces

    @property
    def felt_loads(self) -> dict[str, float]:
        """Normal force by foot [N] as feet feel it."""
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
        return touched_by_links(self._built, self.data)

    def self_contacts(self) -> tuple[tuple[str, str], ...]:
        """Return the pairs of links that touch each other; none without ``self_collision``."""
        return self_contacts(self._built, self.data)

    @property
    def com(self) -> Array:
        """CoM (3,) of the simulated robot, one step of the physics ago at most [m]."""
        return np.array(self.data.subtree_com[self._built.bodies[1]])

    def body_rotation(self, frame: str) -> Array:
        """Return the rotation (3, 3) of a frame to the world, of the same instant."""
        found = self.robot.frame(frame)
        body = self._built.bodies[int(found.parentJoint)]
        return self.data.xmat[body].reshape(3, 3) @ np.array(found.placement.rotation)

    # ------------------------------------------------------------------ checks

    def _substeps(self, what: str, time: float, least: int = 1) -> int:
        """Return how many steps of the physics a time has."""
        steps = finite_number(f"plant, {what}", time, least=0.0) / self.physics_dt
        count = round(steps)
        if count < least or abs(steps - count) > _EVEN:
            raise InvalidInputError(
                f"plant, {what}: {time:g} s is no multiple of physics_dt {self.physics_dt:g} s"
            )
        return count

    def _check(self) -> None:
        names = self.states.coordinates, self.states.velocities
        check_state(self._mujoco, self.data, *names)
