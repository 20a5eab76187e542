"""Rest: joints, and the base if wanted, kept as slow as other tasks allow."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Unpack

import numpy as np

from wbc.errors import InvalidInputError
from wbc.kinds import switch
from wbc.laws import Residual
from wbc.robot import Robot, Snapshot
from wbc.robot.limits import BASE_NV
from wbc.robot.model import check_robot
from wbc.tasks.keywords import ERROR_ONLY, RateKeywords
from wbc.tasks.task import Task
from wbc.tasks.weights import joint_factors
from wbc.validate import Array, finite_number, read_only

if TYPE_CHECKING:  # CasADi is loaded by who asks for expressions
    from wbc.robot.symbolic import Expression, SymbolicPosture


class DampingTask(Task):
    """Bring the velocity to zero, at any configuration.

    The error is zero and its rate is the velocity: the velocity level demands zero at once. At the
    torque level velocities decay as exp(-kd t), kd 20/s by default. Gains that would act on an
    error (``gain``, ``kp``) are refused.

    Parameters
    ----------
    weight:
        [1/(rad/s)] or [1/(m/s)], the same for all velocities.
    joints:
        Factors on ``weight`` by joint name or shell pattern, later entries win; 0 leaves a joint
        out, and joints that no entry matches keep 1.
    base:
        Whether the base's velocity counts too: linear [m/s] and angular [rad/s], base axes.
    """

    _unused = ERROR_ONLY
    _units = "m/s or rad/s"

    def __init__(
        self,
        robot: Robot,
        *,
        joints: Mapping[str, float] | None = None,
        base: bool = True,
        name: str = "damping",
        weight: float = 1.0,
        priority: int = 0,
        **law: Unpack[RateKeywords],
    ) -> None:
        check_robot(type(self).__name__, robot)
        counts = switch(f"task {name!r}, base", base)
        factors = joint_factors(robot, joints, name)
        factors[:BASE_NV] = counts
        chosen = np.flatnonzero(factors)
        if not chosen.size:
            raise InvalidInputError(f"task {name!r}: nothing left to damp; leave the task out")
        names = [f"base {row}" for row in ("x", "y", "z", "rx", "ry", "rz")] + [*robot.joint_names]
        size = finite_number(f"task {name!r}, weight", weight, least=0.0)
        rows, weights = [names[k] for k in chosen], size * factors[chosen]
        super().__init__(robot, name, rows, weight=weights, priority=priority, **law)
        self._jacobian = read_only(np.eye(robot.nv)[chosen])
        self._still = self._zeros()

    def residual(self, snapshot: Snapshot) -> Residual:
        """Return a zero error whose rate is the velocity."""
        return Residual(self._still, self._jacobian, self._still)

    def drift(self, snapshot: Snapshot) -> Array:
        """Return zero: velocities are coordinates."""
        return self._still

    def deviation(self, snapshot: Snapshot, residual: Residual) -> Array:
        """Return the measured velocities."""
        return residual.rate(snapshot.v)

    def symbolic_error(self, posture: SymbolicPosture) -> Expression:
        """Return zeros: no posture is preferred."""
        return posture.joints[0] * self._still
