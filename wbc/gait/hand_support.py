"""A hand as one more support: it reaches for a wall when soles alone will not catch the robot.

With the CoM c at the height h over the soles and omega^2 = g/h, soles stop a capture point
xi = c + c'/omega that is above them. One that a push carries beyond them towards a wall needs a
force from there: a force F at the height z_F of a hand moves the point where all contact forces
have no moment by F z_F / (M g) beyond the soles. So, one after the other,

    hands free   xi is evaluated in every tick
    reaching     xi is about to leave the soles: the hand that can be there first goes to the wall,
                 below its shoulder, on a minimum-jerk curve as quick as the shoulder's torque
                 allows; its goal is updated in every tick for the shoulder's position at contact,
                 predicted by the CoM's velocity
    leaning      it touches: a contact (:class:`~wbc.constraints.PointContact`) with the wall's
                 normal and friction, whose force the QP of the tick chooses with the soles'
    withdrawing  xi is well inside all edges of the soles again: the contact is unloaded, the hand
                 leaves the wall

From the reach to the release a task holds the trunk's orientation of the start: the CoM's task
alone would throw the trunk towards the wall, for its angular momentum, and the head would hit it.
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
from wbc.gait.hand_states import HandsFree, Leaning, LeanSettings, Reaching, Withdrawing
from wbc.gait.soles import capture_point, standing_soles
from wbc.gait.swing import SPEED_UP, SwingMotion, towards
from wbc.gait.walls import Hand, Wall, check_hands, check_reach, check_walls
from wbc.kinds import check_kind, whole_number
from wbc.minimum_jerk import PEAK
from wbc.polygon import convex_hull, polygon_margin
from wbc.robot import Snapshot
from wbc.tasks import AxisTask, OrientationTask, PositionTask, Task
from wbc.validate import Array

UP = np.array((0.0, 0.0, 1.0))
# A hand that has not touched the wall this long after the planned time gives up [s].
REACH_TIMEOUT = 0.3
# A leaning hand that is farther from its wall than this [m] has lost contact.
LOST_GAP = 0.02
# A released hand retreats by this distance [m] in this time [s], before the posture takes over.
RETREAT, RETREAT_TIME = 0.06, 0.3
# Shortest lean [s]: the capture point jumps at the impact.
MIN_LEAN_TIME = 0.1
# The trunk is held until the CoM's speed normal to the wall is below this [m/s]. Released with the
# hand, the trunk was thrown by 0.9 rad towards the wall; held until the CoM was at rest, a robot
# lacked its momentum and fell backwards, along the wall.
SWAY_SPEED = 0.25


class HandSupport:
    """Leans on walls with a hand where soles alone do not catch the robot.

    The controller drives the CoM itself (a CoM task with a capture point's law, say); this is
    called before each of its ticks.

    Parameters
    ----------
    controller:
        Gets tasks for hands and trunk, switched off until needed, and the contact of a hand.
    start:
        The robot as it stands; a warning is logged where it already is so near to the edge of its
        soles that a hand reaches without a push.
    hands:
        What it leans with.
    walls:
        With their friction.
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
        check_kind("hand support, settings", settings, LeanSettings, "LeanSettings()", or_none=True)
        self.controller, self.settings = controller, settings or LeanSettings()
        able = controller.torque_bounds, controller.limits
        self.arms = {hand: Arm.of(robot, hand.frame, *able) for hand in hands}
        self.state: HandsFree | Reaching | Leaning | Withdrawing = HandsFree()
        self.time, self._dt = 0.0, controller.dt
        self._notes: list[str] = []
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
        return tuple(self._notes)

    def beyond(self, snapshot: Snapshot, wall: Wall) -> float:
        """Return how far the capture point is beyond the soles, towards a wall [m].

        Negative inside; minus infinity without soles on the ground.
        """
        found = self._soles_and_dcm(snapshot)
        if found is None:
            return -math.inf
        corners, dcm = found
        horizontal = wall.normal[:2] / np.linalg.norm(wall.normal[:2])
        return float((corners @ horizontal).min() - dcm @ horizontal)

    def _soles_and_dcm(self, snapshot: Snapshot) -> tuple[Array, Array] | None:
        """Return the corners (k, 2) of the soles that stand, and the capture point (2,) [m]."""
        hands = {hand.frame for hand in self.arms}
        soles = standing_soles(self.controller.contacts)
        corners = [one.measured(snapshot) for one in soles if one.contact.frame not in hands]
        if not corners:
            return None
        points = np.concatenate(corners)
        height = max(float(snapshot.com[2] - points[:, 2].mean()), LOST_GAP)
        return points[:, :2], capture_point(snapshot, height)[0]

    def _margin_inside(self, snapshot: Snapshot) -> float:
        """Return how far the capture point is inside the polygon of the soles [m]."""
        found = self._soles_and_dcm(snapshot)
        if found is None:
            return -math.inf
        return float(polygon_margin(convex_hull(found[0]), found[1]))

    def prepare(self, snapshot: Snapshot, periods: int = 1) -> None:
        """Set goals and contacts for the tick of a measured state.

        Parameters
        ----------
        periods:
            Of the controller since the last call: more than one where frames were lost.

        Raises
        ------
        InvalidInputError
            Not a snapshot, or one of another robot object; no number of periods.
        """
        check_snapshot(self.controller.robot, snapshot)
        self._dt = whole_number("hand support, periods", periods, least=1) * self.controller.dt
        before = self.state
        match before:
            case HandsFree():
                first = self._choose_hand(snapshot)
                self.state = before if first is None else self._start_reaching(first)
            case Reaching():
                self.state = self._update_reaching(snapshot, before)
            case Leaning():
                self.state = self._update_leaning(snapshot, before)
            case Withdrawing():
                self.state = self._update_withdrawing(snapshot, before)
        self.time += self._dt

    # ------------------------------------------------------------------ from state to state

    def _choose_hand(self, snapshot: Snapshot) -> Reaching | None:
        """Return the plan of the hand that is first at a wall, if one is needed and in reach."""
        held = {one.name for one in self.controller.contacts}  # of withdrawing hands, too
        for k, wall in enumerate(self.walls):
            if self.beyond(snapshot, wall) <= -self.settings.begin:
                self._beyond_reach.discard(k)
                continue
            free = [hand for hand in self.arms if hand.frame not in held]
            plans = [self._plan_reach(snapshot, hand, wall) for hand in free]
            feasible = [plan for plan in plans if plan is not None]
            if not feasible:
                if free and k not in self._beyond_reach:
                    self._note(f"no hand can reach wall {k}, towards which the robot falls")
                    self._beyond_reach.add(k)
                continue
            return min(feasible, key=lambda plan: plan.left)
        return None

    def _start_reaching(self, first: Reaching) -> Reaching:
        """Switch on the tasks of a reaching hand."""
        hand, own = first.hand, self.settings
        self._reach[hand].set_target(*first.motion)
        self._point[hand].set_target(-first.wall.normal)
        _switch_on(self._reach[hand], own.weight)
        _switch_on(self._point[hand], own.axis)
        _switch_on(self._trunk[self.arms[hand].trunk], own.trunk)
        self._note(f"{hand.frame} reaches for a wall, in {first.left:.2f} s")
        return first

    def _plan_reach(self, snapshot: Snapshot, hand: Hand, wall: Wall) -> Reaching | None:
        """Return the plan of a hand's reach for a wall; None if that is out of reach."""
        arm, position = self.arms[hand], snapshot.position(hand.frame)
        left = 0.0
        for _ in range(3):  # fixed point: the goal depends on the time of contact
            goal, shoulder = self._goal(snapshot, hand, wall, left)
            distance = float(np.linalg.norm(goal - position))
            by_acceleration = math.sqrt(PEAK_ACCELERATION * distance / arm.acceleration)
            left = max(PEAK * distance / arm.speed, by_acceleration)
        if float(np.linalg.norm(goal - shoulder)) > arm.length:
            return None
        velocity = snapshot.jacobian(hand.frame)[:3] @ snapshot.v
        return Reaching(hand, wall, SwingMotion(position, velocity, np.zeros(3)), left)

    def _goal(self, snapshot: Snapshot, hand: Hand, wall: Wall, left: float) -> tuple[Array, Array]:
        """Return the point (3,) that the hand should touch, and the shoulder's place then [m]."""
        arm = self.arms[hand]
        shoulder = snapshot.position(arm.shoulder) + max(left, 0.0) * snapshot.com_velocity
        aim = shoulder - self.settings.below * arm.length * UP
        return wall.touched(aim, hand.radius), shoulder

    def _update_reaching(self, snapshot: Snapshot, now: Reaching) -> HandsFree | Reaching | Leaning:
        hand, wall, dt, own = now.hand, now.wall, self._dt, self.settings
        place = snapshot.position(hand.frame)
        gap = wall.gap(place, hand.radius)
        if gap <= own.touch:
            contact = PointContact(
                self.controller.robot, hand.frame, place - gap * wall.normal,
                snapshot.rotation(hand.frame), normal=wall.normal,
                friction=FrictionCone(wall.friction),
            )  # fmt: skip
            self._reach[hand].switch_off()
            self.controller.set_contacts([*self._active_contacts(), contact], ramp=own.ramp)
            self._note(f"{hand.frame} leans on the wall")
            return Leaning(hand, wall, contact)
        left = now.left - dt
        if left < -REACH_TIMEOUT:
            distance = math.dist(place, wall.touched(place, hand.radius))
            self._note(f"{hand.frame} missed the wall: {1e3 * distance:.0f} mm off")
            self._release(hand)
            return HandsFree()
        if left > 0.0:
            goal, _ = self._goal(snapshot, hand, wall, left)
            goal += wall.beside(place) * wall.normal  # or a hand would come to a rail from below
            motion = towards(now.motion, goal, now.left, dt)
        else:
            motion = _approach(now.motion, -own.late * wall.normal, dt)
        self._reach[hand].set_target(*motion)
        return now._replace(motion=motion, left=left)

    def _update_leaning(self, snapshot: Snapshot, now: Leaning) -> Leaning | Withdrawing:
        hand, wall, own = now.hand, now.wall, self.settings
        place = snapshot.position(hand.frame)
        lost = wall.gap(place, hand.radius) > LOST_GAP
        recovered = self._margin_inside(snapshot) > own.end and now.time > MIN_LEAN_TIME
        if not lost and not recovered:
            return now._replace(time=now.time + self._dt)
        self._released += (now.contact,)
        self.controller.set_contacts(self._active_contacts(), ramp=own.ramp)
        reason = "lost the wall" if lost else "is released"
        self._note(f"{hand.frame} {reason} after {now.time:.2f} s")
        self._point[hand].switch_off()
        motion = SwingMotion.rest(place)
        self._reach[hand].set_target(*motion)
        _switch_on(self._reach[hand], own.weight)
        return Withdrawing(hand, wall, motion, place + RETREAT * wall.normal, RETREAT_TIME)

    def _update_withdrawing(
        self, snapshot: Snapshot, now: Withdrawing
    ) -> HandsFree | Withdrawing | Reaching:
        plan = self._choose_hand(snapshot)
        if plan is not None:  # another hand's trunk may be another link
            self._release(now.hand)
            return self._start_reaching(plan)
        dt = self._dt
        if now.left <= dt:
            self._reach[now.hand].switch_off()
            if abs(float(snapshot.com_velocity @ now.wall.normal)) < SWAY_SPEED:
                self._release(now.hand)
                return HandsFree()
            return now
        motion = towards(now.motion, now.goal, now.left, dt)
        self._reach[now.hand].set_target(*motion)
        return now._replace(motion=motion, left=now.left - dt)

    def _active_contacts(self) -> list[Task]:
        """Return the contacts without those of released hands that are still ramping down."""
        held = self.controller.contacts
        self._released = tuple(one for one in self._released if one in held)
        return [one for one in held if one not in self._released]

    def _release(self, hand: Hand) -> None:
        """Switch off the tasks of a hand and its trunk."""
        self._reach[hand].switch_off()
        self._point[hand].switch_off()
        self._trunk[self.arms[hand].trunk].switch_off()

    def _note(self, what: str) -> None:
        self._notes.append(f"{self.time:.3f} s: {what}")


def _approach(now: SwingMotion, velocity_goal: Array, dt: float) -> SwingMotion:
    """Return the motion of a late hand ``dt`` later, accelerated to a velocity (3,)."""
    change = velocity_goal - now.rate
    limit = SPEED_UP * dt
    change *= limit / max(limit, float(np.linalg.norm(change)))
    velocity = now.rate + change
    return SwingMotion(now.value + velocity * dt, velocity, change / dt)


def _switch_on(task: Task, weight: float) -> None:
    """Give a task its weight, if it is off."""
    if not task.weight.any():
        task.weight = weight
