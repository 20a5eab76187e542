"""A robot, loaded from a file or by name, and its snapshots."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, ModelError, UnknownNameError, listed, shown
from wbc.files import beside
from wbc.kinds import check_path, check_word, switch
from wbc.notebook import as_html, with_picture
from wbc.robot.drives import JointValues, armature_note, effort_note, set_drives
from wbc.robot.feet import FootSpec
from wbc.robot.formats import read_description
from wbc.robot.formats.couplings import Coupling, Loop
from wbc.robot.formats.description import Description, GeometrySource, lock_joints
from wbc.robot.formats.srdf import read_srdf
from wbc.robot.formats.triangles import Surfaces, with_meshes
from wbc.robot.library import RobotSource, find_robot
from wbc.robot.limits import BASE_NQ, JointLimits
from wbc.robot.loops import Closure, loops_of, loops_within, without_motors
from wbc.robot.model_checks import check_joint_inertia, check_supported
from wbc.robot.moving_state import MovingState
from wbc.robot.names import add_base_frame, matches, matching
from wbc.robot.notes import noted, warn_of
from wbc.robot.payload import CarryingGeometry, Payload
from wbc.robot.postures import (
    STANDING,
    close_postures,
    com_from_middle,
    couple_postures,
    named_postures,
    put_on_ground,
    rename_neutral,
    set_joints,
    set_mimic_joints,
    settle_on_ground,
)
from wbc.robot.stance import stance_from_postures
from wbc.robot.tree import KinematicTree
from wbc.validate import Array, by_name, read_only

MujocoModel: TypeAlias = Any  # mujoco.MjModel or mujoco.MjSpec
BASES = ("floating", "fixed")


@dataclass(frozen=True, eq=False, repr=False)
class Robot(KinematicTree):
    """A loaded robot; does not change afterwards. Make one with :meth:`load`.

    Besides what a :class:`~wbc.robot.tree.KinematicTree` has:

    Attributes
    ----------
    postures:
        Configurations by name, read-only: ``neutral`` (joints at zero, the base where the file puts
        it), those of the files, and ``standing``, which is on the ground.
    notes:
        What was tolerated while loading, in words.
    srdf:
        The SRDF file, or None.
    geometry:
        Loads the shapes; see :attr:`collision_model`.
    payloads:
        Bodies that it carries; see :meth:`with_payload`.
    """

    postures: Mapping[str, Array]
    notes: tuple[str, ...]
    srdf: Path | None
    geometry: GeometrySource
    payloads: tuple[Payload, ...]

    def __new__(cls, *given: object, **named: object) -> Self:
        """Refuse ``Robot("g1")``, as other libraries have it, by saying what to write."""
        if len(given) + len(named) < len(fields(cls)):
            source = repr(given[0]) if given and isinstance(given[0], str | Path) else "source"
            raise InvalidInputError(
                f"Robot: a robot is read from a file, or by name: write Robot.load({source})"
            )
        return super().__new__(cls)

    def __post_init__(self) -> None:
        super().__post_init__()
        for q in self.postures.values():
            read_only(q)
        object.__setattr__(self, "postures", MappingProxyType(dict(self.postures)))

    def _repr_html_(self) -> str:
        facts = [
            ("mass", f"{self.mass:.2f} kg"),
            ("joints", f"{len(self.joint_names)}: {listed(self.joint_names, 6)}"),
            ("feet", ", ".join(self.feet)),
            ("postures", ", ".join(self.postures)),
            ("base", "bolted down" if self.fixed_base else "floating"),
            ("limits missing", listed(self.limits.missing)),
        ]
        table = as_html(f"{self.name}", facts, [("note", note) for note in self.notes])
        return with_picture(
            table, "wbc.view.robots:robot_figure", self, {STANDING: self.postures[STANDING]}
        )

    @classmethod
    def load(
        cls,
        source: str | Path | MujocoModel,
        *,
        locked: Mapping[str, float] | None = None,
        feet: Mapping[str, FootSpec | Mapping[str, Any]] | None = None,
        base: str | None = None,
        srdf: str | Path | None = None,
        package_dirs: Iterable[str | Path] = (),
        name: str | None = None,
        armature: JointValues | None = None,
        damping: JointValues | None = None,
        friction: JointValues | None = None,
        effort: JointValues | None = None,
        loops: Mapping[str, Loop | Mapping[str, Any] | Sequence[str]] | None = None,
        unactuated: Sequence[str] | None = None,
    ) -> Self:
        """Read a robot from a URDF or MJCF file, by name, or from what MuJoCo compiled.

        Parameters
        ----------
        source:
            A file; a name of :func:`~wbc.robot.library.robot_names`; ``menagerie:NAME`` or
            ``menagerie:NAME/ENTRY`` of the package ``mujoco-menagerie``; a name of the package
            ``robot_descriptions``, or ``robot_descriptions:NAME``; or XML text (it begins with
            ``<``), an ``MjSpec``, which stays as it is, or an ``MjModel``.
        locked:
            Joints to hold rigid, and their values [rad or m]; besides those of a named robot.
        feet:
            Feet by name; by default those of the library, or a guess from names and shapes.
        base:
            ``"floating"`` or ``"fixed"``. By default the base is fixed if no feet are found and
            the root link is called world, or base of what has no wheels and no links called feet,
            is an MJCF body without a free joint, or carries one arm that does not reach below it;
            and of a root without mass that one joint moves. A note says so.
        srdf:
            File with named postures (``group_state``).
        package_dirs:
            Folders to look for ``package://`` meshes in, before those above the file and those of
            ROS (``ROS_PACKAGE_PATH``) and ROS 2 (``share`` in ``AMENT_PREFIX_PATH``).
        name:
            The robot's name, if not the file's.
        armature, damping, friction:
            Rotor inertia as felt at the joint [kg m^2], viscous [N m s/rad] and dry friction [N m]
            (kg, N s/m and N where a joint slides): one number, or by joint name or pattern, later
            entries win. What is not given stays as in the file, 0 if that is silent.
        effort:
            Largest torque [N m] or force [N], likewise; a note says which joints have none.
        loops:
            Closed loops by name, besides the file's: two frames, or ``{"frames": [...], "kind":
            "pose"}``. With ``"point"``, the default, their origins meet, with ``"pose"`` their axes
            too. Postures are closed by moving joints without a motor, or all where they do not
            suffice.
        unactuated:
            Joints without a motor, by name or pattern: no torques there. By default those that no
            motor of an MJCF with closed loops drives, none of other robots.

        Raises
        ------
        ModelError
            The file cannot be read, or holds something unsupported, or the compiled core differs
            from Pinocchio on it; the message names it.
        MissingPackageError
            It is MJCF, and MuJoCo, which compiles it, is not installed.
        UnknownNameError
            Unknown robot, locked joint, or foot link.
        InvalidInputError
            A locked value outside its joint's limits, a foot that makes no sense, another word for
            ``base``, a negative friction, inertia or effort, a source that is no path or name, or
            loops that cannot be closed.
        """
        if not (base is None or (isinstance(base, str) and base in BASES)):
            raise InvalidInputError(f"base: expected {' or '.join(BASES)}, got {shown(base)}")
        if name is not None:
            check_word("robot, name", name)
        if srdf is not None:
            check_path("robot, srdf", srdf)
        found = find_robot(source)
        description, model, couplings, notes = _read(found, locked, package_dirs)
        rotors = dict(found.known.armature) if found.known else {}
        rotors = {key: by for key, by in rotors.items() if matches(key, tuple(model.names))}
        set_drives(model, armature=rotors)  # of what is not locked
        set_drives(model, armature=armature, damping=damping, friction=friction, effort=effort)
        check_joint_inertia(model, found.path)
        limits = JointLimits.of(model)
        states_file = found.srdf if srdf is None else beside(Path.cwd(), srdf)  # read later, too
        said = read_srdf(states_file, description.model) if states_file else None
        own, renamed = rename_neutral(description.states)
        description = replace(description, states=own)
        said_states, also = rename_neutral(said.states if said else {})
        states = {**own, **said_states}
        notes += renamed or also
        notes += said.notes(description.model) if said and states_file != found.srdf else ()
        neutral = pin.neutral(model)
        neutral[:BASE_NQ] = description.base
        postures, posture_notes = named_postures(limits, neutral, states, found.known)
        posture_notes += couple_postures(limits, postures, states, couplings)
        own_loops = {} if loops is None else loops_of(loops)
        ties, loop_notes = loops_within(model, {**description.loops, **own_loops})
        if unactuated is None and ties:
            unactuated = tuple(set(description.unactuated or ()) & {*limits.names})
            if not description.loops:
                loop_notes += noted("with loops, no torque is asked of {}", sorted(unactuated))
        free = without_motors(limits.names, () if unactuated is None else unactuated)
        passive = description.passive.of(model, limits)
        closure = Closure(model, limits, ties, couplings, free, passive.springs)
        posture_notes += close_postures(closure, postures, description.drawn, found.path)
        stance = stance_from_postures(found, description, postures, feet, base, closure)
        if description.on_world and not stance.bolted:
            raise ModelError(
                f"{found.path}: equality constraint {description.on_world[0]!r} ties the robot to"
                " the world, but its base floats; base: fixed holds it, or remove the constraint,"
                " and hold the frame by a contact with friction=None"
            )
        postures[STANDING] = stance.q
        notes += posture_notes + stance.notes + armature_note(model) + loop_notes
        notes += effort_note(limits, (*free, *couplings))
        expected = stance.notes if stance.bolted else ()  # an arm's, which are no fault of its file
        warn_of(found.path, (note for note in notes if note not in expected))
        robot = cls(
            name=name or found.name or description.name,
            path=found.path,
            model=model,
            limits=limits,
            feet=stance.feet,
            fixed_base=stance.bolted,
            couplings=couplings,
            loops=ties,
            unactuated=free,
            postures=postures,
            notes=notes,
            srdf=states_file,
            geometry=description.geometry,
            passive=passive,
            payloads=(),
        )
        _ = robot.native  # here, not in the first tick, if the core cannot be trusted with it
        return robot

    def with_payload(
        self,
        frame: str,
        mass: float,
        com: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike = (0.0, 0.0, 0.0),
    ) -> Self:
        """Return this robot with a rigid body fixed to a frame; see :class:`~wbc.robot.Payload`.

        Everything that is made of the robot that is returned knows of the body: controllers of both
        levels, plants, analyses, pictures. ``standing`` is moved until the CoM is where it was over
        the soles; other postures stay. Payloads add up.

        Parameters
        ----------
        frame:
            A link or frame.
        mass:
            [kg].
        com:
            Its centre of mass (3,) [m], in the frame's axes from its origin.
        inertia:
            About its centre of mass, in the frame's axes (3, 3) [kg m^2], or the diagonal (3,).

        Raises
        ------
        UnknownNameError
            No such frame.
        InvalidInputError
            No mass, or an inertia that no body has.
        """
        model, payload = Payload(frame, mass, com, inertia).attached(self.model)
        payloads = (*self.payloads, payload)
        own = self.geometry.own if isinstance(self.geometry, CarryingGeometry) else self.geometry
        postures = dict(self.postures)
        notes = (*self.notes, f"carries {payload.mass:g} kg at {frame!r}, which touches nothing")
        if self.feet:
            q = postures[STANDING]
            place = com_from_middle(self.model, q, self.feet)
            q, unsettled = settle_on_ground(replace(self.closure, model=model), q, self.feet, place)
            postures[STANDING] = put_on_ground(model, q, self.feet)
            notes += unsettled
        carrying = replace(
            self,
            model=model,
            postures=postures,
            notes=notes,
            geometry=CarryingGeometry(own, payloads),
            payloads=payloads,
        )
        _ = carrying.native  # the core is compared with Pinocchio, as when a robot is loaded
        return carrying

    # ------------------------------------------------------------------ shapes

    @cached_property
    def collision_model(self) -> pin.GeometryModel:
        """Collision shapes, without pairs; meshes are read when first asked for."""
        return with_meshes(self.geometry.surfaces(self.model, pin.GeometryType.COLLISION))

    @cached_property
    def collision_surfaces(self) -> Surfaces:
        """Collision shapes with their meshes as triangles: quicker than :attr:`collision_model`."""
        return self.geometry.surfaces(self.model, pin.GeometryType.COLLISION)

    @cached_property
    def visual_surfaces(self) -> Surfaces:
        """Shapes to draw with their meshes as triangles: quicker than :attr:`visual_model`."""
        return self.geometry.surfaces(self.model, pin.GeometryType.VISUAL)

    @cached_property
    def visual_model(self) -> pin.GeometryModel:
        """Shapes to draw; meshes are read when first asked for."""
        return with_meshes(self.geometry.surfaces(self.model, pin.GeometryType.VISUAL))

    # ------------------------------------------------------------------ configurations

    def posture(
        self,
        reference: str = STANDING,
        joints: Mapping[str, float] | None = None,
        on_ground: bool = True,
    ) -> Array:
        """Return a named posture (nq,), with some joints changed.

        Parameters
        ----------
        joints:
            Joint names, or patterns such as ``*_knee*``, and their values [rad or m]. Mimic joints
            follow their drivers, which go along where a mimic joint is named alone, and loops are
            closed by the joints that are not named.
        on_ground:
            Put the lowest corner of the soles at z = 0; otherwise the base stays where it is in
            the named posture.

        Raises
        ------
        UnknownNameError
            No such posture or joint.
        InvalidInputError
            A value outside the joint's limits, or one with which loops cannot be closed or mimic
            joints cannot follow.
        """
        if not isinstance(reference, str) or reference not in self.postures:
            first = f"its name comes first, then joints: posture({STANDING!r}, {{joint: value}})"
            remedy = "" if isinstance(reference, str) else first
            raise UnknownNameError("posture", reference, self.postures, remedy)
        q = self.postures[reference].copy()
        given = {} if joints is None else joints
        set_joints(self.limits, q, given)
        free = {name: one for name, one in self.couplings.items() if name not in given}
        set_mimic_joints(self.limits, q, free)
        if given and self.closure.binds:
            names = self.joint_names
            meant = [names[k] for key in given for k in matching(key, names)]
            q = self.closure.closed(q, [name for name in meant if name not in free])
        raised = switch("posture, on_ground", on_ground)
        return put_on_ground(self.model, q, self.feet) if raised else q

    def passive_forces(self, q: ArrayLike, v: ArrayLike | None = None) -> Array:
        """Return what springs and the like give (nv,) [N, N m]: forces that no motor is asked for.

        They stand beside the torques: M a + bias = S' tau + J' f + passive - damping v - friction,
        with :attr:`damping` and :attr:`friction`, which are not in here.

        Raises
        ------
        InvalidInputError
            See :meth:`check_configuration` and :meth:`check_velocity`.
        """
        return self.passive_forces_at(self.snapshot(q, v))

    def passive_forces_at(self, snapshot: Snapshot) -> Array:
        """Return :meth:`passive_forces` at a snapshot, whose state has been checked."""
        check_snapshot("passive_forces_at", snapshot)
        placed = None
        if self.passive.lifts:
            placed = *snapshot.joint_placements, snapshot.joint_twists
        return self.passive.forces(self.model, self.limits, snapshot.q, snapshot.v, placed)

    def snapshot(self, q: ArrayLike, v: ArrayLike | None = None) -> Snapshot:
        """Return everything known at configuration ``q`` moving at ``v``.

        Without ``v`` the robot is at rest: ``v`` is 0, and acceleration limits count from there. A
        loop passes the measured velocity, or that of the last tick where it is integrated.

        Raises
        ------
        InvalidInputError
            See :meth:`check_configuration` and :meth:`check_velocity`.
        """
        if (plain := self.native.measured(q, v)) is not None:
            return Snapshot.of_measured(self, plain)
        q = read_only(self.check_configuration(q))
        v = np.zeros(self.nv) if v is None else self.check_velocity(v)
        return Snapshot(self, q, read_only(v))


def _read(
    found: RobotSource, locked: Mapping[str, float] | None, package_dirs: Iterable[str | Path]
) -> tuple[Description, pin.Model, Mapping[str, Coupling], tuple[str, ...]]:
    """Return what a robot's file says, its model with joints locked, mimic joints, and notes."""
    if isinstance(package_dirs, str | Path):
        package_dirs = (package_dirs,)
    if not isinstance(package_dirs, Iterable):
        raise InvalidInputError(f"package_dirs: expected a list, got {package_dirs!r}")
    for folder in (given := tuple(package_dirs)):
        check_path("package_dirs", folder)
    known, held = found.known, {} if locked is None else by_name("locked", locked)
    folders = (*(beside(Path(), folder) for folder in given), *found.package_dirs)
    description = read_description(found.path, folders, found.given)
    rigid = {**(known.locked if known else {}), **held}
    model, couplings = lock_joints(description, rigid)
    left = {*model.names}
    loose = [
        f"{joint} ({tie.driver})"
        for joint, tie in description.coupled.items()
        if joint not in left and tie.driver in left
    ]
    notes = description.notes + check_supported(model, found.path) + add_base_frame(model)
    notes += noted("locked, though they follow joints that still move: {}", loose)
    return description, model, couplings, (known.notes if known else ()) + notes


