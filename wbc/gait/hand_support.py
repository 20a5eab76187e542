"""A hand as one more support: it reaches for a wall when soles alone will not catch the robot.

With the CoM c at the height h over the soles and omega^2 = g/h, soles stop a capture point
xi = c + c'/omega that is above them. One that a push carries beyond them towards a wall needs a
force from there: a force F at the height z_F of a hand moves the point where all contact forces
have no moment by F z_F / (M g) beyond the soles. So, one after the other,

    watching     xi is looked at, in every tick
    reaching     it is about to leave the soles: the hand that is sooner there goes to the wall
                 below its shoulder, on a curve of least jerk, as quick as the shoulder's torque is;
                 its place is chosen anew in every tick, for where the CoM's velocity takes the
                 shoulder
    leaning      it touches: a contact (:class:`~wbc.constraints.PointContact`) with the wall's
                 normal and friction, which the QP of the tick loads as it needs, with the soles
    withdrawing  xi is well above the soles again, from all of their edges: the contact is relieved,
                 the hand leaves the wall

From the reach to the release the trunk is kept as it was at the start: without a wall it is thrown
the way the robot falls, for its angular momentum, and would meet the wall with the head.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence

import numpy as np

from wbc.constraints import PointContact
from wbc.constraints.friction import FrictionCone
from wbc.controllers.checks import check_snapshot
from wbc.controllers.torque import TorqueController
from wbc.errors import InvalidInputError, shown
from wbc.gait.arms import Arm
from wbc.gait.command import PEAK_ACCELERATION
from wbc.gait.leaning import HandsFree, Leaning, LeanSettings, Reaching, Withdrawing
from wbc.gait.soles import capture_point, standing_soles
from wbc.gait.swing import SPEED_UP, SwingMotion, towards
from wbc.gait.walls import Hand, Wall, check_hands, check_reach, check_walls
from wbc.minimum_jerk import PEAK
from wbc.polygon import convex_hull, polygon_margin
from wbc.robot import Snapshot
from wbc.tasks import AxisTask, OrientationTask, PositionTask, Task
from wbc.validate import Array

UP = np.array((0.0, 0.0, 1.0))
# A hand that has not met the wall so long after it should have goes back [s].
PATIENCE = 0.3
# A hand that leans and is farther from its wall than this [m] has lost it.
LOST = 0.02
# A hand that is released goes back so far [m] in such a time [s], before it is left to the posture.
AWAY, AWAY_TIME = 0.06, 0.3
# A hand leans at least so long [s]: as it meets the wall the capture point jumps.
LEAST_LEAN = 0.1
# The trunk is held up until the CoM goes away from the wall, or to it, no faster than this [m/s].
# Let go with the hand, it was thrown by 0.9 rad at the wall that the robot swung away from; held
# until the CoM is at rest, it was missed by a robot that then fell backwards, along the wall.
CALM = 0.25


class HandSupport:
    """Leans on walls with a hand where soles alone do not catch the robot.

    It serves a controller that drives the CoM by itself (a task for it with a capture point's law,
    say), and is called before each of its ticks.

    Parameters
    ----------
    controller:
        Gets tasks for hands and trunk, off until they are needed, and the contact of a hand.
    start:
        The robot as it stands; a warning is logged where it already is so near to the edge of its
        soles that a hand reaches without a push.
    hands:
        What it leans with.
    walls:
        Where they are; their friction is what is counted on.
    settings:
        When and how.

    Attributes
    ----------
    state:
        :class:`HandsFree`, :class:`Reaching`, :class:`Leaning` or :class:`Withdrawing`.
    time:
        Of the ticks prepared so far [s].

    Raises
    ------
    InvalidInputError
        Not a torque controller; no hands or no walls, or what is none; a hand without an arm, a
        wall that no arm can reach, or one that is in a hand's way already.
    UnknownNameError
        No such frame.
    """

    def __init__(
        self,
        controller: TorqueController,
        start: Snapshot,
        hands: Sequence[Hand],
        walls: Sequence[Wall],
        settings: LeanSettings | None = None,
    ) -> None:
        if not isinstance(controller, TorqueController):
            raise InvalidInputError(
                "hand support: expected a TorqueController, whose contacts bear forces, got"
                f" {shown(controller)}"
            )
        robot = controller.robot
        check_snapshot(robot, start)
        hands, self.walls = check_hands("hand support", hands), check_walls("hand support", walls)
        for kind, given in (("hands", hands), ("walls", self.walls)):
            if not given:
                raise InvalidInputError(f"hand support, {kind}: there are none to lean with or on")
        if not isinstance(settings, LeanSettings | None):
            raise InvalidInputError(
                f"hand support, settings: expected LeanSettings(...), got {shown(settings)}"
            )
        self.controller, self.settings = controller, settings or LeanSettings()
        self.arms = {hand: Arm.of(robot, hand.frame) for hand in hands}
        self.state: HandsFree | Reaching | Leaning | Withdrawing = HandsFree()
        self.time = 0.0
        self._told: list[str] = []
        self._beyond_reach = set[int]()
        self._released: tuple[PointContact, ...] = ()  # and maybe still held while a ramp runs
        own = self.settings
        check_reach(self.walls, self.arms, start, own.touch)
        for k, wall in enumerate(self.walls):
            inside = -self.beyond(start, wall)
            if inside <= own.begin:
                logging.getLogger(__name__).warning(
                    "hand support: at the start the capture point is %.0f mm inside of the edge of"
                    " the soles towards wall %d, and hands reach at %.0f mm: without a push, too;"
                    " stand farther inside, or make begin smaller",
                    *(1e3 * inside, k, 1e3 * own.begin),
                )
        self._reach = {
            hand: PositionTask(
                robot, hand.frame, start.position(hand.frame), name=f"{hand.frame} reach",
                kp=own.stiffness, weight=own.weight,
            )
            for hand in hands
        }  # fmt: skip
        self._point = {
            hand: AxisTask(
                robot, hand.frame, -self.walls[0].normal, axis=arm.pointing,
                name=f"{hand.frame} pointing", kp=own.stiffness, weight=own.axis,
            )
            for hand, arm in self.arms.items()
        }  # fmt: skip
        self._trunk = {
            trunk: OrientationTask(
                robot, trunk, start.rotation(trunk), name=f"{trunk} by a wall",
                kp=own.stiff_trunk, weight=own.trunk,
            )
            for trunk in dict.fromkeys(arm.trunk for arm in self.arms.values())
        }  # fmt: skip
        tasks = (*self._reach.values(), *self._point.values(), *self._trunk.values())
        controller.change(tasks=[*controller.tasks, *tasks])
        for task in tasks:
            task.switch_off()

    @property
    def notes(self) -> tuple[str, ...]:
        """What hands did, in words."""
        return tuple(self._told)

    def beyond(self, snapshot: Snapshot, wall: Wall) -> float:
        """Return how far the capture point is beyond the soles, towards a wall [m].

        Negative is inside; without soles on the ground it is infinitely far inside.
        """
        found = self._soles_and_dcm(snapshot)
        if found is None:
            return -math.inf
        corners, dcm = found
        level = wall.normal[:2] / np.linalg.norm(wall.normal[:2])
        return float((corners @ level).min() - dcm @ level)

    def _soles_and_dcm(self, snapshot: Snapshot) -> tuple[Array, Array] | None:
        """Return the corners (k, 2) of the soles that stand, and the capture point (2,) [m]."""
        hands = {hand.frame for hand in self.arms}
        soles = standing_soles(self.controller.contacts)
        corners = [one.measured(snapshot) for one in soles if one.contact.frame not in hands]
        if not corners:
            return None
        points = np.concatenate(corners)
        height = max(float(snapshot.com[2] - points[:, 2].mean()), LOST)
        return points[:, :2], capture_point(snapshot, height)[0]

    def _inside(self, snapshot: Snapshot) -> float:
        """Return how far the capture point is inside the polygon of the soles [m]."""
        found = self._soles_and_dcm(snapshot)
        if found is None:
            return -math.inf
        return float(polygon_margin(convex_hull(found[0]), found[1]))

    def prepare(self, snapshot: Snapshot) -> None:
        """Set goals and contacts for the tick of a measured state.

        Raises
        ------
        InvalidInputError
            Not a snapshot, or one of another robot object.
        """
        check_snapshot(self.controller.robot, snapshot)
        before = self.state
        match before:
            case HandsFree():
                first = self._chosen(snapshot)
                self.state = before if first is None else self._begin(first)
            case Reaching():
                self.state = self._reached(snapshot, before)
            case Leaning():
                self.state = self._leant(snapshot, before)
            case Withdrawing():
                self.state = self._withdrawn(snapshot, before)
        self.time += self.controller.dt

    # ------------------------------------------------------------------ from state to state

    def _chosen(self, snapshot: Snapshot) -> Reaching | None:
        """Return the hand that has to reach for a wall now, if one has to and can."""
        held = {one.name for one in self.controller.contacts}  # by hands that leave a wall, too
        for k, wall in enumerate(self.walls):
            if self.beyond(snapshot, wall) <= -self.settings.begin:
                self._beyond_reach.discard(k)
                continue
            free = [hand for hand in self.arms if hand.frame not in held]
            found = [self._begun(snapshot, hand, wall) for hand in free]
            able = [one for one in found if one is not None]
            if not able:
                if free and k not in self._beyond_reach:
                    self._tell(f"no hand can reach wall {k}, towards which the robot falls")
                    self._beyond_reach.add(k)
                continue
            return min(able, key=lambda one: one.left)
        return None

    def _begin(self, first: Reaching) -> Reaching:
        """Switch on what a hand needs that reaches for a wall."""
        hand, own = first.hand, self.settings
        self._reach[hand].set_target(*first.motion)
        self._point[hand].set_target(-first.wall.normal)
        _weigh(self._reach[hand], own.weight)
        _weigh(self._point[hand], own.axis)
        _weigh(self._trunk[first.arm.trunk], own.trunk)
        self._tell(f"{hand.frame} reaches for a wall, in {first.left:.2f} s")
        return first

    def _begun(self, snapshot: Snapshot, hand: Hand, wall: Wall) -> Reaching | None:
        """Return a hand on its way to a wall; None if it cannot get there."""
        arm, place = self.arms[hand], snapshot.position(hand.frame)
        left = 0.0
        for _ in range(3):  # where it goes depends on when
            goal, shoulder = self._goal(snapshot, arm, hand, wall, left)
            way = float(np.linalg.norm(goal - place))
            quick = math.sqrt(PEAK_ACCELERATION * way / arm.acceleration)
            left = max(PEAK * way / arm.speed, quick)
        if float(np.linalg.norm(goal - shoulder)) > arm.length:
            return None
        velocity = snapshot.jacobian(hand.frame)[:3] @ snapshot.v
        return Reaching(arm, hand, wall, SwingMotion(place, velocity, np.zeros(3)), left)

    def _goal(
        self, snapshot: Snapshot, arm: Arm, hand: Hand, wall: Wall, left: float
    ) -> tuple[Array, Array]:
        """Return where the hand should touch (3,), and where its shoulder will then be [m]."""
        shoulder = snapshot.position(arm.shoulder) + max(left, 0.0) * snapshot.com_velocity
        aim = shoulder - self.settings.below * arm.length * UP
        return wall.touched(aim, hand.radius), shoulder

    def _reached(self, snapshot: Snapshot, now: Reaching) -> HandsFree | Reaching | Leaning:
        hand, wall, dt, own = now.hand, now.wall, self.controller.dt, self.settings
        place = snapshot.position(hand.frame)
        gap = wall.gap(place, hand.radius)
        if gap <= own.touch:
            contact = PointContact(
                self.controller.robot, hand.frame, place - gap * wall.normal,
                snapshot.rotation(hand.frame), normal=wall.normal,
                friction=FrictionCone(wall.friction),
            )  # fmt: skip
            self._reach[hand].switch_off()
            self.controller.set_contacts([*self._wanted(), contact], ramp=own.ramp)
            self._tell(f"{hand.frame} leans on the wall")
            return Leaning(now.arm, hand, wall, contact)
        left = now.left - dt
        if left < -PATIENCE:
            off = math.dist(place, wall.touched(place, hand.radius))
            self._tell(f"{hand.frame} missed the wall: {1e3 * off:.0f} mm off")
            self._rest(hand)
            return HandsFree()
        if left > 0.0:
            goal, _ = self._goal(snapshot, now.arm, hand, wall, left)
            motion = towards(now.motion, goal, now.left, dt)
        else:
            motion = _onwards(now.motion, -own.late * wall.normal, dt)
        self._reach[hand].set_target(*motion)
        return now._replace(motion=motion, left=left)

    def _leant(self, snapshot: Snapshot, now: Leaning) -> Leaning | Withdrawing:
        hand, wall, own = now.hand, now.wall, self.settings
        place = snapshot.position(hand.frame)
        lost = wall.gap(place, hand.radius) > LOST
        back = self._inside(snapshot) > own.end and now.time > LEAST_LEAN
        if not lost and not back:
            return now._replace(time=now.time + self.controller.dt)
        self._released += (now.contact,)
        self.controller.set_contacts(self._wanted(), ramp=own.ramp)
        why = "lost the wall" if lost else "is released"
        self._tell(f"{hand.frame} {why} after {now.time:.2f} s")
        self._point[hand].switch_off()
        back_from = SwingMotion.rest(place)
        self._reach[hand].set_target(*back_from)
        _weigh(self._reach[hand], own.weight)
        return Withdrawing(hand, wall, back_from, place + AWAY * wall.normal, AWAY_TIME)

    def _withdrawn(
        self, snapshot: Snapshot, now: Withdrawing
    ) -> HandsFree | Withdrawing | Reaching:
        again = self._chosen(snapshot)
        if again is not None:  # another hand's trunk may be another link
            self._rest(now.hand)
            return self._begin(again)
        dt = self.controller.dt
        if now.left <= dt:
            self._reach[now.hand].switch_off()
            if abs(float(snapshot.com_velocity @ now.wall.normal)) < CALM:
                self._rest(now.hand)
                return HandsFree()
            return now
        motion = towards(now.motion, now.goal, now.left, dt)
        self._reach[now.hand].set_target(*motion)
        return now._replace(motion=motion, left=now.left - dt)

    def _wanted(self) -> list[Task]:
        """Return what is held, without the hands that were released and whose force still goes."""
        held = self.controller.contacts
        self._released = tuple(one for one in self._released if one in held)
        return [one for one in held if one not in self._released]

    def _rest(self, hand: Hand) -> None:
        """Leave hand and trunk to the other tasks."""
        self._reach[hand].switch_off()
        self._point[hand].switch_off()
        self._trunk[self.arms[hand].trunk].switch_off()

    # ------------------------------------------------------------------ checks, words

    def _tell(self, what: str) -> None:
        self._told.append(f"{self.time:.3f} s: {what}")


def _onwards(now: SwingMotion, wanted: Array, dt: float) -> SwingMotion:
    """Return the motion ``dt`` later of a late hand that takes up the velocity (3,) wanted."""
    change = wanted - now.rate
    most = SPEED_UP * dt
    change *= most / max(most, float(np.linalg.norm(change)))
    velocity = now.rate + change
    return SwingMotion(now.value + velocity * dt, velocity, change / dt)


def _weigh(task: Task, weight: float) -> None:
    """Switch a task on."""
    if not task.weight.any():
        task.weight = weight
