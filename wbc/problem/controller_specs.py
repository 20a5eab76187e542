"""Controllers as a problem file describes them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from wbc.problem.section import Name, NonNegative, OneOf, Positive, Section

TimeStep = Annotated[float, Field(allow_inf_nan=False, ge=1e-6, le=1.0)]


class ControllerSettings(Section):
    """What all methods have in common."""

    dt: TimeStep = 0.005
    """Time step [s]."""
    joint_weights: dict[Name, Positive] = Field(default_factory=dict)
    """Factors on the damping by joint name or pattern, base for the base ({"*wrist*": 10, base:
    100}): which joints move where the tasks leave the choice. Others: 1. A posture task leaves
    none to the joints that it controls, unless damping is near the squares of weights."""


class QpSettings(ControllerSettings):
    """What methods that solve a quadratic program per tick have in common."""

    solver: Name = "proxqp"
    """The QP solver: proxqp, or any that qpsolvers finds installed."""
    eps: Positive | None = None
    """Accuracy asked of the solver; null: its default here."""
    formulation: Literal["equality", "reduced"] = "equality"
    """equality: contacts are rows of the QP; reduced: they are eliminated first."""
    damping: Positive = 1e-6
    """Weight of 1/2 |v|^2: picks one among equally good velocities."""
    on_failure: Literal["hold", "damp", "closest", "raise"] = "hold"
    """When a QP has no solution: stand still, slow down, miss the rows by as little as can be, or
    end the run."""


class QpSpec(QpSettings):
    """One quadratic program per tick: contacts and limits are met exactly, tasks as weighted."""

    method: Literal["qp"] = "qp"


class GlobalSpec(QpSettings):
    """A search from many starts for the posture that serves the tasks best.

    The quadratic program is then run towards the best posture that it can really reach.
    """

    method: Literal["global"]
    starts: int = Field(default=64, ge=1, le=100_000)
    """How many searches at most; the first begins at the start of the run."""
    patience: int | None = Field(default=None, ge=1)
    """The search ends when so many in a row have found nothing better; null: all are made."""
    seconds: Positive | None = None
    """Wall time after which no search is begun [s]; null: all are made. With a time the answer
    depends on how fast the machine is."""
    workers: int = Field(default=2, ge=1, le=256)
    """Processes that search; the answer does not depend on it."""
    seed: int = Field(default=0, ge=0)
    """Of the random postures to search from."""
    support_margin: NonNegative | None = None
    """How far inside the polygon of the held soles the CoM is kept [m]; null: no matter where."""
    attempts: int = Field(default=5, ge=1)
    """How many postures to try to reach, the best first."""
    tolerance: NonNegative = 0.01
    """A posture is reached if the motion ends at no more than its cost and this fraction of it."""

    @property
    def search(self) -> dict[str, Any]:
        """What the search and the motion after it are asked for, by name."""
        own = GlobalSpec.model_fields.keys() - QpSettings.model_fields.keys()
        return self.model_dump(include=own - {"method", "support_margin"})


class PseudoInverseSpec(ControllerSettings):
    """The damped pseudo-inverse of the paper, a baseline: limits are met by clipping."""

    method: Literal["pseudo_inverse"]
    damping: Positive = 1e-3
    """Weight of 1/2 |v|^2; the tasks' rows nearly lose rank, so it must not be tiny."""


ControllerChoice = Annotated[
    QpSpec | GlobalSpec | PseudoInverseSpec, OneOf("method", "{solver: proxqp}")
]