def check_robot(what: str, robot: object) -> None:
    """Refuse what is no robot, such as its name, by InvalidInputError."""
    if not isinstance(robot, Robot):
        raise InvalidInputError(
            f"{what}: expected a robot as Robot.load() returns it, got {shown(robot)}"
        )


def check_sizes(what: object, robot: Robot, snapshot: Snapshot) -> None:
    """Refuse what is no snapshot, or one of a robot with other joints: the core reads by size."""
    check_snapshot(what, snapshot)
    other = snapshot.robot
    if other is not robot and (other.nq, other.nv) != (robot.nq, robot.nv):
        raise InvalidInputError(f"{what}: the snapshot is of another robot, {other.name!r}")


def check_snapshot(what: object, snapshot: object) -> None:
    """Refuse what is no snapshot, such as a robot or configuration, by InvalidInputError."""
    if not isinstance(snapshot, Snapshot):
        raise InvalidInputError(
            f"{what}: expected a snapshot of a robot, as robot.snapshot(q) makes it, got"
            f" {shown(snapshot)}"
        )


class Snapshot(MovingState):
    """Everything known about a robot at one measured state, read-only: see :meth:`Robot.snapshot`.

    All but the type of ``robot`` is that of :class:`~wbc.robot.moving_state.MovingState`.
    """

    robot: Robot
