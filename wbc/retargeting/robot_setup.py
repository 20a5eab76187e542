"""What retargeting derives from a robot alone, cached for the last few robots."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.constraints import BrakingParameters, SelfCollision
from wbc.errors import ModelError, listed
from wbc.gait.legs import SIDES, Legs, check_biped, hip_and_ankle, knees_one_way, standing_heading
from wbc.retargeting.body_map import BodyMap, body_map
from wbc.retargeting.scaling import StandingBody, standing_body
from wbc.robot import Robot
from wbc.robot.chains import leg_joints
from wbc.robot.formats.description import reduced_model
from wbc.robot.limits import JointLimits
from wbc.robot.names import BASE
from wbc.robot.postures import STANDING
from wbc.validate import Array, by_name

NO_SELF_COLLISION = "bodies are not kept apart"  # begins the note that says why
# Targets do not run into margins, so a body near one may pass it fast.
BRAKING = BrakingParameters(deceleration=50.0, gain=1.0)

# Places of a leg that are this part of its height below the hip, or less, are beside the hips,
# which no step brings apart.
HIPS = 0.2


@dataclass(frozen=True, eq=False)
class FixedFingers:
    """A robot with rigid fingers, and its configurations with movable ones.

    Each pair of fingers would be a margin in every frame, and each joint a column.
    """

    robot: Robot  # with rigid fingers; the same robot if it has none
    fingers: tuple[str, ...]  # their joints, by name
    standing: Array  # configuration (nq,) of the whole robot, in which fingers are fixed
    # indices of the whole robot's coordinates and velocities that the rigid one has
    q_kept: NDArray[np.intp]
    v_kept: NDArray[np.intp]

    @classmethod
    def of(cls, robot: Robot, body: BodyMap) -> FixedFingers:
        """Fix the fingers of a robot whose hands are known."""
        fingers, model = _fingers(robot, body), robot.model
        others = [joint for joint in range(1, model.njoints) if joint not in fingers]
        q = np.concatenate([model.idx_qs[joint] + np.arange(model.nqs[joint]) for joint in others])
        v = np.concatenate([model.idx_vs[joint] + np.arange(model.nvs[joint]) for joint in others])
        names = tuple(str(model.names[joint]) for joint in fingers)
        rigid = _rigid(robot, names, q) if names else robot
        return cls(rigid, names, robot.postures[STANDING], q, v)

    @property
    def notes(self) -> tuple[str, ...]:
        """Which fingers are fixed."""
        if not self.fingers:
            return ()
        return (f"fingers are held as they stand, {len(self.fingers)}: {listed(self.fingers, 4)}",)

    def all_joints(self, q: Array) -> Array:
        """Return configurations of the whole robot (n, nq) from those without fingers."""
        every = np.tile(self.standing, (len(q), 1))
        every[:, self.q_kept] = q
        return every


def _fingers(robot: Robot, body: BodyMap) -> list[int]:
    """Return the joints behind the first link of a hand that carries several."""
    parents = [int(p) for p in robot.model.parents]
    found = set[int]()
    for arm in body.arms.values():
        joint = robot.frame(arm.hand).parentJoint
        while parents.count(joint) == 1:
            joint = parents.index(joint)
        for other in range(joint + 1, len(parents)):  # joints come after those that carry them
            if parents[other] == joint or parents[other] in found:
                found.add(other)
    names = {str(robot.model.names[joint]) for joint in found}
    for follower, coupling in robot.couplings.items():
        if (follower in names) != (coupling.driver in names):
            return []  # such as a hand that closes as its wrist turns
    return sorted(found)


def _rigid(robot: Robot, joints: Collection[str], kept: NDArray[np.intp]) -> Robot:
    """Return a robot with some joints fixed as it stands; ``kept``: its remaining coordinates."""
    model = reduced_model(robot.model, joints, robot.postures[STANDING])
    limits = JointLimits.of(model)
    return replace(
        robot,
        model=model,
        limits=limits,
        couplings={name: one for name, one in robot.couplings.items() if name not in joints},
        unactuated=tuple(name for name in robot.unactuated if name not in joints),
        passive=robot.passive.of(model, limits),
        postures={name: q[kept] for name, q in robot.postures.items()},
    )


class RobotSetup(NamedTuple):
    """The robot with fixed fingers, its legs, body map, standing body and margins, if wanted."""

    fingers: FixedFingers
    legs: Legs
    body: BodyMap
    standing: StandingBody
    collision: SelfCollision | None
    least_width: float  # of the feet from each other, at which margins between legs are kept [m]
    notes: tuple[str, ...]  # fixed fingers, and why there is no self-collision where it was wanted

    @property
    def robot(self) -> Robot:
        """With fixed fingers."""
        return self.fingers.robot


def robot_setup(robot: Robot, links: Mapping[str, str] | None, margin: float | None) -> RobotSetup:
    """Return what is derived from a robot, from a cache if possible.

    ``links``: see :func:`wbc.retargeting.body_map.body_map`, whose errors it raises.
    ``margin``: between bodies [m]; None: they may touch.
    """
    given = {} if links is None else dict(by_name("retarget, links", links))
    return _cached_setup(robot, tuple(sorted(given.items())), margin)


@lru_cache(maxsize=8)
def _cached_setup(
    robot: Robot, links: tuple[tuple[str, str], ...], margin: float | None
) -> RobotSetup:
    robot = _facing_ahead(robot)
    body = body_map(robot, dict(links))
    fingers = FixedFingers.of(robot, body)
    legs, collision, notes = Legs.of(fingers.robot), None, fingers.notes
    fingers = replace(fingers, robot=knees_one_way(fingers.robot))
    if margin is not None:
        try:
            collision = SelfCollision(fingers.robot, margin=margin, braking=BRAKING)
        except ModelError as error:  # missing shapes, most of all
            notes += (f"{NO_SELF_COLLISION}: {error}",)
    standing = standing_body(fingers.robot, legs, body)
    width = 0.0 if collision is None else _least_width(collision, legs)
    return RobotSetup(fingers, legs, body, standing, collision, width, notes)


def _facing_ahead(robot: Robot) -> Robot:
    """Return a robot that stands with its feet along x, as a human's are, however a file has it."""
    check_biped(robot)
    s = robot.snapshot(robot.postures[STANDING])
    heading = standing_heading(s)
    if not heading:
        return robot
    turn = np.zeros(robot.nv)
    turn[3:6] = s.rotation(BASE).T @ (0.0, 0.0, -heading)
    return replace(robot, postures={**robot.postures, STANDING: robot.integrate(s.q, turn, 1.0)})


def _least_width(collision: SelfCollision, legs: Legs) -> float:
    """Return the distance of the feet at which thighs and shanks keep their margins [m].

    A foot that is nearer to the other by d brings a place on its leg nearer by as much of d as this
    is below the hip, by the leg's height.
    """
    robot, model = collision.robot, collision.model
    standing = robot.snapshot(robot.postures[STANDING])
    left, right = (set(leg_joints(robot, side)[:-1]) for side in SIDES)
    ends = [{model.bodies[k].joint for k in pair} for pair in model.pairs.tolist()]
    pairs = np.array([k for k, pair in enumerate(ends) if pair & left and pair & right], dtype=int)
    found = model.measure(standing, pairs)
    hip, ankle = np.mean([hip_and_ankle(standing, side) for side in SIDES], axis=0)[:, 2]
    below = (hip - found.point[:, 2]) / (hip - ankle)
    spare = (found.distance - collision.margins[pairs])[below > HIPS] / below[below > HIPS]
    return legs.width - float(spare.min(initial=legs.width))
