"""Finding the robot's bodies in a compiled MuJoCo model whose world has others too.

Scenes hold tables, balls and doors; the makers' own files of G1, H1 and R1 hold bodies far above
the ground, whose joints take the place of motors that a model does not have.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wbc.errors import ModelError, listed
from wbc.robot.notes import noted

LEAST_AXES_VOLUME = 0.5  # volume of three axes, of 1 where they are at right angles


@dataclass(frozen=True, eq=False)
class RobotPart:
    """The robot's share of a compiled model."""

    mujoco: Any  # the module
    model: Any  # mujoco.MjModel
    names: Names
    path: Path  # what messages call it
    roots: tuple[int, ...]  # bodies on the world; several if arms stand side by side
    bodies: tuple[int, ...]  # what they carry, depth first, the roots included
    joints: tuple[int, ...]  # of these bodies, without a free joint of the root
    floats: bool = False  # whether the root has a free joint
    # The root's unactuated three slides and three hinges, or ball: its floating base.
    floating_joints: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()

    def kind_of(self, joint: int) -> str:
        """Return ``hinge``, ``slide``, ``ball`` or ``free``."""
        kinds = self.mujoco.mjtJoint
        named = {kinds.mjJNT_HINGE: "hinge", kinds.mjJNT_SLIDE: "slide", kinds.mjJNT_BALL: "ball"}
        return named.get(kinds(int(self.model.jnt_type[joint])), "free")

    def start_of(self, joint: int) -> int:
        """Return where the coordinates of a joint begin in MuJoCo's q."""
        return int(self.model.jnt_qposadr[joint])

    @property
    def root_joint(self) -> int:
        """The free joint of the root, where it has one."""
        return int(self.model.body_jntadr[self.roots[0]])


class Names:
    """Names of a compiled model's parts, unique among their kind; unnamed ones are given some."""

    def __init__(self, mujoco: Any, model: Any) -> None:
        kinds = mujoco.mjtObj

        def name(kind: Any, number: int) -> str:
            return mujoco.mj_id2name(model, kind, number) or ""

        self.bodies = [name(kinds.mjOBJ_BODY, k) for k in range(model.nbody)]
        self.joints = [name(kinds.mjOBJ_JOINT, k) for k in range(model.njnt)]
        self.sites = [name(kinds.mjOBJ_SITE, k) for k in range(model.nsite)]
        self.geoms = [name(kinds.mjOBJ_GEOM, k) for k in range(model.ngeom)]
        self.actuators = [name(kinds.mjOBJ_ACTUATOR, k) for k in actuators_of(model)]
        self.equalities = [name(kinds.mjOBJ_EQUALITY, k) for k in range(model.neq)]
        self.tendons = [name(kinds.mjOBJ_TENDON, k) for k in range(model.ntendon)]
        self.keys = [name(kinds.mjOBJ_KEY, k) for k in range(model.nkey)]
        _name_unnamed(self.bodies, [f"body_{k}" for k in range(model.nbody)])
        carriers = [self.bodies[int(body)] for body in model.jnt_bodyid]
        _name_unnamed(self.joints, [f"{body}_joint" for body in carriers])
        owners = [self.bodies[int(body)] for body in model.geom_bodyid]
        _name_unnamed(self.geoms, [f"{body}_geom" for body in owners])
        _name_unnamed(self.keys, [f"key_{k}" for k in range(model.nkey)])
        _name_unnamed(self.actuators, [f"actuator_{k}" for k in actuators_of(model)])
        _name_unnamed(self.tendons, [f"tendon_{k}" for k in range(model.ntendon)])


def _name_unnamed(names: list[str], wanted: list[str]) -> None:
    """Give nameless entries the names that are wanted, numbered where these are taken."""
    taken = set(names)
    for k, name in enumerate(names):
        if name:
            continue
        new, number = wanted[k], 1
        while new in taken:
            number += 1
            new = f"{wanted[k]}_{number}"
        names[k] = new
        taken.add(new)


def robot_part(mujoco: Any, model: Any, path: Path) -> RobotPart:
    """Return the bodies of the robot, and a note of the others.

    If motors drive some trees, the others are scenery. Of the remaining trees the robot is the only
    one with a free joint and further joints; if there is none, the only one with joints. Several
    actuated trees that do not float are one robot on a fixed root.

    Raises ModelError: no body, or several that may be the robot.
    """
    names = Names(mujoco, model)
    tops = [body for body in range(1, model.nbody) if model.body_parentid[body] == 0]
    if not tops:
        raise ModelError(f"{path}: the world holds no bodies, expected the robot's root")
    roots = _roots(mujoco, model, names, tops, path)
    owned = {int(body) for body in range(1, model.nbody) if int(model.body_rootid[body]) in roots}
    bodies = tuple(sorted(owned))  # MuJoCo numbers them depth first
    joints = [k for k in range(model.njnt) if int(model.jnt_bodyid[k]) in owned]
    free = [k for k in joints if model.jnt_type[k] == mujoco.mjtJoint.mjJNT_FREE]
    others = [names.bodies[body] for body in tops if body not in roots]
    named = ", ".join(names.bodies[body] for body in roots)
    notes = noted(f"bodies beside the robot, whose root is {named}, left out: {{}}", others)
    floating_joints = _floating_joints(mujoco, model, roots, joints)
    own = [names.joints[k] for k in floating_joints]
    notes += noted("joints of the root that are its floating base: {}", own, len(own))
    moving = tuple(k for k in joints if k not in free and k not in floating_joints)
    of_model = mujoco, model, names, path
    return RobotPart(*of_model, tuple(roots), bodies, moving, bool(free), floating_joints, notes)


