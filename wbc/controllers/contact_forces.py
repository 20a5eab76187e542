"""Contact forces as unknowns: where they act, what they do to the robot, what contacts bear.

A surface bears a force at each of its corners, in the contact frame's axes with the normal along z;
a point bears one, in the world's, with a normal of its own. What pulls and twists as well (a grip,
a bolted base, the gear of a mimic joint, a closed loop) bears a free force along each of its rows.
Tasks that are held exactly without being any of these, such as a CoM held over a point, bear none:
motors alone hold them.

The unknowns are not forces but what they do in one tick to a robot of this mass, ``f dt / m`` in
m/s. They are then as large as velocities, which the QP's conditioning needs: beside tasks of
curvature 1 to 1000 a damping of forces in newton makes it nearly singular.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.constraints.contact import Contact, PointContact
from wbc.constraints.friction import FrictionCone
from wbc.constraints.mechanics import Mechanics, holds_bolted
from wbc.constraints.rows import Bounds
from wbc.errors import InvalidInputError
from wbc.robot import Robot, Snapshot
from wbc.rotations import upright_on
from wbc.spatial import skew
from wbc.tasks.task import Task
from wbc.tasks.validation import residual_of
from wbc.validate import Array, read_only

# A contact with less normal force than this [N] has no CoP worth speaking of.
UNLOADED = 1e-6
# Contacts further from their anchors than this [m, rad] are not where they are said to be.
FAR, TILTED = 0.01, 0.1
NO_RAMPS: Mapping[str, float] = {}
UPWARDS = read_only(np.array((0.0, 0.0, 1.0)))
STRAIGHT = 1e-9
LEAST_NORMAL_Z = math.sqrt(0.5)  # how far up a normal looks at 45 degrees


class ContactPart(NamedTuple):
    """The unknowns of one contact."""

    contact: Task
    columns: slice  # which of the force unknowns they are
    # (6, k) wrench at the contact's frame, in the axes of the forces, by them; None for free
    # forces along the contact's own rows.
    grasp: Array | None

    @property
    def surface(self) -> Contact | None:
        """The contact, if it bears forces inside a friction cone."""
        return self.contact if self.grasp is not None else None  # type: ignore[return-value]

    def axes(self, snapshot: Snapshot) -> Array:
        """Return the rotation (3, 3) from the axes of the forces to the world's."""
        if isinstance(self.contact, PointContact):
            return np.eye(3)
        return snapshot.rotation(self.contact.frame)  # type: ignore[attr-defined]

    @property
    def normal(self) -> Array:
        """Unit normal (3,) of what is touched, in the axes of the forces."""
        return self.contact.normal if isinstance(self.contact, PointContact) else UPWARDS

    def normal_forces(self, f: Array) -> Array:
        """Return the normal forces (k,) at the corners of a surface, of all unknowns ``f``."""
        return f[self.columns].reshape(-1, 3) @ self.normal

    def points(self, snapshot: Snapshot) -> Array:
        """Return where the forces of a surface act (k, 3), world axes [m]."""
        contact = self.surface
        if contact is None or contact.corners is None:
            return np.zeros((0, 3))
        R, p = snapshot.rotation(contact.frame), snapshot.position(contact.frame)
        return p + contact.corners @ R.T


