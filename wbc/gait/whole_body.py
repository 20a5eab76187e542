"""The tasks and contacts by which a whole body walks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from wbc.constraints import Limits
from wbc.constraints.friction import FrictionCone
from wbc.constraints.rows import Constraint
from wbc.constraints.sole_contacts import contact_kind
from wbc.controllers.torque import TorqueController
from wbc.errors import InvalidInputError
from wbc.gait.ability import leg_limits, pressure_offset
from wbc.gait.arms import link_of
from wbc.gait.crouch import walking_posture
from wbc.gait.legs import SIDES, Legs
from wbc.gait.phases import Place
from wbc.gait.swing import FootPose, SwingMotion, turned
from wbc.robot import Robot, Snapshot
from wbc.robot.chains import leg_joints
from wbc.robot.limits import BASE_NV
from wbc.robot.names import BASE
from wbc.tasks import ComTask, CopTask, MomentumTask, OrientationTask, PoseTask, PostureTask, Task
from wbc.validate import check_fields, read_only

UP = np.array((0.0, 0.0, 1.0))
# Acceleration of a foot by its hips, in units of gravity, from which on ``WalkingWeights.lift`` is
# not reduced. G1 has 5.5, TALOS 4.05, Romeo 1.8: pushed to its right half way through a step, Romeo
# falls with the full weight, and walks on with 0.45 of it.
REFERENCE_HIPS = 4.0
# Weight of the swing foot's orientation, as a ratio of its place's.
ORIENTATION_SHARE = 0.3
# Likewise of its height, where it lands on a footstep beyond an edge.
EDGE_HEIGHT_FACTOR = 3.0


@dataclass(frozen=True)
class WalkingWeights:
    """Weights and stiffnesses of a walk's tasks.

    CoP before trunk: a CoP can be had by accelerating the CoM or by turning the trunk, and only the
    first moves the robot. So the trunk's weight is high: at a sixth of it, pushes of 20 N s threw a
    G1's trunk to its limits.

    CoP before swing foot: at a fifth of the CoP's weight, a G1's foot at 60 m/s^2 got 0.4 m/s^2
    more, and the CoP was 5 cm off.

    The swing foot's height before its place: a foot that is 8 mm too high lands 60 ms late, in
    which the capture point's error grows by a quarter. At equal weights, a G1's leg swung at 70
    m/s^2 drew its foot down by 25 m/s^2, and held it up as it slowed; at three times, its foot in a
    recovery step was 3 cm lower than planned, scuffed and landed 0.4 m short. On prescribed
    footsteps both weigh the same: with a high weight for the height a small humanoid's feet landed
    4 mm from them in place of 2. Over edges the height weighs three times as much: at equal
    weights, down stairs of 15 cm, where the stance ankle is at its limit, a G1's foot was drawn
    2 cm too low, landed 0.1 s early and threw the CoM up.

    The swing foot's place before its orientation: ankles and hips at their bounds held back a leg
    that swings sideways in a recovery step. Of 190 m/s^2 asked of a G1's late foot it got 11, and
    100 with a tenth of the weight for its orientation.

    The vertical disturbance grows with the speed of the swing, and weak hips that hold the foot up
    throw the pelvis over: ``lift`` is reduced in proportion for hips with less acceleration than
    :data:`REFERENCE_HIPS` (:meth:`for_legs`).

    The CoM's height before the swing foot: a hip at its bound can accelerate the foot by letting
    the robot fall, and weak knees do not lift it again. Of 10 walks of a Romeo that was pushed
    sideways late in a step 6 stood at half the weight, 9 with this one.

    The swing leg's angular momentum is nearly free: regulated to zero it would move the CoP by more
    than the length of a sole. About the vertical only friction holds a foot, so that is regulated,
    with a high weight, to the momentum of the whole body turning as commanded: at a friction of 0.4
    a G1's foot turned by 5 degrees in a step at a ninth of the weight, by 3 at two thirds, and by 1
    with it (means of four seeds). At a third more the CoP was 9 mm off in recovery steps, in place
    of 7.

    Attributes
    ----------
    com, height, swing, lift:
        Of the CoM's horizontal motion (by the centre of pressure), of its height, of the swing
        foot's place, and of its height [1/(m/s)].
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
        """Return the weights with ``lift`` reduced for weak hips."""
        ratio = min(1.0, legs.swing_acceleration / (REFERENCE_HIPS * legs.gravity))
        return replace(self, lift=ratio * self.lift)


