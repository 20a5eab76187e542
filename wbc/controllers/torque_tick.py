"""The result of one tick at the torque level."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from wbc.controllers.contact_forces import Reaction, displaced
from wbc.controllers.tick import RELAX, Tick
from wbc.qp.solution import Conflict, Solution
from wbc.validate import Array


@dataclass(frozen=True, eq=False, kw_only=True)
class TorqueTick(Tick):
    """The result of a torque controller at one snapshot; ``velocity`` is v+, at the tick's end.

    Attributes
    ----------
    torque:
        (nv - 6,) command [N m or N]; always finite and inside the torque bounds.
    acceleration:
        (nv,) time derivative of v, constant over the tick.
    reaction:
        The contact forces, from which the properties below are computed on demand.
    ramps:
        Largest normal force in this tick of each contact that is being added or removed [N]. See
        :meth:`TorqueController.set_contacts`.
    wrenches:
        Known external wrenches (6,) by frame, as passed to :meth:`TorqueController.step`.
    refuted:
        If rows were relaxed: the result of the QP in which all are hard. Its ``conflict`` names the
        rows that cannot all hold; without one the deadline had passed (``left_out``), or no solver
        found a solution.
    """

    torque: Array
    acceleration: Array
    reaction: Reaction
    ramps: Mapping[str, float]
    wrenches: Mapping[str, Array] = field(default_factory=dict)
    refuted: Solution | None = None

    __repr__ = Tick.__repr__

    @property
    def forces(self) -> dict[str, Array]:
        """By contact: wrench (6,) on the robot at the frame's origin, world axes, [N] then [N m].

        For a gear it is its generalized force.
        """
        return self.reaction.wrenches()

    @property
    def corner_forces(self) -> dict[str, tuple[Array, Array]]:
        """By contact with a friction cone: points (k, 3) [m] and forces (k, 3) [N], world axes."""
        return self.reaction.corner_forces()

    @property
    def cop(self) -> Array | None:
        """Centre of pressure (3,) of all contacts [m], None if none is loaded."""
        return self.reaction.cop()

    @property
    def relaxed(self) -> tuple[str, ...]:
        """Names of the contact rows, limits and margins that were relaxed; see ``slack``.

        Empty in a tick that met them all: ``policy`` is then None, or ``"relax"`` where only the
        relaxed QP could be solved, with negligible violations.
        """
        return tuple(self.slack) if self.policy == RELAX else ()

    @property
    def displaced(self) -> dict[str, float]:
        """Distances [m] of contacts off their anchors: in the air, or held elsewhere.

        Their computed forces are then not those of the ground. The controller moves
        them towards their anchors.
        """
        contacts = [part.contact for part in self.reaction.layout.parts]
        return displaced(self.reaction.snapshot, contacts)

    def report(self) -> str:
        """Describe relaxed rows and failures in one or two sentences, or return ``"solved"``."""
        away = "".join(
            f"; contact {name!r} is {1e3 * by:.3g} mm from its anchor"
            for name, by in self.displaced.items()
        )
        if self.policy != RELAX:
            return Tick.report(self) + away
        missed = ", ".join(f"{name} by {by:.3g}" for name, by in self.slack.items())
        why = ""
        if self.conflict is not None:
            why = f": {self.conflict.describe()}"
        elif self.left_out:
            why = ": the deadline was over"
        missed = missed or "nothing noticeable"
        lost = f"; {self.solution.message}" if self.solution.message else ""
        return f"not everything could be kept{why}; gave way: {missed}{lost}{away}"

    @property
    def conflict(self) -> Conflict | None:
        """A smallest set of rows that contradict each other, or None."""
        return self.solution.conflict if self.refuted is None else self.refuted.conflict