class ContactForces:
    """The force unknowns of a set of contacts.

    ``unit``: newtons per unit of an unknown, m / dt.

    ``size``: how many unknowns there are, k.
    ``names``: (k,).
    ``parts``: of each contact that bears forces.
    ``lower``, ``upper``: (k,) bounds: normal forces push.
    ``labels``: of the rows of :meth:`bounds`.

    Raises InvalidInputError: a contact with a friction cone on a frame whose corners are not known.
    """

    def __init__(self, robot: Robot, contacts: Sequence[Task], unit: float) -> None:
        self.robot = robot
        self.unit = unit
        names: list[str] = []
        parts = []
        for contact in contacts:
            part = _part(contact, len(names))
            if part is not None:
                names += _names(part)
                parts.append(part)
        self.parts = tuple(parts)
        self.names = tuple(names)
        self.size = len(names)
        self.surfaces = tuple(one for part in parts if (one := part.surface) is not None)
        self.lower, self.upper = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        for part in parts:
            if part.surface is not None and part.normal[2] == 1.0:  # else a row says so
                self.lower[part.columns][2::3] = 0.0
        self._read_cones()

    @cached_property
    def internal(self) -> NDArray[np.bool_]:
        """(k,) which are of the robot's own mechanics: gears, closed loops, a bolted base."""
        found = np.zeros(self.size, dtype=bool)
        for part in self.parts:
            contact = part.contact
            found[part.columns] = isinstance(contact, Mechanics) or holds_bolted(contact)
        return found

    def generalized(self, snapshot: Snapshot) -> Array:
        """Return J' G (nv, k): generalized forces by the forces of all contacts."""
        G = np.empty((self.robot.nv, self.size))
        for part in self.parts:
            if part.grasp is None:
                G[:, part.columns] = residual_of(part.contact, snapshot).jacobian.T
                continue
            contact, R = part.contact, part.axes(snapshot)
            grasp = np.empty(part.grasp.shape)  # in the world's axes: smaller than the Jacobian
            np.dot(R, part.grasp[:3], out=grasp[:3])
            np.dot(R, part.grasp[3:], out=grasp[3:])
            G[:, part.columns] = snapshot.jacobian(contact.frame).T.dot(grasp)  # type: ignore[attr-defined]
        return G

    @cached_property
    def frames(self) -> tuple[str, ...]:
        """Frames of the contacts that bear forces; gears and bolted bases have none."""
        return tuple(part.contact.frame for part in self.parts if isinstance(part.contact, Contact))

    def wrench_map(self, frame: str, snapshot: Snapshot, out: Array) -> None:
        """Write (6, k) into ``out``: a contact's wrench at its frame's origin, world axes."""
        for part in self.parts:
            contact = part.contact
            if not isinstance(contact, Contact) or contact.frame != frame:
                continue
            if part.grasp is None:  # along its rows, which are the world's
                out[: len(contact.rows), part.columns] = np.eye(len(contact.rows))
            else:
                local = part.grasp.reshape(2, 3, -1)
                out[:, part.columns] = (part.axes(snapshot) @ local).reshape(6, -1)

    def bounds(self, most: Mapping[str, float] = NO_RAMPS) -> Bounds:
        """Return cones, and ranges of the normal forces, as rows (m, k) on the unknowns.

        ``most`` lowers the largest normal force [N] of some contacts, by name, and so the least.
        """
        if [contact.friction for contact in self.surfaces] != self._cones:
            self._read_cones()
        return self._bounds_within(most) if most else self._bounds

    def _bounds_within(self, most: Mapping[str, float]) -> Bounds:
        """Return the rows of :meth:`bounds`."""
        lower, upper = np.full(len(self.labels), -np.inf), np.zeros(len(self.labels))
        for k, contact in enumerate(self.surfaces):
            cone = contact.friction
            if cone is not None:
                largest = min(cone.most, most.get(contact.name, np.inf))
                upper[k] = largest / self.unit
                lower[k] = min(cone.least, largest) / self.unit
        return Bounds(self.labels, self._matrix, read_only(lower), read_only(upper))

    def _read_cones(self) -> None:
        """Lay out the rows: one for each whole normal force, then the facets of each corner."""
        self._cones = [contact.friction for contact in self.surfaces]
        labels, rows = [], []
        parts = [part for part in self.parts if part.surface is not None]
        for part in parts:
            row = np.zeros((1, self.size))
            row[0, part.columns] = np.tile(part.normal, _corners(part))
            rows.append(row)
            labels.append(f"{part.contact.name} normal force")
        for part in parts:
            contact = part.surface
            if contact is None or contact.friction is None:
                continue
            facets, called = _facets_of(contact.friction, tuple(part.normal), _corners(part))
            row = np.zeros((len(facets), self.size))
            row[:, part.columns] = facets
            rows.append(row)
            labels += [f"{contact.name} {one}" for one in called]
        self._matrix = read_only(np.concatenate([np.zeros((0, self.size)), *rows]))
        self.labels = tuple(labels)
        self._bounds = self._bounds_within(NO_RAMPS)