class WholeBody:
    """Tasks for pressure, height, trunk, feet and posture, and the controller that has them.

    ``controller``: the :class:`~wbc.controllers.torque.TorqueController`.
    ``lasting``: its tasks that have a target in all phases.
    ``bends``: whether the robot starts on straight legs, which are bent first.
    ``pressure_offset``: of the CoP ahead of the soles' middles, for weak ankles [m].
    ``limitations``: what limits the legs in walking, in words.
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
        self._frames = {foot: sole.frame for foot, sole in robot.feet.items()}
        posture = walking_posture(start, height)
        self.bends = not np.array_equal(posture, start.q)
        bent = robot.snapshot(posture)
        self._contacts = {
            foot: contact_kind(bent, frame).hold(start, frame, friction=friction)
            for foot, frame in self._frames.items()
        }
        self._prescribed_weight = w.swing
        self._edge_weight = w.swing * np.array((1.0, 1.0, EDGE_HEIGHT_FACTOR, 1.0, 1.0, 1.0))
        self.set_swing_weights(w.swing, w.lift)
        trunks = dict.fromkeys((BASE, heaviest_link(robot)))
        self._upright = {link: turned(-heading) @ start.rotation(link) for link in trunks}
        self._trunk_target: tuple[float, float] | None = None  # heading, and its rate
        inertia = robot.mass * height**2
        self._pressure = CopTask(robot, (*start.com[:2], 0.0), weight=w.com / height)
        self._height = ComTask(
            robot, start.com, axes=["z"], name="height", kp=w.stiff_height, weight=w.height
        )
        self._trunk = {
            link: OrientationTask(
                robot, link, start.rotation(link), name=link, kp=w.stiff_trunk, weight=w.trunk
            )
            for link in trunks
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
        for task in tasks:
            if task.name in taken:
                raise InvalidInputError(
                    f"walker, tasks: a walk has a task {task.name!r} of its own; give yours another"
                    f" name than: {', '.join(taken)}"
                )
        self.controller = TorqueController(
            robot,
            [*own, *tasks],
            contacts=[*self._contacts.values()],
            limits=limits,
            constraints=constraints,
            dt=dt,
            **settings,
        )
        for frame in self.controller.slacks.weights.keys() & self._frames.values():
            raise InvalidInputError(
                f"walker, slack: {frame!r} is a sole, whose contact comes and goes; leave it out:"
                " constraints may have slack"
            )
        self._in_air: str | None = None  # the foot whose task has weight
        for task in self._swing.values():
            task.switch_off()
        self._free_leg_acceleration(robot)
        # Plans for all supports, in both orders while forces ramp: the first steps take no longer.
        both = tuple(self._contacts.values())
        for contacts in (*((one,) for one in both), both[::-1], both):
            self.controller.set_contacts(contacts)
        stuck = 1.0 - self.controller.friction_compensation
        bounds = self.controller.torque_bounds
        self.pressure_offset = pressure_offset(bent, bounds)
        self.limitations = leg_limits(bent, bounds, stuck, self.pressure_offset)
        self.lasting = (self._height, *self._trunk.values(), *tasks)

    def _free_leg_acceleration(self, robot: Robot) -> None:
        """Lift the default limit on speeding up of the legs' joints, leaving their torques.

        That default, half of a hip's torque against a straight leg, is for braking; it would limit
        a G1's swing foot to 30 m/s^2.
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
        """Make contacts of these feet, where they are; others are unloaded within ``ramp`` [s]."""
        feet, self._in_air = tuple(feet), None
        for foot in feet:
            self._contacts[foot].move_to(snapshot)
            self._swing[foot].switch_off()
        self.controller.set_contacts([self._contacts[foot] for foot in feet], ramp=ramp)

    def set_swing_weights(self, swing: float, lift: float) -> None:
        """Set the swing foot's weights for place and height from the next step on."""
        turn = ORIENTATION_SHARE * swing
        self._swing_weight = np.array((swing, swing, lift, turn, turn, turn))

    def swing(self, foot: str, pose: FootPose, *, exact: bool = False, over: bool = False) -> None:
        """Set a swing foot's target; ``exact``: to a prescribed footstep, ``over`` edges or not."""
        task = self._swing[foot]
        if self._in_air != foot:
            self._in_air = foot
            given = self._edge_weight if over else self._prescribed_weight
            task.weight = given if exact else self._swing_weight
        task._follow(*pose)

    def set_targets(
        self, snapshot: Snapshot, pressure: Place, height: SwingMotion, heading: float, turn: float
    ) -> None:
        """Set the centre of pressure (3,) [m], the CoM's height [m], and the heading [rad].

        ``turn`` is the heading's rate [rad/s]. The angular momentum about the vertical is that of
        the whole body turning at this rate: held to zero, arms would turn back what legs turn.
        """
        about = read_only(np.array((*pressure, 0.0)))
        self._pressure._follow(about[:3], about)
        motion = np.zeros((3, 3))
        motion[:, 2] = height
        self._height._follow(*read_only(motion))
        if self._trunk_target != (heading, turn):  # else it is set already
            self._trunk_target = heading, turn
            R, rate = turned(heading), turn * UP if turn else None
            for link, task in self._trunk.items():
                task.set_target(R @ self._upright[link], rate)
        spin = float(snapshot.inertia[2, 2]) * turn if turn else 0.0
        if spin != self._yaw.target[5]:
            self._yaw.set_target((0.0, 0.0, 0.0, 0.0, 0.0, spin))


def heaviest_link(robot: Robot) -> str:
    """Return the link of the joint with most mass, without its children: usually the trunk."""
    return link_of(robot, int(np.argmax([inertia.mass for inertia in robot.model.inertias])))
