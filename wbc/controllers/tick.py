"""The result of one control tick, and the policies for QPs without a solution."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Self

import numpy as np

from wbc.constraints.limits import Limits
from wbc.controllers.singular import Singularity
from wbc.errors import InvalidInputError, listed, no_attribute
from wbc.notebook import as_html
from wbc.qp.problem import QP
from wbc.qp.solution import Conflict, Solution, Status
from wbc.robot.limits import BASE_NV
from wbc.safe_pickle import write_pickled
from wbc.validate import Array

POLICIES = ("hold", "damp", "closest", "raise")
TICK_FILE = "wbc tick 1"
RELAX = "relax"  # the policy of a torque tick from the relaxed QP
# Multipliers below this share of the largest, or below this value, are a solver's residue.
ACTIVE, NEGLIGIBLE = 1e-6, 1e-9


class Times(NamedTuple):
    """Durations of a tick's stages [s]: evaluating tasks, assembling the QP, solving it."""

    tasks: float
    assembly: float
    solve: float

    @property
    def total(self) -> float:
        """The whole tick without the snapshot [s]."""
        return self.tasks + self.assembly + self.solve


# Relative excess over the acceleration limit that counts as a solver's residue.
ACCELERATION_TOLERANCE = 1e-3


class TickSource(Protocol):
    """The controller of a tick."""

    ticks: int

    def changed(self) -> str | None:
        """Return what was changed since the last tick, in words, or None."""


class TickOrigin(NamedTuple):
    """The inputs of a tick: to compare its command with, and to repeat it."""

    limits: Limits | None
    measured: bytes  # the bytes of q, then of v
    acceleration: Array | None  # (nv - 6,) limits in this tick; limits may be assigned later
    dt: float  # time step [s]
    controller: TickSource
    memory: tuple[object, ...]  # the controller's state before this tick, except warm starts
    number: int  # of this tick, counted by the controller

    def braked(self, velocity: Array) -> dict[str, float]:
        """Return how much harder joints brake than their limit, by name: see :class:`Tick`."""
        if self.limits is None or self.acceleration is None:
            return {}
        v = np.frombuffer(self.measured)[-velocity.size :]
        part = np.abs(velocity - v)[BASE_NV:] / (self.dt * self.acceleration)
        names = self.limits.robot.joint_names
        return {
            names[k]: float(part[k]) for k in np.flatnonzero(part > 1.0 + ACCELERATION_TOLERANCE)
        }


# Fields that a tick of the core reads on demand.
_READ_ON_DEMAND = frozenset(
    ("status", "policy", "errors", "solution", "qp", "times", "slack", "singular", "left_out")
)


