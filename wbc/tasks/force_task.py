"""Tasks on contact forces and torques, for the torque level only.

They are in the same list as all others, with weight and priority. Their error is affine in the
unknowns of a tick: the velocity at its end and the contact forces, x = (v+, f).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple, NoReturn, Protocol

from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError, shown
from wbc.laws import Rows
from wbc.robot import Robot, Snapshot
from wbc.tasks.task import Task
from wbc.tasks.validation import is_tested
from wbc.validate import Array, answer_of, returned_array

WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")


class Affine(NamedTuple):
    """``matrix @ x + constant``: (k, n) and (k,)."""

    matrix: Array
    constant: Array


class Dynamics(Protocol):
    """Forces and torques in terms of the unknowns x (n,), at one snapshot."""

    @property
    def snapshot(self) -> Snapshot:
        """Where the robot is."""

    @property
    def size(self) -> int:
        """How many unknowns there are, n."""

    @property
    def unit(self) -> float:
        """The robot's mass over the period of the tick, m / dt [kg/s]."""

    @property
    def contacts(self) -> Sequence[str]:
        """Frames of the contacts that bear forces."""

    def wrench(self, frame: str) -> Array:
        """Return (6, n): wrench [N, N m] on the robot at the frame's origin, world axes, by x.

        Zero for a frame that is not in contact now.
        """

    def torque(self, joints: Sequence[int]) -> Affine:
        """Return torques [N m] of some joints, by index."""

    def last_wrench(self, frame: str) -> Array | None:
        """Return the wrench (6,) that the last tick decided; None if there is no last tick."""


class ForceTask(Task):
    """A task about forces or torques, for a :class:`~wbc.controllers.torque.TorqueController`.

    Subclasses define :meth:`expression`, unless the core knows their kind. The error that a tick
    reports is that of its own decision, in N or N m.

    Parameters
    ----------
    weight:
        (k,) factors on the error times dt / m, or one for all: a force weighs what the velocity
        does that it would give to the robot's mass in a tick. So 1/(m/s) for a force, as for a CoM.
        A weight then means the same for small and large robots, fast and slow loops.

    See :class:`~wbc.tasks.task.Task` for the others; there are no gains.
    """

    def __init__(
        self,
        robot: Robot,
        name: str,
        rows: Iterable[str],
        *,
        weight: ArrayLike = 1.0,
        priority: int = 0,
    ) -> None:
        super().__init__(robot, name, rows, weight=weight, priority=priority)

    def expression(self, dynamics: Dynamics) -> Affine:
        """Return the error, actual minus target [N or N m], by the unknowns: (k, n) and (k,).

        Raises
        ------
        InvalidInputError
            A kind that does not define it; only those that the core knows need not.
        """
        raise InvalidInputError(
            f"{self}: a {type(self).__name__} does not define expression(), its error by what a"
            " tick decides"
        )

    def force_rows(self, dynamics: Dynamics) -> Rows:
        """Return the rows on the unknowns, in their units (m/s).

        Raises
        ------
        InvalidInputError
            The expression of a task of one's own has other shapes than the task's rows and the
            unknowns say, or holds what is no finite number.
        """
        if is_tested(self, "expression"):
            matrix, constant = self.expression(dynamics)
        else:
            matrix, constant = self._checked(
                answer_of(self, "expression", self.expression, dynamics), dynamics.size
            )
        return Rows(matrix / dynamics.unit, constant / -dynamics.unit, self.weight)

    def _checked(self, found: object, n: int) -> Affine:
        k = len(self.rows)
        if not (isinstance(found, tuple) and len(found) == 2):
            raise InvalidInputError(
                f"{self}, which has {k} rows: expression() must return matrix ({k}, {n}) and"
                f" constant ({k},); got {shown(found)}"
            )
        what = f"{self}: expression(), "
        return Affine(
            returned_array(f"{what}matrix", found[0], (k, n)),
            returned_array(f"{what}constant", found[1], (k,)),
        )

    def residual(self, snapshot: Snapshot) -> NoReturn:
        """Raise InvalidInputError: a state has no force."""
        raise InvalidInputError(
            f"{self}: a {type(self).__name__} is about forces, which a state does not say;"
            " only a TorqueController decides them"
        )

    @property
    def units(self) -> tuple[str, ...]:
        """Newtons, and newton metres of rows called ``m...``."""
        if self._units:
            return super().units
        return tuple("N m" if row.split()[-1].startswith("m") else "N" for row in self.rows)

    def _contact_frame(self, frame: str) -> str:
        """Return the frame of a contact, which the robot must have."""
        self.robot.frame_id(frame)
        return frame
