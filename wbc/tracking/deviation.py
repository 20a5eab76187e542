"""Tracking errors of a robot on a plan, and intervals in which a motion is infeasible."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike

from wbc.robot import Robot
from wbc.robot.series import state_series
from wbc.spatial import COLUMNS, FROBENIUS_WEIGHTS, ROWS
from wbc.tracking.reference import PlanTarget
from wbc.validate import Array


@dataclass(frozen=True)
class Unbalanced:
    """An interval in which the motion is not feasible as it is.

    Attributes
    ----------
    what:
        ``CoP outside the feet`` [m], ``friction above the cone`` (the missing coefficient),
        ``torque above the limit`` (part of it), ``force without a foot`` (part of the weight). Of
        constraints: ``sole slides`` [m], ``margin broken`` [m], ``joint limit passed`` [rad],
        ``speed above the limit``, ``acceleration above the motor's`` (parts of these).
    by:
        Largest excess.
    start, end, worst:
        Times [s].
    where:
        The joint, the bodies, or the feet that stand.
    """

    what: str
    by: float
    start: float
    end: float
    worst: float
    where: str

    def __str__(self) -> str:
        span = f"at {self.worst:.2f} s"
        if self.end > self.start:
            span = f"{self.start:.2f} to {self.end:.2f} s, worst {span}"
        return f"{self.what} by {self.size} ({self.where}; {span})"

    @property
    def size(self) -> str:
        """Largest excess, with its unit."""
        if self.what.startswith("friction"):
            return f"{self.by:.2f}"
        if self.what.startswith("joint limit"):
            return f"{self.by:.2g} rad"
        if self.what.startswith(("CoP", "sole", "margin")):
            return f"{1e3 * self.by:.3g} mm" if self.by < 1.0 else f"{self.by:.3g} m"
        of = " of the weight" if self.what.startswith("force") else ""
        return f"{100.0 * self.by:.0f} %{of}"


class Followed(Protocol):
    """A plan or a motion that a robot follows."""

    followed: ClassVar[str]
    begins: float

    @property
    def ends(self) -> float:
        """When it ends [s]."""

    def at(self, time: float | ArrayLike) -> PlanTarget:
        """Return its targets at a time [s], or at times (n,)."""


@dataclass(frozen=True)
class Deviation:
    """Of a quantity from its plan, while that lasts; NaN if it was not measured."""

    rms: float  # root mean square of the distance
    worst: float  # largest distance
    at: float  # when it was largest [s]
    # Largest norm of the quantity in the plan; of positions and inertias, of its change.
    peak: float

    @classmethod
    def of(cls, time: Array, actual: Array, planned: Array, peak: float) -> Deviation:
        """Return the deviation of rows (n, k); rows with NaN were not measured."""
        distance = np.linalg.norm(actual - planned, axis=1)
        known = np.isfinite(distance)
        if not known.any():
            return cls(np.nan, np.nan, np.nan, peak)
        distance, time = distance[known], time[known]
        worst = int(distance.argmax())
        rms = float(np.sqrt(np.mean(distance**2)))
        return cls(rms, float(distance[worst]), float(time[worst]), peak)


@dataclass(frozen=True, eq=False)
class PlanTracking:
    """Tracking errors of a robot that followed a plan.

    Attributes
    ----------
    com, cop:
        [m]; the CoP on the ground.
    momentum:
        Angular, about the CoM [kg m^2/s].
    inertia:
        Frobenius norm [kg m^2].
    followed:
        ``plan`` or ``motion``.
    joints:
        Of a motion: root mean square over the joints [rad or m]; None of a plan, which has none.
    unbalanced:
        Where the motion cannot be balanced, and why.
    begins, ends:
        Of the plan [s].
    until:
        End of the evaluation [s]: that of the plan, or of a shorter simulation.
    arrays:
        ``plan_com`` (n, 3), ``plan_cop`` (n, 3), ``plan_momentum`` and ``angular_momentum`` (n, 3)
        and ``plan_inertia`` (n, 6), one row for each recorded one.
    """

    com: Deviation
    cop: Deviation
    momentum: Deviation
    inertia: Deviation
    begins: float
    ends: float
    until: float
    arrays: Mapping[str, Array]
    followed: str = "plan"
    joints: Deviation | None = None
    unbalanced: tuple[Unbalanced, ...] = ()

    @property
    def whole(self) -> bool:
        """False if the simulation ended before the plan."""
        return self.until >= self.ends - 1e-9

    def summary(self) -> dict[str, Any]:
        """Return everything but the arrays as plain data."""
        names = ("com", "cop", "momentum", "inertia", "joints")
        every = {name: getattr(self, name) for name in names}
        found: dict[str, Any] = {k: asdict(one) for k, one in every.items() if one is not None}
        if self.unbalanced:
            found["unbalanced"] = [asdict(one) for one in self.unbalanced]
        return {**found, "begins": self.begins, "ends": self.ends, "until": self.until}


def evaluate_tracking(
    reference: Followed, robot: Robot, truth: Mapping[str, Array]
) -> PlanTracking:
    """Return the tracking errors of a recorded run.

    ``truth``: ``time`` (n,) [s], ``q`` (n, nq), ``v`` (n, nv) and ``cop`` (n, 3) [m], as of a
    :class:`wbc.simulation.Recorder`.
    """
    time = truth["time"]
    wanted = reference.at(time)
    states = state_series(robot, truth["q"], truth["v"])
    com, inertia = states.com, states.inertia[:, ROWS, COLUMNS]
    momentum = states.part("momentum", 6)[:, 3:].copy()  # a view would keep all states
    during = (time >= reference.begins) & (time <= reference.ends + 1e-9)
    planned = reference.at(np.linspace(reference.begins, reference.ends, 1000))
    scale = np.sqrt(FROBENIUS_WEIGHTS)
    pairs = {
        "com": (com, wanted.com, _largest_change(planned.com)),
        "cop": (truth["cop"][:, :2], wanted.cop[:, :2], _largest_change(planned.cop)),
        "momentum": (momentum, wanted.momentum[:, 3:], _largest_norm(planned.momentum[:, 3:])),
        "inertia": (
            scale * inertia,
            scale * wanted.inertia,
            _largest_change(scale * planned.inertia),
        ),
    }
    if (posture := getattr(wanted, "q", None)) is not None:
        path, share = planned.q[:, 7:], 1.0 / np.sqrt(robot.nv - 6)  # type: ignore[attr-defined]
        pairs["joints"] = (
            truth["q"][:, 7:] * share,
            posture[:, 7:] * share,
            _largest_change(share * path),
        )
    return PlanTracking(
        **{
            name: Deviation.of(time[during], actual[during], plan[during], peak)
            for name, (actual, plan, peak) in pairs.items()
        },
        followed=reference.followed,
        unbalanced=getattr(reference, "unbalanced", ()),
        begins=reference.begins,
        ends=reference.ends,
        until=float(min(time[-1], reference.ends)),
        arrays={
            "plan_com": wanted.com,
            "plan_cop": wanted.cop,
            "plan_momentum": wanted.momentum[:, 3:],
            "angular_momentum": momentum,
            "plan_inertia": wanted.inertia,
        },
    )


def _largest_norm(rows: Array) -> float:
    return float(np.linalg.norm(rows, axis=1).max())


def _largest_change(rows: Array) -> float:
    return _largest_norm(rows - rows[0])
