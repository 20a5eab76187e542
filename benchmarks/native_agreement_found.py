"""How far two answers are apart, and what was found of many of them."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from wbc.files import write_whole
from wbc.qp.elimination import least_squares
from wbc.qp.problem import QP
from wbc.qp.solution import Solution
from wbc.validate import Array

FIELDS = ("P", "g", "A", "b", "C", "l", "u", "lower", "upper")


@dataclass
class Found:
    """The largest difference of some ticks, and how many were compared and handed over."""

    compared: int = 0
    handed: int = 0
    worst: float = 0.0
    other: float = 0.0  # of commands, relative where above 1; of hulls' distances [m]
    exact: float = 0.0  # of the core's commands from the optimum of its QP, likewise,
    optima: float = 0.0  # and of that from the optimum of Python's
    refuted: int = 0  # ticks of which Python says something else
    held: int = 0  # ticks with an active pair,
    inside: int = 0  # with a pair inside its margin by more than the skin,
    limited: int = 0  # and with a velocity at the limits' box
    by_coal: int = 0  # compared ticks of which Python has the pairs from coal,
    coal: float = 0.0  # and the largest difference of their QPs

    @property
    def ticks(self) -> int:
        return self.compared + self.handed

    def add(self, difference: float | None) -> None:
        """Count one tick; None: the core handed it over."""
        one = Found(0, 1) if difference is None else Found(1, 0, difference)
        self.join(one)

    def join(self, other: "Found") -> None:
        """Count what others found."""
        self.compared += other.compared
        self.handed += other.handed
        for name in ("worst", "other", "exact", "optima", "coal"):
            most = np.maximum(getattr(self, name), getattr(other, name))  # keeps NaN
            setattr(self, name, float(most))
        for name in ("refuted", "held", "inside", "limited", "by_coal"):
            setattr(self, name, getattr(self, name) + getattr(other, name))


class Kept:
    """What was found, in a file if there is one."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        there = json.loads(path.read_text()) if path is not None and path.exists() else {}
        self._found = {key: Found(**one) for key, one in there.items()}

    def of(self, key: str) -> Found:
        """Return what was found under a key, to be counted on."""
        return self._found.setdefault(key, Found())

    def save(self) -> None:
        """Write all of it by one rename."""
        if self._path is not None:
            text = json.dumps({key: asdict(one) for key, one in self._found.items()})
            write_whole(self._path, lambda file: file.write(text.encode()))


def of_qps(one: QP, other: QP) -> float:
    """Return the largest difference of two QPs; infinity if other entries are infinite."""
    return max(apart(getattr(one, field), getattr(other, field)) for field in FIELDS)


def correction(qp: QP, solution: Solution) -> Array:
    """Return what is to be added to an answer (n,): one step of iterative refinement.

    The KKT system is that of the active set which the answer has: of rows with a multiplier.
    Residuals are in extended precision, so what rounding of the QP's own numbers does stays.
    """
    n = qp.g.size
    pull = np.concatenate((solution.z, solution.z_box))
    active, rows = pull != 0.0, np.concatenate((qp.C, np.eye(n)))
    lower, upper = np.concatenate((qp.l, qp.lower)), np.concatenate((qp.u, qp.upper))
    met = np.concatenate((qp.b, np.where(pull > 0.0, upper, lower)[active]))
    held = np.concatenate((qp.A, rows[active]))
    system = np.block([[qp.P, held.T], [held, np.zeros((met.size, met.size))]])
    given = np.concatenate((solution.x, solution.y, pull[active])).astype(np.longdouble)
    missed = np.concatenate((-qp.g, met)) - system @ given
    return least_squares(system, missed.astype(float), 1e-15)[:n]


def apart(ours: Array, theirs: Array) -> float:
    """Return the largest difference of two arrays, relative to their largest entry if above 1."""
    if ours.shape != theirs.shape:
        return np.inf
    size = np.abs(theirs)
    scale = size.max(initial=1.0)
    if scale < np.inf:
        gap = np.abs(ours - theirs)
    else:  # bounds: infinite ones must be the same
        finite = size < np.inf
        scale = size.max(initial=1.0, where=finite)
        gap = np.abs(np.subtract(ours, theirs, out=np.zeros(ours.shape), where=finite))
        gap[~finite & (ours != theirs)] = np.inf
    worst = float(gap.max(initial=0.0)) / scale
    return np.inf if np.isnan(worst) else worst
