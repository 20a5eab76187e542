"""Controllers of a problem file: their description, and making them."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from wbc.constraints.contact import DEFAULT_FRICTION
from wbc.constraints.friction import FrictionCone
from wbc.controllers import Controller, KinematicController, TorqueController
from wbc.controllers.tick import POLICIES
from wbc.controllers.torque import POLICIES as TORQUE_POLICIES
from wbc.problem.section import Name, NonNegative, Positive, Section, Words, default_of
from wbc.problem.support import Friction, cone
from wbc.qp.backend import Backend, make_backend
from wbc.robot import Robot
from wbc.tasks import Task

TimeStep = Annotated[float, Field(allow_inf_nan=False, ge=1e-6, le=1.0)]


def _velocity(level: object) -> object:
    if level == "torque":
        text = "the methods global and pseudo_inverse are of the velocity level"
        raise PydanticCustomError("level", text)
    return level


VelocityOnly = Annotated[Literal["velocity"], BeforeValidator(_velocity)]
_TORQUE = "the torque level; give level: torque"


class ControllerSpec(Section):
    """The base of all methods."""

    elsewhere: ClassVar[Mapping[str, str]] = dict.fromkeys(
        (
            "torque_limits",
            "force_damping",
            "force_ramp",
            "friction",
            "delay",
            "spring_time",
            "friction_compensation",
        ),
        _TORQUE,
    )

    level: str
    dt: TimeStep = default_of(KinematicController, "dt")
    """Time step [s]."""
    joint_weights: dict[Name, Positive] = Field(default_factory=dict)
    """Factors on the damping by joint name or pattern, base for the base ({"*wrist*": 10, base:
    100}): which joints move where the tasks leave the choice. Others: 1. A posture task leaves
    none to the joints that it controls, unless damping is near the squares of weights."""
    damping: Positive

    @property
    def friction_cone(self) -> FrictionCone:
        """The friction cone of contacts without their own."""
        return DEFAULT_FRICTION

    @abstractmethod
    def build(self, robot: Robot, tasks: Sequence[Task], **parts: Any) -> Controller:
        """Return a new controller; for ``parts`` see :class:`~wbc.controllers.KinematicController`.

        Raises WbcError: parts that do not fit together, or a solver that is not installed.
        """


class SolverSettings(ControllerSpec):
    """The base of methods that solve a quadratic program per tick, at both levels."""

    solver: Name = default_of(KinematicController, "solver")
    """The QP solver: proxqp, active_set, or any that qpsolvers finds installed."""
    eps: Positive | None = None
    """Accuracy asked of the solver; null: its default here."""
    deadline: Positive | None = default_of(KinematicController, "deadline")
    """Time that a tick may take [s]; once it is over nothing is solved again. null: no deadline."""

    def backend(self) -> Backend:
        """Return the solver.

        Raises WbcError: it is not installed, or does not take this accuracy.
        """
        return make_backend(self.solver, **({} if self.eps is None else {"eps": self.eps}))


class QpSettings(SolverSettings):
    """The base of methods of the velocity level that solve a quadratic program per tick."""

    damping: Positive = default_of(KinematicController, "damping")
    """Weight of 1/2 |v|^2: picks one among equally good velocities."""
    on_failure: Annotated[str, Words(POLICIES)] = default_of(KinematicController, "on_failure")
    """When a QP has no solution: stand still, slow down, violate the rows as little as possible, or
    end the run."""

    def build(self, robot: Robot, tasks: Sequence[Task], **parts: Any) -> KinematicController:
        """Return a new controller."""
        keys = {"dt", "joint_weights", "damping", "on_failure", "deadline"}
        settings = self.model_dump(include=keys)
        return KinematicController(robot, tasks, solver=self.backend(), **settings, **parts)


class QpSpec(QpSettings):
    """One quadratic program per tick: contacts and limits are met exactly, tasks as weighted."""

    method: Literal["qp"] = "qp"
    level: Literal["velocity"] = "velocity"


class TorqueSpec(SolverSettings):
    """Inverse dynamics by one quadratic program per tick: for ``wbc sim``."""

    elsewhere: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("starts", "patience", "seconds", "workers", "seed", "support_margin", "attempts",
         "tolerance"),
        "the method global, of the velocity level",
    )  # fmt: skip

    method: Literal["qp"] = "qp"
    level: Literal["torque"]
    dt: TimeStep = default_of(TorqueController, "dt")
    """Period of the control loop [s]."""
    torque_limits: Positive | None = default_of(TorqueController, "torque_limits")
    """Factor on the robot's effort limits; null: no torque bounds."""
    damping: Positive = default_of(TorqueController, "damping")
    """Weight of 1/2 |v+ - v|^2, the change of velocity in a tick."""
    force_damping: Positive = default_of(TorqueController, "force_damping")
    """Weight of 1/2 |f dt/m|^2, which shares the load among the corners of the soles."""
    force_ramp: NonNegative = default_of(TorqueController, "force_ramp")
    """How long contact forces take to come and go when the support changes [s]; 0: at once."""
    delay: NonNegative = default_of(TorqueController, "delay")
    """Known time from a measurement to the action of its torque [s]: the sum of the sensors' delay
    and latency. States are predicted over it."""
    spring_time: NonNegative = default_of(TorqueController, "spring_time")
    """While anything bears on the ground, within which springs of joints without a motor give way
    until they bear what is asked for [s]; 0: at once, which chatters where they are stiff."""
    friction_compensation: Annotated[float, Field(ge=0.0, le=1.0)] = default_of(
        TorqueController, "friction_compensation"
    )
    """Part of the joints' dry friction that torques make up for."""
    friction: Friction = default_of(FrictionCone, "coefficient")
    """Friction coefficient that the controller counts on, or {coefficient: ..., facets: ...}; of
    contacts that the support gives none of their own."""
    on_failure: Annotated[str, Words(TORQUE_POLICIES)] = default_of(TorqueController, "on_failure")
    """If even the QP that keeps nothing but physics has no solution: bring the joints to rest, or
    end the run."""

    @property
    def friction_cone(self) -> FrictionCone:
        """The friction cone of contacts without their own."""
        return cone(self.friction)

    @property
    def settings(self) -> dict[str, Any]:
        """Those of the controller, but for its solver."""
        return self.model_dump(exclude={"method", "level", "solver", "eps", "friction"})

    def build(self, robot: Robot, tasks: Sequence[Task], **parts: Any) -> TorqueController:
        """Return a new controller."""
        return TorqueController(robot, tasks, solver=self.backend(), **self.settings, **parts)


class GlobalSpec(QpSettings):
    """A search from many starts for the posture that serves the tasks best.

    The quadratic program is then run towards the best posture that it can really reach.
    """

    method: Literal["global"]
    level: VelocityOnly = "velocity"
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
        """The settings of the search and of the motion after it, by name."""
        own = GlobalSpec.model_fields.keys() - QpSettings.model_fields.keys()
        return self.model_dump(include=own - {"method", "level", "support_margin"})


class PseudoInverseSpec(ControllerSpec):
    """A damped pseudo-inverse of all of v, a baseline: limits are met by clipping.

    Floating it is the step of the paper (eq. 38); with held feet the paper's is least in other
    coordinates, see ``wbc.IndependentCoordinates``.
    """

    method: Literal["pseudo_inverse"]
    level: VelocityOnly = "velocity"
    damping: Positive = 1e-3
    """Weight of 1/2 |v|^2; the tasks' rows nearly lose rank, so it must not be tiny."""

    def build(self, robot: Robot, tasks: Sequence[Task], **parts: Any) -> KinematicController:
        """Return a new controller."""
        settings = self.model_dump(exclude={"method", "level"})
        return KinematicController(robot, tasks, solver="pseudo_inverse", **settings, **parts)
