"""Centroidal momentum: linear, angular or both."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NoReturn, Unpack

from numpy.typing import ArrayLike

from wbc.errors import InvalidInputError
from wbc.kinds import one_of
from wbc.laws import Residual, columns_of
from wbc.native.rows import Kind, NativeRows
from wbc.robot import Robot, Snapshot
from wbc.tasks.core_task import CoreTask
from wbc.tasks.keywords import ERROR_ONLY, RateGains
from wbc.validate import Array, names_of, read_only

if TYPE_CHECKING:
    from wbc.robot.symbolic import SymbolicPosture

LINEAR, ANGULAR = ("lx", "ly", "lz"), ("kx", "ky", "kz")


class MomentumTask(CoreTask):
    """Bring the centroidal momentum h = A_g v to ``target`` (paper eq. 17 at the CoM).

    Momentum is itself of the velocity level: no configuration has "its" momentum, so the error that
    a gain would act on is zero and the whole task is in the rate, ``e' = A_g v - target``. At the
    velocity level the target is met in one tick. At the torque level ``e'' = -kd e'`` is of first
    order in the momentum, h' = h*' - kd (h - h*), and the error decays as exp(-kd t), kd 20/s by
    default. Gains that would act on an error (``gain``, ``kp``) are refused.

    Parameters
    ----------
    target:
        (6,) linear [kg m/s] then angular about the CoM [kg m^2/s], world axes.
    components:
        Which of ``lx ly lz kx ky kz``.
    """

    _unused = ERROR_ONLY
    _units = dict.fromkeys(LINEAR, "kg m/s") | dict.fromkeys(ANGULAR, "kg m^2/s")

    def __init__(
        self,
        robot: Robot,
        target: ArrayLike = (0, 0, 0, 0, 0, 0),
        *,
        components: Sequence[str] = LINEAR + ANGULAR,
        name: str = "momentum",
        **law: Unpack[RateGains],
    ) -> None:
        components = names_of("momentum task, components", components)
        for component in components:
            one_of("momentum component", component, LINEAR + ANGULAR)
        super().__init__(robot, name, components, **law)
        self._entries = tuple((LINEAR + ANGULAR).index(c) for c in components)
        self._selected = columns_of(self._entries)
        self.set_target(target)

    def set_target(self, target: ArrayLike, rate: ArrayLike | None = None) -> None:
        """Set the wanted momentum and its rate (force [N] and moment [N m] about the CoM)."""
        goal = self._target(target, (6,))
        if self._set_rates((6,), rate):
            self._assign(_drift=self._negative(self.target_rate, self._selected))
        self._assign(_goal=goal, _bias=read_only(-goal[self._selected]))

    def deviation(self, snapshot: Snapshot, residual: Residual) -> Array:
        """Return measured momentum minus target."""
        return (snapshot.momentum - self.target)[self._selected]

    def native(self) -> tuple[NativeRows, ...]:
        """Return the selected entries."""
        rates, moving = (self._bias, self._drift), ("_bias", "_drift")
        return (NativeRows(Kind.MOMENTUM, None, self._entries, *rates, (), moving=moving),)

    def symbolic_error(self, posture: SymbolicPosture) -> NoReturn:
        """Raise InvalidInputError: a posture has no momentum."""
        raise InvalidInputError(
            f"global shaping: task {self.name!r} is about momentum, that is about velocities; a"
            " posture has none. Leave it to the controller that moves there"
        )
