"""Static equilibrium of a standing robot: the joint torques needed, and those available."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wbc.constraints.mechanics import mechanics_of
from wbc.controllers.contact_forces import ContactForces, Reaction, displaced
from wbc.errors import InvalidInputError, WbcError, shown
from wbc.qp.active_set import ActiveSet
from wbc.qp.problem import QP, Labels
from wbc.qp.solution import Status
from wbc.robot import Snapshot
from wbc.robot.model import check_snapshot
from wbc.tasks.task import Task
from wbc.validate import Array, finite_number, read_only

# Costs of squares, in units of the robot's weight (and, for moments, times one metre): of the
# unbalanced wrench, of torque beyond the limits, of torque, and of forces. With a ratio of 1e12
# between the first and the last, rounding in the solver left torques 0.4 to 1.4 N m off the
# optimum.
UNHELD, EXCESS, TORQUE, FORCE = 1e7, 1e5, 1.0, 1e-3
# Residuals of the first two below this are no failure: fractions of the weight, and of a limit.
NEGLIGIBLE = 1e-3
ROUNDING = 1e-6  # torques below this fraction of weight times one metre are zero


@dataclass(frozen=True, eq=False, repr=False)
class Stance:
    """Torques and contact forces of static equilibrium at one snapshot.

    Attributes
    ----------
    torque:
        (nv - 6,) least torques [N m or N]; they exceed the limits only if no others exist.
    most:
        (nv - 6,) the torque limits.
    reaction:
        The contact forces in that equilibrium.
    unheld:
        (6,) unbalanced force [N] and moment [N m] on the base, base axes, beyond these contacts.
    displaced:
        Distance [m] from its anchor of each contact that is not at it.
    """

    snapshot: Snapshot
    torque: Array
    most: Array
    reaction: Reaction
    unheld: Array
    displaced: Mapping[str, float]

    def __repr__(self) -> str:
        said = "can stand" if self.ok else "cannot stand: see report()"
        return f"Stance({self.snapshot.robot.name!r}, {said})"

    @property
    def forces(self) -> dict[str, Array]:
        """By contact: wrench (6,) on the robot at the frame's origin, world axes [N, N m]."""
        return self.reaction.wrenches()

    @property
    def overloaded(self) -> dict[str, tuple[float, float]]:
        """Required and largest available torque of each joint where the first is greater."""
        unsaid = ROUNDING * self.snapshot.robot.weight
        beyond = np.abs(self.torque) > (1.0 + NEGLIGIBLE) * self.most + unsaid
        names = self.snapshot.robot.joint_names
        return {
            names[k]: (float(self.torque[k]), float(self.most[k])) for k in np.flatnonzero(beyond)
        }

    @property
    def held(self) -> bool:
        """Whether the contacts can carry the robot, whatever the torques."""
        return float(np.abs(self.unheld).max()) <= NEGLIGIBLE * self.snapshot.robot.weight

    @property
    def ok(self) -> bool:
        """Whether it can stand: contacts at their anchors that carry it, and sufficient torques."""
        return self.held and not self.overloaded and not self.displaced

    def report(self) -> str:
        """Return the reasons why it cannot stand, by contact and joint, or ``"can stand"``."""
        said = [
            f"contact {name!r} is {1e3 * by:.3g} mm from its anchor: in the air, or anchored"
            " elsewhere"
            for name, by in self.displaced.items()
        ]
        if not self.held:
            force, moment = np.linalg.norm(self.unheld[:3]), np.linalg.norm(self.unheld[3:])
            which = ", ".join(self.forces) or "no contacts"
            said.append(
                f"no forces of {which} bear the robot: {force:.4g} N and {moment:.4g} N m on its"
                " base are left; move its CoM over the support, or add a contact"
            )
        said += [
            f"{name} needs {needed:.4g} N m and has {most:.4g}"
            for name, (needed, most) in self.overloaded.items()
        ]
        return "; ".join(said) or "can stand"


def stance_torques(
    snapshot: Snapshot, contacts: Sequence[Task], *, torque_limits: float = 1.0
) -> Stance:
    """Return the torques that keep a robot in static equilibrium, or come nearest to it.

    In statics: bias = [0; tau] + J' f + passive, with contact forces f inside their cones and what
    springs give. Torques have the least sum of squares within the limits, if possible; otherwise
    they exceed the limits least.

    Parameters
    ----------
    snapshot:
        The posture; its velocity is ignored.
    contacts:
        As for a :class:`~wbc.controllers.torque.TorqueController`.
    torque_limits:
        Factor on the robot's effort limits.

    Raises
    ------
    InvalidInputError
        No snapshot, no contacts, or contacts with unknown points of force.
    """
    check_snapshot("stance", snapshot)
    robot = snapshot.robot
    given = list(contacts) if isinstance(contacts, Iterable) else [None]
    if any(not isinstance(one, Task) or one.robot is not robot for one in given):
        raise InvalidInputError(
            f"stance: expected a list of contacts of this {robot.name} object,"
            f" got {shown(contacts)}"
        )
    factor = finite_number("stance, torque_limits", torque_limits, above=0.0)
    rest = robot.snapshot(snapshot.q, np.zeros(robot.nv))
    weight = robot.weight
    forces = ContactForces(robot, mechanics_of(robot, given), weight)
    most = factor * robot.limits.effort
    most[[robot.joint_index(name) - 6 for name in robot.motorless]] = 0.0
    known = (rest.bias - robot.passive_forces_at(rest)) / weight
    by_force = forces.generalized(rest)
    qp = _statics(forces, known, by_force, most / weight)
    solution = ActiveSet().solve(qp, quick=True)
    if solution.status is not Status.SOLVED:
        raise WbcError(f"stance: its QP was not solved: {solution.message or solution.status}")
    f = solution.x[: forces.size]
    torque = weight * (known[6:] - by_force[6:] @ f)
    return Stance(
        snapshot,
        read_only(torque),
        read_only(most),
        Reaction(forces, rest, f),
        read_only(weight * (known[:6] - by_force[:6] @ f)),
        displaced(snapshot, given),
    )


def _statics(forces: ContactForces, known: Array, by_force: Array, most: Array) -> QP:
    """Return the QP of forces and of torques beyond ``most``, in units of the weight."""
    k, n = forces.size, most.size
    # x = (f, lack): tau = bias - J' f, |tau + lack| <= most; base rows are costs.
    base, joints = by_force[:6], by_force[6:]
    P = np.zeros((k + n, k + n))
    P[:k, :k] = UNHELD * base.T @ base + TORQUE * joints.T @ joints + FORCE * np.eye(k)
    P[k:, k:] = EXCESS * np.eye(n)
    g = np.concatenate((-UNHELD * base.T @ known[:6] - TORQUE * joints.T @ known[6:], np.zeros(n)))
    cones = forces.bounds()
    bounded = np.isfinite(most)
    rows = np.zeros((cones.lower.size + int(bounded.sum()), k + n))
    rows[: cones.lower.size, :k] = cones.matrix
    rows[cones.lower.size :, :k] = -joints[bounded]
    rows[cones.lower.size :, k:] = np.eye(n)[bounded]
    free = np.full(n, np.inf)
    return QP(
        P,
        g,
        np.zeros((0, k + n)),
        np.zeros(0),
        rows,
        np.concatenate((cones.lower, (-most - known[6:])[bounded])),
        np.concatenate((cones.upper, (most - known[6:])[bounded])),
        np.concatenate((forces.lower, -free)),
        np.concatenate((forces.upper, free)),
        Labels((), (*cones.labels, *("torque",) * int(bounded.sum())), (*forces.names, *("",) * n)),
    )
