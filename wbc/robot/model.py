"""A robot: one floating-base kinematic tree with its limits, feet and named postures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from wbc.errors import UnknownNameError
from wbc.robot.description import GeometrySource
from wbc.robot.feet import Foot, FootSpec, find_feet
from wbc.robot.frames import add_base_frame, frame_table
from wbc.robot.library import find_robot
from wbc.robot.limits import BASE_NV, Limits
from wbc.robot.locking import lock_joints
from wbc.robot.measured import checked_configuration
from wbc.robot.names import matching
from wbc.robot.postures import STANDING, grounded, named_postures, read_states, set_joints
from wbc.robot.reading import read_description
from wbc.robot.snapshot import Snapshot
from wbc.robot.supported import check_supported
from wbc.robot.workspace import Workspace
from wbc.validate import Array, finite_number, finite_vector, read_only


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """A loaded robot; does not change afterwards. Make one with :meth:`load`.

    ``q`` (nq,) is base position, base quaternion (x, y, z, w), joints; ``v`` (nv,) is the base's
    linear and angular velocity in base axes, then the joints' rates (Pinocchio's free-flyer).

    Attributes
    ----------
    name:
        The robot's name.
    path:
        The file it was read from.
    model:
        Pinocchio model, locked joints removed, with sole frames; shared: do not change it.
    limits:
        Joint limits in velocity order.
    feet:
        Feet by name, such as ``left``; empty if none were found.
    postures:
        Configurations by name, read-only: ``neutral`` (all zero), those of the files, and
        ``standing``, which is on the ground.
    notes:
        What was tolerated while loading, in words.
    srdf:
        The SRDF file, or None.
    geometry:
        Loads the shapes; see :attr:`collision_model`.
    """

    name: str
    path: Path
    model: pin.Model
    limits: Limits
    feet: Mapping[str, Foot]
    postures: Mapping[str, Array]
    notes: tuple[str, ...]
    srdf: Path | None
    geometry: GeometrySource

    def __post_init__(self) -> None:
        for q in self.postures.values():
            read_only(q)
        object.__setattr__(self, "feet", MappingProxyType(dict(self.feet)))
        object.__setattr__(self, "postures", MappingProxyType(dict(self.postures)))

    @classmethod
    def load(
        cls,
        source: str | Path,
        *,
        locked: Mapping[str, float] | None = None,
        feet: Mapping[str, FootSpec | Mapping[str, Any]] | None = None,
        srdf: str | Path | None = None,
        package_dirs: Iterable[str | Path] = (),
        name: str | None = None,
    ) -> Self:
        """Read a robot from a URDF or MJCF file, or by name.

        Parameters
        ----------
        source:
            A file, a name of :func:`~wbc.robot.library.robot_names`, or one of the package
            ``robot_descriptions`` if that is installed.
        locked:
            Joints to hold rigid, and their values [rad or m]; besides those of a named robot.
        feet:
            Feet by name; by default those of the library, or a guess from the links' names.
        srdf:
            File with named postures (``group_state``).
        package_dirs:
            Folders to look for ``package://`` meshes in.
        name:
            The robot's name, if not the file's.

        Raises
        ------
        ModelError
            The file cannot be read, or holds something unsupported; the message names it.
        UnknownNameError
            Unknown robot, locked joint, or foot link.
        InvalidInputError
            A locked value outside its joint's limits, or a foot that makes no sense.
        """
        found = find_robot(source)
        known = found.known
        folders = (*(Path(folder) for folder in package_dirs), *found.package_dirs)
        description = read_description(found.path, folders)
        model = lock_joints(description, {**(known.locked if known else {}), **(locked or {})})
        notes = description.notes + check_supported(model, found.path) + add_base_frame(model)
        limits = Limits.of(model)
        states_file = found.srdf if srdf is None else Path(srdf)
        states = {**description.states, **(read_states(states_file) if states_file else {})}
        postures, posture_notes = named_postures(limits, pin.neutral(model), states, known)
        specs = _foot_specs(feet, None if known is None else known.feet)
        soles, foot_notes = find_feet(model, description.geometry, specs, postures[STANDING])
        postures[STANDING] = grounded(model, postures[STANDING], soles)
        return cls(
            name=name or found.name or description.name,
            path=found.path,
            model=model,
            limits=limits,
            feet=soles,
            postures=postures,
            notes=(known.notes if known else ()) + notes + posture_notes + foot_notes,
            srdf=states_file,
            geometry=description.geometry,
        )

    def __repr__(self) -> str:
        return f"Robot({self.name!r}, nv={self.nv}, mass={self.mass:.2f} kg)"

    def __reduce__(self) -> tuple[object, ...]:
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        values.update(feet=dict(self.feet), postures=dict(self.postures))
        return type(self), tuple(values.values())

    # ------------------------------------------------------------------ sizes and names

    @cached_property
    def nq(self) -> int:
        """Size of a configuration q."""
        return int(self.model.nq)

    @cached_property
    def nv(self) -> int:
        """Size of a velocity v."""
        return int(self.model.nv)

    @cached_property
    def mass(self) -> float:
        """Total mass [kg]."""
        return float(pin.computeTotalMass(self.model))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Actuated joints: entry k belongs to ``v[6 + k]``."""
        return self.limits.names

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Every frame: links, joints, soles, and ``base``."""
        return tuple(self._frames)

    @cached_property
    def _frames(self) -> dict[str, int]:
        return frame_table(self.model)

    @cached_property
    def _joints(self) -> dict[str, int]:
        return {name: BASE_NV + k for k, name in enumerate(self.joint_names)}

    def joint_index(self, name: str) -> int:
        """Return the entry of v that is the rate of a joint.

        Raises
        ------
        UnknownNameError
            No such actuated joint.
        """
        index = self._joints.get(name)
        if index is None:
            raise UnknownNameError("joint", name, self.joint_names)
        return index

    def joint_indices(self, pattern: str) -> tuple[int, ...]:
        """Return the entries of v of the joints that match a pattern such as ``left_*``.

        Raises
        ------
        UnknownNameError
            No joint matches.
        """
        return tuple(BASE_NV + k for k in matching(pattern, self.joint_names))

    def frame_id(self, name: str) -> int:
        """Return Pinocchio's index of a frame.

        Raises
        ------
        UnknownNameError
            No such frame.
        """
        index = self._frames.get(name)
        if index is None:
            raise UnknownNameError("frame", name, self._frames)
        return index

    # ------------------------------------------------------------------ memory and shapes

    @cached_property
    def workspace(self) -> Workspace:
        """Scratch memory of this robot's snapshots; a copied or pickled robot gets its own."""
        return Workspace(self.model)

    @cached_property
    def collision_model(self) -> pin.GeometryModel:
        """Collision shapes, without pairs; meshes are read when first asked for."""
        return self.geometry.load(self.model, pin.GeometryType.COLLISION)

    @cached_property
    def visual_model(self) -> pin.GeometryModel:
        """Shapes to draw; meshes are read when first asked for."""
        return self.geometry.load(self.model, pin.GeometryType.VISUAL)

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
            Joint names, or patterns such as ``*_knee*``, and their values [rad or m].
        on_ground:
            Put the lowest corner of the soles at z = 0; otherwise the base stays where it is in
            the named posture.

        Raises
        ------
        UnknownNameError
            No such posture or joint.
        InvalidInputError
            A value outside the joint's limits.
        """
        if reference not in self.postures:
            raise UnknownNameError("posture", reference, self.postures)
        q = self.postures[reference].copy()
        set_joints(self.limits, q, joints or {})
        return grounded(self.model, q, self.feet) if on_ground else q

    def integrate(self, q: ArrayLike, v: ArrayLike, dt: float) -> Array:
        """Return the configuration (nq,) reached from ``q`` by the constant velocity ``v``."""
        step = self.check_velocity(v) * finite_number("dt", dt)
        q = pin.integrate(self.model, self.check_configuration(q), step)
        return self.check_configuration(q)

    def difference(self, q0: ArrayLike, q1: ArrayLike) -> Array:
        """Return the displacement (nv,) with ``integrate(q0, displacement, 1) == q1``."""
        start, end = self.check_configuration(q0), self.check_configuration(q1)
        return pin.difference(self.model, start, end)

    def check_configuration(self, q: ArrayLike) -> Array:
        """Return ``q`` as a fresh (nq,) array with quaternion (and cos, sin) normalised.

        Raises
        ------
        InvalidInputError
            Wrong size, not finite, or a quaternion whose norm is off by more than 1e-3.
        """
        return checked_configuration(q, self.nq, self.limits)

    def check_velocity(self, v: ArrayLike) -> Array:
        """Return ``v`` as a fresh (nv,) array.

        Raises
        ------
        InvalidInputError
            Wrong size or not finite.
        """
        return finite_vector("v", v, self.nv)

    def snapshot(self, q: ArrayLike, v: ArrayLike | None = None) -> Snapshot:
        """Return everything known at configuration ``q`` moving at ``v`` (at rest if None).

        Raises
        ------
        InvalidInputError
            See :meth:`check_configuration` and :meth:`check_velocity`.
        """
        q = self.check_configuration(q)
        if v is None:
            return Snapshot(self, q, np.zeros(self.nv), moving=False)
        return Snapshot(self, q, self.check_velocity(v), moving=True)


def _foot_specs(
    given: Mapping[str, FootSpec | Mapping[str, Any]] | None,
    known: Mapping[str, FootSpec] | None,
) -> Mapping[str, FootSpec] | None:
    if given is None:
        return known
    return {name: FootSpec.of(name, spec) for name, spec in given.items()}