@dataclass(frozen=True, eq=False)
class Tick:
    """The answer of a controller at one snapshot.

    Attributes
    ----------
    velocity:
        (nv,) command; always finite. If ``status`` is not ``solved`` it comes from the policy.
    status:
        Of the QP.
    policy:
        None, or the declared policy that made the command because the QP gave none.
    errors:
        Error of each task by name, actual minus target.
    solution, qp:
        The evidence: multipliers, recomputed KKT residuals, named rows, rows in conflict. Rows of
        constraints with slack are in ``qp`` as if they were hard, without their slack variables:
        the solution misses them by ``slack``.
    times:
        Seconds by stage.
    step_scale:
        Part of the solution that is commanded: below 1 in the rare tick in which all of it would
        end inside a margin (see :mod:`wbc.controllers.look_ahead`).
    slack:
        By how much rows are missed that may give way, or that the policy ``closest`` gave up, by
        name, in their units; signs as (what is) - (nearest allowed).
    singular:
        Of each task with ``singular_threshold``, by name: its rank and least singular value, and
        by how much its wanted rate was reduced.
    braked:
        Joints that brake, or turn round, harder than their acceleration limit, by name: their
        change of velocity in this tick over the limit's. Limits with ``braking="free"`` allow it;
        with ``"bounded"`` it takes a position limit, a contact or a margin, or a policy.
    left_out:
        Levels of lower priority that are not in the command, in words: their QPs were not solved,
        or the deadline was over.
    late:
        Gears and loops that are off, and of which limits let a part only be taken back in this
        tick.
    """

    velocity: Array
    status: Status
    policy: str | None
    errors: Mapping[str, Array]
    solution: Solution
    qp: QP
    times: Times
    step_scale: float = 1.0
    slack: Mapping[str, float] = field(default_factory=dict)
    singular: Mapping[str, Singularity] = field(default_factory=dict)
    left_out: tuple[str, ...] = field(default_factory=tuple)
    braked: Mapping[str, float] = field(default_factory=dict)
    late: tuple[str, ...] = ()

    @classmethod
    def reading(cls, evidence: object, velocity: Array, known: Mapping[str, Any] | None) -> Self:
        """Return a tick that reads what is not ``known`` from ``evidence`` on demand."""
        tick = object.__new__(cls)  # __init__ of a frozen dataclass is slow
        own = tick.__dict__
        own["velocity"], own["_evidence"] = velocity, evidence
        if known:
            own.update(known)
        return tick

    if not TYPE_CHECKING:  # a misspelt attribute is an error

        def __getattr__(self, name):
            if name == "braked":
                origin = self._tick_origin()
                self.__dict__[name] = found = origin.braked(self.velocity) if origin else {}
                return found
            evidence = self.__dict__.get("_evidence")
            if evidence is None or name not in _READ_ON_DEMAND:
                hint = ""
                if name in ("torque", "forces", "cop", "acceleration", "reaction", "relaxed"):
                    hint = "; torques and forces are of a TorqueController's ticks"
                known = _READ_ON_DEMAND.union(dir(type(self)), self.__dict__)
                raise no_attribute(f"{type(self).__name__!r} object", name, known, hint)
            value = self.__dict__[name] = getattr(evidence, name)
            return value

    def _tick_origin(self) -> TickOrigin | None:
        """Return the tick's inputs, which the controller stored; None for a copied tick."""
        origin = self.__dict__.get("_origin")
        return None if origin is None else TickOrigin(*origin)

    def __getstate__(self) -> dict[str, object]:
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def __repr__(self) -> str:
        names = [*self.errors]
        told = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
        size = f"nv={self.velocity.size}"
        return f"{type(self).__name__}({self.status.value}, {size}, errors: {told})"

    @property
    def ok(self) -> bool:
        """True if the QP was solved and checked."""
        return self.status is Status.SOLVED

    @property
    def active(self) -> tuple[str, ...]:
        """Labels of the inequality rows that hold the command back, the strongest first.

        Such as ``"left_hand vs pelvis"``; where two cuts of one margin hold, it is named once.
        """
        names = self.qp.labels
        if not self.ok or not names.inequality:
            return ()
        pull = list(zip(names.inequality, abs(self.solution.z).tolist(), strict=True))
        rows = set(names.inequality)  # those active on a level above are equalities below
        above = zip(names.equality, abs(self.solution.y).tolist(), strict=True)
        pull += [(name, size) for name, size in above if name in rows]
        least = max(NEGLIGIBLE, ACTIVE * max(size for _, size in pull))
        strongest = sorted(pull, key=lambda one: -one[1])
        return tuple(dict.fromkeys(name for name, size in strongest if size > least))

    def report(self) -> str:
        """Return what went wrong, or was left out, in one or two sentences, or ``"solved"``."""
        braked = ", ".join(f"{name} by {by:.3g} times" for name, by in self.braked.items())
        braked = f"; brakes harder than its acceleration limit: {braked}" if braked else ""
        if self.ok:
            left_out = "; ".join(self.left_out)
            off = ", ".join(self.late)
            off = f"; off, and limits let it come back only so fast: {off}" if off else ""
            return ("solved" + f", but left out: {left_out}" * bool(left_out)) + braked + off
        conflict = self.conflict
        reason = self.solution.message or str(self.solution.residuals)
        if conflict is not None:
            reason = conflict.describe()
        missed = ", ".join(f"{name} by {by:.3g}" for name, by in self.slack.items())
        return (
            f"QP {self.status.value} ({self.solution.solver}): {reason}; command by {self.policy!r}"
            + (f", which misses {missed}" if missed else "")
            + braked
        )

    @property
    def conflict(self) -> Conflict | None:
        """Rows that contradict each other, each of them to blame, or None: the solution's."""
        return self.solution.conflict

    def _repr_html_(self) -> str:
        fastest = int(np.argmax(np.abs(self.velocity)))
        largest = f"{self.qp.labels.variables[fastest]} {self.velocity[fastest]:+.3g}"
        facts = [
            ("held back by", listed(self.active)),
            ("largest velocity", largest),
            ("solver", f"{self.solution.solver}, {1e6 * self.times.total:.0f} us"),
        ]
        errors = [(f"error of {name}", np.array2string(error, precision=3, threshold=6))
                  for name, error in self.errors.items()]  # fmt: skip
        return as_html(f"{type(self).__name__}: {self.report()}", facts, errors)

    def answer(self) -> dict[str, Any]:
        """Return the command and its status as plain data: see :class:`SavedTick`."""
        command = {"velocity": self.velocity, "torque": getattr(self, "torque", None)}
        slack = {name: float(by) for name, by in self.slack.items()}
        return {name: value for name, value in command.items() if value is not None} | {
            "status": self.status.value,
            "policy": self.policy,
            "slack": slack,
            "solver": self.solution.solver,
            "report": self.report(),
        }

    def save(self, path: str | Path) -> None:
        """Write the controller, the measured state and this tick's command into a file.

        ``wbc replay FILE``, or :class:`wbc.SavedTick`, repeats the tick on any machine; the file
        holds the robot, except its mesh files. Save a tick before the controller's next step.

        Raises
        ------
        InvalidInputError
            The controller has gone on, or a target was changed since; or a part of yours cannot be
            pickled.
        OSError
            The file cannot be written.
        """
        origin = self._tick_origin()
        if origin is None:
            raise InvalidInputError(f"{path}: a copied tick has no controller; save the original")
        controller = origin.controller
        changed = controller.changed()
        if origin.number != controller.ticks:
            changed = f"{controller.ticks - origin.number} ticks were taken since"
        if changed:
            raise InvalidInputError(
                f"{path}: {changed}, and the file would tell of another tick; save a tick before"
                " anything is changed and before the next step"
            )
        content = controller, origin.memory, origin.measured, self.answer()
        write_pickled(path, TICK_FILE, content)
