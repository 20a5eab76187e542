"""The tasks and contacts by which a whole body walks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from wbc.constraints import Contact, Limits
from wbc.constraints.friction import FrictionCone
from wbc.constraints.rows import Constraint
from wbc.controllers.torque import TorqueController
from wbc.errors import InvalidInputError
from wbc.gait.ability import contact_of, lacks, pressed_ahead
from wbc.gait.crouch import walking_posture
from wbc.gait.legs import SIDES, Legs, leg_joints
from wbc.gait.swing import FootPose, SwingMotion, turned
from wbc.robot import Robot, Snapshot
from wbc.robot.limits import BASE_NV
from wbc.robot.names import BASE
from wbc.tasks import ComTask, CopTask, MomentumTask, OrientationTask, PoseTask, PostureTask, Task
from wbc.validate import Array, check_fields

UP = np.array((0.0, 0.0, 1.0))
# Hips that accelerate a foot by so many times gravity hold it up by all of ``WalkingWeights.lift``.
# A G1's do 5.5, TALOS's 4.05. A Romeo's do 1.8: pushed to its right half way through a step it goes
# over its wrist with all of the weight, and walks on with 0.45 of it.
FIRM_HIPS = 4.0
# How much a foot in the air weighs in how it is turned, in parts of its place.
TURN = 0.3
# How high it is, likewise, where it has to land on a footstep beyond an edge.
OVER = 3.0


@dataclass(frozen=True)
class WalkingWeights:
    """Weights of the tasks, and how stiff they are.

    A pressure can be had by accelerating the CoM or by turning the trunk; only the first brings
    the robot anywhere. So the trunk is held upright firmly: at a sixth of the weight, pushes of
    20 N s threw a G1's trunk to its limits.

    The pressure comes before the foot in the air: at a fifth of the weight, a G1's foot that is
    hurried at 60 m/s^2 had 0.4 m/s^2 more of them, and the pressure was 5 cm off for it.

    How high that foot is comes before where it is: one that is 8 mm too high when it should land
    lands 60 ms late, in which the capture point's error grows by a quarter. At the weight of its
    place, a leg swung by its hip drew a G1's foot down by 25 m/s^2 when it hurried ahead at 70, and
    held it up as it slowed; at three times that weight, hurried ahead or aside after a push, it was
    3 cm lower than planned, scuffed and landed 0.4 m short of its footstep. On footsteps that are
    given the place counts as much: with a firm height a small humanoid's feet landed 4 mm from them
    in place of 2. Not quite over edges: down stairs of 15 cm, where the ankle that bears is at its
    limit, a G1's foot was drawn 2 cm too low, landed 0.1 s early and threw the CoM up. At three
    times the place it lands in time.

    Where that foot is comes before how it is turned: ankles and hips that are at their bounds as a
    leg is hurried aside held it back for that. Of 190 m/s^2 that a G1's late foot was asked for it
    had 11, and 100 with a tenth of the weight for its turn.

    What draws that foot down grows with how fast hips swing it, and weak hips that hold it up throw
    the pelvis over: so ``lift`` is in proportion less for hips that do less than
    :data:`FIRM_HIPS` (:meth:`for_legs`).

    The CoM's height comes before the foot in the air, too: a hip at its bound can accelerate a foot
    that hurries by letting the robot fall, and weak knees do not lift it again. At half the weight
    6 of 10 walks of a Romeo stood that was pushed aside late in a step, with this one 9.

    The angular momentum of a swinging leg is let go: held to zero it would move the pressure by
    more than the length of a sole. About the vertical only friction holds a foot, so that is
    regulated, firmly, to what the whole body has when it turns as commanded: on ground with a
    friction of 0.4 a G1's foot turned by 5 degrees in a step at a ninth of the weight, by 3 at two
    thirds, and by 1 with it (means of four seeds). At a third more the pressure was 9 mm off under
    a hurried foot, in place of 7.

    Attributes
    ----------
    com, height, swing, lift:
        Of the CoM's horizontal motion (by the centre of pressure), of its height, of the foot in
        the air, and of how high that is [1/(m/s)].
    trunk, posture:
        [1/(rad/s)].
    spin, yaw:
        Of the angular momentum about x and y, and z, in units of mass times height squared
        [1/(m^2 rad/s)].
    stiff_height, stiff_trunk, stiff_posture, stiff_swing:
        Their ``kp`` [1/s^2].
    """

    com: float = 180.0
    height: float = 60.0
    swing: float = 10.0
    lift: float = 90.0
    trunk: float = 6.0
    posture: float = 0.3
    spin: float = 0.4
    yaw: float = 90.0
    stiff_height: float = 100.0
    stiff_trunk: float = 100.0
    stiff_posture: float = 30.0
    stiff_swing: float = 900.0

    def __post_init__(self) -> None:
        check_fields(self, "walking weights, ", *self.__dataclass_fields__, above=0.0)

    def for_legs(self, legs: Legs) -> Self:
        """Return them with the ``lift`` that the hips of these legs bear."""
        firm = min(1.0, legs.swing_acceleration / (FIRM_HIPS * legs.gravity))
        return replace(self, lift=firm * self.lift)


class WholeBody:
    """Tasks for pressure, height, trunk, feet and posture, and the controller that has them.

    Attributes
    ----------
    controller:
        The :class:`~wbc.controllers.torque.TorqueController`.
    lasting:
        Those of its tasks that have a target all the time.
    bends:
        Whether the robot starts on straight legs, which are bent first.
    ahead:
        Of the soles' middles the pressure is led [m], where ankles are too weak for these.
    lacks:
        What the legs lack for walking, in words.
    """

    def __init__(
        self,
        start: Snapshot,
        heading: float,
        height: float,
        weights: WalkingWeights,
        friction: FrictionCone,
        *,
        tasks: Sequence[Task] = (),
        limits: Limits | None,
        constraints: Sequence[Constraint] = (),
        dt: float,
        **settings: Any,
    ) -> None:
        robot, w = start.robot, weights
        self._friction = friction
        self._frames = {foot: sole.frame for foot, sole in robot.feet.items()}
        posture = walking_posture(start, height)
        self.bends = not np.array_equal(posture, start.q)
        bent = robot.snapshot(posture)
        self._kinds = {foot: contact_of(bent, foot) for foot in self._frames}
        self._exact_weight = w.swing
        self._over_weight = w.swing * np.array((1.0, 1.0, OVER, 1.0, 1.0, 1.0))
        self.weigh_swing(w.swing, w.lift)
        trunks = dict.fromkeys((BASE, heaviest_link(robot)))
        self._upright = {one: turned(-heading) @ start.rotation(one) for one in trunks}
        self._led: tuple[float, float] | None = None  # heading, and its rate
        inertia = robot.mass * height**2
        self._pressure = CopTask(robot, (*start.com[:2], 0.0), weight=w.com / height)
        self._height = ComTask(
            robot, start.com, axes=["z"], name="height", kp=w.stiff_height, weight=w.height
        )
        self._trunk = {
            one: OrientationTask(
                robot, one, start.rotation(one), name=one, kp=w.stiff_trunk, weight=w.trunk
            )
            for one in trunks
        }
        self._swing = {
            foot: PoseTask(
                robot,
                frame,
                start.position(frame),
                start.rotation(frame),
                name=f"{foot} foot",
                kp=w.stiff_swing,
                weight=w.swing,
            )
            for foot, frame in self._frames.items()
        }
        self._yaw = MomentumTask(robot, components=["kz"], name="yaw", weight=w.yaw / inertia)
        own: list[Task] = [
            self._pressure,
            self._height,
            *self._trunk.values(),
            MomentumTask(robot, components=["kx", "ky"], name="spin", weight=w.spin / inertia),
            self._yaw,
            PostureTask(robot, posture, kp=w.stiff_posture, weight=w.posture),
            *self._swing.values(),
        ]
        taken = [task.name for task in own]
        for one in tasks:
            if one.name in taken:
                raise InvalidInputError(
                    f"walker, tasks: a walk has a task {one.name!r} of its own; give yours another"
                    f" name than: {', '.join(taken)}"
                )
        self.controller = TorqueController(
            robot,
            [*own, *tasks],
            contacts=self._held(start, self._frames),
            limits=limits,
            constraints=constraints,
            dt=dt,
            **settings,
        )
        for task in self._swing.values():
            task.switch_off()
        self._swing_freely(robot)
        stuck = 1.0 - self.controller.friction_compensation
        bounds = self.controller.torque_bounds
        self.ahead = pressed_ahead(bent, bounds)
        self.lacks = lacks(bent, bounds, stuck, self.ahead)
        self.lasting = (self._height, *self._trunk.values(), *tasks)

    def _held(self, snapshot: Snapshot, feet: Iterable[str]) -> list[Contact]:
        return [
            self._kinds[foot].hold(snapshot, self._frames[foot], friction=self._friction)
            for foot in feet
        ]

    def _swing_freely(self, robot: Robot) -> None:
        """Let legs speed up as their torques allow, where no acceleration was given.

        By half of a hip's torque against a straight leg, as it can be counted on to brake, a G1's
        swings its foot ahead by 30 m/s^2 at most.
        """
        limits = self.controller.limits
        if limits is None or not limits.by_default or limits.speed_up is not None:
            return
        most = limits.acceleration.copy()
        for side in SIDES:
            for joint in leg_joints(robot, side):
                most[int(robot.model.idx_vs[joint]) - BASE_NV] = math.inf
        limits.speed_up = most

    def hold(self, snapshot: Snapshot, feet: Iterable[str], ramp: float) -> None:
        """Let feet bear from now on, where they are; others are relieved within ``ramp`` [s]."""
        feet = tuple(feet)
        self.controller.set_contacts(self._held(snapshot, feet), ramp=ramp)
        for foot in feet:
            self._swing[foot].switch_off()

    def weigh_swing(self, swing: float, lift: float) -> None:
        """Weigh feet in the air so from the next step on: in place, with their turn, and height."""
        turn = TURN * swing
        self._swing_weight = np.array((swing, swing, lift, turn, turn, turn))

    def swing(self, foot: str, pose: FootPose, *, exact: bool = False, over: bool = False) -> None:
        """Lead a foot through the air; ``exact``: to a place that counts, ``over`` edges or not."""
        task = self._swing[foot]
        if not task.weight.any():
            given = self._over_weight if over else self._exact_weight
            task.weight = given if exact else self._swing_weight
        task.set_target(*pose)

    def lead(
        self,
        snapshot: Snapshot,
        pressure: Array,
        height: SwingMotion,
        heading: float,
        turn: float,
    ) -> None:
        """Set the centre of pressure (3,) [m], the CoM's height [m], and the heading [rad].

        ``turn`` is the heading's rate [rad/s]. The angular momentum about the vertical is that of
        the whole body turning at this rate: held to zero, arms would turn back what legs turn.
        """
        self._pressure.set_target(pressure)
        self._height.set_target(*np.array([(0.0, 0.0, value) for value in height]))
        if self._led != (heading, turn):  # else the trunk is led there already
            self._led = heading, turn
            R, rate = turned(heading), turn * UP if turn else None
            for one, task in self._trunk.items():
                task.set_target(R @ self._upright[one], rate)
        spin = float(snapshot.inertia[2, 2]) * turn if turn else 0.0
        if spin != self._yaw.target[5]:
            self._yaw.set_target((0.0, 0.0, 0.0, 0.0, 0.0, spin))


def heaviest_link(robot: Robot) -> str:
    """Return the link that carries most mass by itself: the trunk, or what is fixed to it."""
    model = robot.model
    masses = [inertia.mass for inertia in model.inertias]
    joint = int(np.argmax(masses))
    if joint <= 1:
        return BASE
    bodies = [f for f in model.frames if f.parentJoint == joint and "BODY" in str(f.type)]
    return str(bodies[0].name)


def heading_of(rotations: Iterable[Array]) -> float:
    """Return the mean heading of frames' x axes [rad]."""
    ahead = np.sum([R[:2, 0] for R in rotations], axis=0)
    return math.atan2(ahead[1], ahead[0])
