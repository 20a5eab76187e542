"""How well a robot followed a plan: CoM, CoP, angular momentum and inertia over its time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike

from wbc.robot import Robot
from wbc.spatial import FROBENIUS_WEIGHTS, vech
from wbc.tracking.reference import PlanTarget
from wbc.tracking.unbalanced import Unbalanced
from wbc.validate import Array


class Followed(Protocol):
    """A plan or a motion that a robot follows."""

    followed: ClassVar[str]
    begins: float

    @property
    def ends(self) -> float:
        """When it ends [s]."""

    def at(self, time: float | ArrayLike) -> PlanTarget:
        """Return what it asks for at a time [s], or at times (n,)."""


@dataclass(frozen=True)
class Deviation:
    """Of a quantity from its plan, while the plan lasted; NaN if nothing was measured then."""

    rms: float  # root mean square of the distance
    worst: float  # largest distance
    at: float  # when it was largest [s]
    # Largest size of the quantity itself in the plan; of places and inertias, of its change.
    peak: float

    @classmethod
    def of(cls, time: Array, actual: Array, planned: Array, peak: float) -> Deviation:
        """Return that of rows (n, k); rows with NaN were not measured."""
        apart = np.linalg.norm(actual - planned, axis=1)
        known = np.isfinite(apart)
        if not known.any():
            return cls(np.nan, np.nan, np.nan, peak)
        apart, time = apart[known], time[known]
        worst = int(apart.argmax())
        rms = float(np.sqrt(np.mean(apart**2)))
        return cls(rms, float(apart[worst]), float(time[worst]), peak)


@dataclass(frozen=True, eq=False)
class PlanTracking:
    """How well a robot followed a plan.

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
        What was judged ends here [s]: before the plan does, if the simulation ended first.
    arrays:
        ``plan_com`` (n, 3), ``plan_cop`` (n, 3), ``plan_momentum`` and ``angular_momentum`` (n, 3)
        and ``plan_inertia`` (n, 6), row by row of what was recorded.
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


def judge(reference: Followed, robot: Robot, truth: Mapping[str, Array]) -> PlanTracking:
    """Return how well what was recorded follows a plan.

    Parameters
    ----------
    truth:
        ``time`` (n,) [s], ``q`` (n, nq), ``v`` (n, nv) and ``cop`` (n, 3) [m], as of a
        :class:`wbc.simulation.Recorder`.
    """
    time = truth["time"]
    wanted = reference.at(time)
    snapshots = [robot.snapshot(q, v) for q, v in zip(truth["q"], truth["v"], strict=True)]
    com = np.array([one.com for one in snapshots])
    momentum = np.array([one.momentum[3:] for one in snapshots])
    inertia = np.array([vech(one.inertia) for one in snapshots])
    here = (time >= reference.begins) & (time <= reference.ends + 1e-9)
    planned = reference.at(np.linspace(reference.begins, reference.ends, 1000))
    scale = np.sqrt(FROBENIUS_WEIGHTS)
    pairs = {
        "com": (com, wanted.com, _change(planned.com)),
        "cop": (truth["cop"][:, :2], wanted.cop[:, :2], _change(planned.cop)),
        "momentum": (momentum, wanted.momentum[:, 3:], _most(planned.momentum[:, 3:])),
        "inertia": (scale * inertia, scale * wanted.inertia, _change(scale * planned.inertia)),
    }
    joints: Deviation | None = None
    posture: Array | None = getattr(wanted, "q", None)
    if posture is not None:
        way, share = planned.q[:, 7:], 1.0 / np.sqrt(robot.nv - 6)  # type: ignore[attr-defined]
        actual, asked = truth["q"][here, 7:] * share, posture[here, 7:] * share
        joints = Deviation.of(time[here], actual, asked, _change(share * way))
    return PlanTracking(
        **{
            name: Deviation.of(time[here], actual[here], plan[here], peak)
            for name, (actual, plan, peak) in pairs.items()
        },
        followed=reference.followed,
        joints=joints,
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


def _most(rows: Array) -> float:
    return float(np.linalg.norm(rows, axis=1).max())


def _change(rows: Array) -> float:
    return _most(rows - rows[0])