@dataclass(frozen=True, eq=False)
class Reaction:
    """The contact forces of one tick."""

    layout: ContactForces  # which unknown is what
    snapshot: Snapshot  # where they act
    f: Array  # (k,) the unknowns

    def wrenches(self) -> dict[str, Array]:
        """Return the wrench (6,) [N, N m] of each contact at its frame's origin, world axes.

        Free forces along rows that are no frame's (gears) are given as they are, (rows,).
        """
        found = {}
        for part in self.layout.parts:
            own = self.layout.unit * self.f[part.columns]
            if part.grasp is not None:
                local = (part.grasp @ own).reshape(2, 3)
                own = (local @ part.axes(self.snapshot).T).reshape(6)
            elif isinstance(part.contact, Contact):  # along the world's axes; a point's are three
                own = np.concatenate((own, np.zeros(6 - own.size)))
            found[part.contact.name] = own
        return found

    def normal_forces(self) -> dict[str, float]:
        """Return the whole normal force [N] of each surface and point, by contact."""
        return {
            part.contact.name: self.layout.unit * float(part.normal_forces(self.f).sum())
            for part in self.layout.parts
            if part.surface is not None
        }

    def corner_forces(self) -> dict[str, tuple[Array, Array]]:
        """Return points (k, 3) [m] and forces (k, 3) [N] by contact, world axes."""
        found: dict[str, tuple[Array, Array]] = {}
        for part in self.layout.parts:
            if part.surface is not None:
                local = self.layout.unit * self.f[part.columns].reshape(-1, 3)
                forces = local @ part.axes(self.snapshot).T
                found[part.contact.name] = (part.points(self.snapshot), forces)
        return found

    def cop(self) -> Array | None:
        """Return the centre of pressure (3,) of all surfaces and points, or None if none is loaded.

        The mean of the points at which forces act, weighed by the normal forces there: that is the
        CoP of coplanar contacts, and a point between them otherwise. Points on what is steeper
        than 45 degrees, such as a wall, are none of it.
        """
        total, moment = 0.0, np.zeros(3)
        for part in self.layout.parts:
            if part.surface is None:
                continue
            if part.axes(self.snapshot)[2] @ part.normal > LEAST_NORMAL_Z:
                normal = part.normal_forces(self.f)
                total += float(normal.sum())
                moment += normal @ part.points(self.snapshot)
        return moment / total if total * self.layout.unit > UNLOADED else None


def displaced(snapshot: Snapshot, contacts: Sequence[Task]) -> dict[str, float]:
    """Return how far contacts are from their anchors [m], of those that are not at them."""
    found = {}
    for contact in contacts:
        if isinstance(contact, Contact):
            error = contact.residual(snapshot).error
            by = float(np.linalg.norm(error[:3]))
            if by > FAR or float(np.linalg.norm(error[3:])) > TILTED:
                found[contact.name] = by
    return found


def _part(contact: Task, begin: int) -> ContactPart | None:
    """Return the unknowns of a contact behind ``begin`` others; None if it bears no force."""
    if isinstance(contact, Contact) and contact.friction is not None:
        corners = contact.corners
        if corners is None:
            raise InvalidInputError(
                f"{contact}: where its forces act is not known, {contact.frame!r} is no sole of "
                f"{contact.robot.name}; give corners=[[x, y], ...] in the frame's axes, or "
                "friction=None for a grip that also pulls and twists"
            )
        grasp = np.empty((6, 3 * len(corners)))
        for k, corner in enumerate(corners):
            grasp[:3, 3 * k : 3 * k + 3] = np.eye(3)
            grasp[3:, 3 * k : 3 * k + 3] = skew(corner)
        return ContactPart(contact, slice(begin, begin + grasp.shape[1]), grasp)
    if isinstance(contact, Contact | Mechanics):
        return ContactPart(contact, slice(begin, begin + len(contact.rows)), None)
    return None


@lru_cache(maxsize=64)  # a walk plans the same soles again and again, while its robot waits
def _facets_of(
    cone: FrictionCone, normal: tuple[float, ...], corners: int
) -> tuple[Array, tuple[str, ...]]:
    """Return rows on the forces of so many corners (facets of each, 3 each), and their names."""
    facets = cone.matrix()
    angles = np.rad2deg(np.arctan2(facets[:, 1], facets[:, 0])) % 360.0
    rows = np.kron(np.eye(corners), facets @ _axes_of(np.array(normal)).T)
    called = (f"corner {k} friction at {angle:.0f} deg" for k in range(corners) for angle in angles)
    return read_only(rows), tuple(called)


def _axes_of(normal: Array) -> Array:
    """Return the axes (3, 3) of a friction cone, as columns, the last its normal."""
    if normal[2] < -1.0 + STRAIGHT:  # a ceiling: no turn is the shortest
        return np.diag((1.0, -1.0, -1.0))
    return upright_on(normal)


def _names(part: ContactPart) -> list[str]:
    name = part.contact.name
    if part.grasp is None:
        return [f"{name} force {row}" for row in part.contact.rows]
    return [
        f"{name} corner {k} {axis}" for k in range(_corners(part)) for axis in ("fx", "fy", "fz")
    ]


def _corners(part: ContactPart) -> int:
    return (part.columns.stop - part.columns.start) // 3