def _floating_joints(
    mujoco: Any, model: Any, roots: list[int], joints: list[int]
) -> tuple[int, ...]:
    """Return the joints of the only root if together they let it float, none of them driven."""
    own = [k for k in joints if len(roots) == 1 and int(model.jnt_bodyid[k]) == roots[0]]
    kinds = [int(model.jnt_type[k]) for k in own]
    slides = [k for k, kind in zip(own, kinds, strict=True) if kind == mujoco.mjtJoint.mjJNT_SLIDE]
    hinges = [k for k, kind in zip(own, kinds, strict=True) if kind == mujoco.mjtJoint.mjJNT_HINGE]
    turning = [hinges] if len(hinges) == 3 else []
    balls = kinds.count(int(mujoco.mjtJoint.mjJNT_BALL))
    if len(slides) != 3 or len(turning) + balls != 1 or len(own) != 3 + len(hinges) + balls:
        return ()
    driven = {*acting_motors(mujoco, model).values()} & {*own}
    spanned = [abs(float(np.linalg.det(model.jnt_axis[axes]))) for axes in (slides, *turning)]
    return () if driven or min(spanned) < LEAST_AXES_VOLUME else tuple(own)


def _roots(mujoco: Any, model: Any, names: Names, tops: list[int], path: Path) -> list[int]:
    if len(tops) == 1:
        return tops
    jointed, free = Counter[int](), set[int]()
    for k in range(model.njnt):
        root = int(model.body_rootid[model.jnt_bodyid[k]])
        if model.jnt_type[k] == mujoco.mjtJoint.mjJNT_FREE:
            free.add(root)
        else:
            jointed[root] += 1
    moved = _driven(mujoco, model)
    driven = [body for body in tops if body in moved]
    tried = driven or tops
    floating = [body for body in tried if body in free and jointed[body]]
    found = floating or [body for body in tried if jointed[body]]
    found = found or [body for body in tried if body in free]
    if len(found) != 1 and (floating or not driven):
        named = listed([repr(names.bodies[body]) for body in found or tops])
        raise ModelError(
            f"{path}: the world holds {len(tops)} bodies, and {named} may be the robot's root;"
            " remove the others, or put them in one body, the trunk, if they are limbs of one robot"
        )
    return found


def actuators_of(model: Any) -> range:
    """Return the numbers of all actuators; newer MuJoCo has some with several controls each."""
    return range(len(model.actuator_trntype))


def motors_on_joints(mujoco: Any, model: Any) -> dict[int, int]:
    """Return the motors that act on one joint each, and which that is."""
    kinds = int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    return {
        motor: int(model.actuator_trnid[motor, 0])
        for motor in actuators_of(model)
        if int(model.actuator_trntype[motor]) in kinds
    }


def acting_motors(mujoco: Any, model: Any) -> dict[int, int]:
    """Return :func:`motors_on_joints` but for those of groups switched off, or of gear 0."""
    off = int(getattr(model.opt, "disableactuator", 0))
    return {
        motor: joint
        for motor, joint in motors_on_joints(mujoco, model).items()
        if not off >> int(model.actuator_group[motor]) & 1 and model.actuator_gear[motor, 0] != 0.0
    }


def _driven(mujoco: Any, model: Any) -> set[int]:
    """Return the bodies on the world below which motors act on joints, or on tendons of some."""
    joints = [*motors_on_joints(mujoco, model).values()]
    for motor in actuators_of(model):
        if int(model.actuator_trntype[motor]) == int(mujoco.mjtTrn.mjTRN_TENDON):
            tendon = int(model.actuator_trnid[motor, 0])
            first = int(model.tendon_adr[tendon])
            for wrap in range(first, first + int(model.tendon_num[tendon])):
                if int(model.wrap_type[wrap]) == int(mujoco.mjtWrap.mjWRAP_JOINT):
                    joints.append(int(model.wrap_objid[wrap]))
    return {int(model.body_rootid[model.jnt_bodyid[joint]]) for joint in joints}
