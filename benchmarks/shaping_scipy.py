"""The targets of the shaping benchmark, and SciPy's search for postures that meet them.

The other processes of :mod:`shaping` load this file and no more of the benchmark.
"""

from dataclasses import dataclass
from time import process_time

import numpy as np
from scipy.optimize import minimize

from wbc.robot import Robot
from wbc.rotations import log_rotation
from wbc.spatial import FROBENIUS_WEIGHTS, vech

SHAPES = {  # factors on (xx, yy) and zz of the standing robot
    "tall": ((1.1, 1.6), (0.3, 0.7)),
    "flat": ((0.5, 0.8), (1.3, 2.2)),
    "large": ((1.2, 1.6), (1.2, 2.2)),
    "small": ((0.4, 0.8), (0.5, 0.8)),
}


@dataclass(frozen=True)
class Target:
    """One problem: a robot, a target inertia (6,), and its axes."""

    robot: str
    shape: str
    mode: str  # "floating" (base axes) or "double" (world axes)
    inertia: tuple[float, ...]


def targets(name: str, count: int, seed: int) -> list[Target]:
    """Return targets of a robot, shapes and modes by turns."""
    robot, rng = Robot.load(name), np.random.default_rng(seed)
    moments = np.diag(robot.snapshot(robot.posture()).inertia_in("base"))
    found = []
    for k in range(count):
        shape = list(SHAPES)[k % len(SHAPES)]
        across, upright = SHAPES[shape]
        wanted = moments * (*rng.uniform(*across, 2), rng.uniform(*upright))
        wanted[2] = min(wanted[2], 0.95 * (wanted[0] + wanted[1]))  # no body has more
        mode = ("floating", "double")[(k // len(SHAPES)) % 2]
        found.append(Target(name, shape, mode, tuple(vech(np.diag(wanted)).tolist())))
    return found


def axes(mode: str) -> str:
    return "base" if mode == "floating" else "world"


class Search:
    """The cost of a target and its gradient by the joints, from snapshots; L-BFGS-B over them."""

    def __init__(self, target: Target) -> None:
        self.robot = Robot.load(target.robot)
        self.mode, self.wanted = target.mode, np.array(target.inertia)
        self.q = self.robot.posture()
        here = self.robot.snapshot(self.q)
        self.soles = [self.robot.feet[foot].frame for foot in ("left", "right")]
        self.anchors = [(here.position(f).copy(), here.rotation(f).copy()) for f in self.soles]
        self.scale = self.squared(here)
        limits = self.robot.limits
        self.lower = np.where(np.isfinite(limits.lower), limits.lower, -np.pi)
        self.upper = np.where(np.isfinite(limits.upper), limits.upper, np.pi)

    def squared(self, here) -> float:
        error = vech(here.inertia_in(axes(self.mode))) - self.wanted
        return float(FROBENIUS_WEIGHTS @ error**2)

    def snapshot(self, joints):
        """Return the snapshot; on two feet with the left sole where it was."""
        q = np.concatenate((self.q[:7], joints))
        if self.mode == "floating":
            return self.robot.snapshot(q)
        here = self.robot.snapshot(q)
        position, rotation = self.anchors[0]
        step = np.zeros(self.robot.nv)
        turn = rotation @ here.rotation(self.soles[0]).T
        R = here.rotation("base")
        step[3:6] = log_rotation(R.T @ turn @ R)
        q = self.robot.integrate(q, step, 1.0)
        moved = self.robot.snapshot(q)
        q[:3] += position - moved.position(self.soles[0])
        return self.robot.snapshot(q)

    def value(self, joints, multipliers, stiffness):
        """Return cost and gradient, with the other foot's closure as an augmented Lagrangian."""
        here = self.snapshot(joints)
        error = vech(here.inertia_in(axes(self.mode))) - self.wanted
        jacobian = here.inertia_jacobian_in(axes(self.mode))
        cost, slope = 0.5 * FROBENIUS_WEIGHTS @ error**2, FROBENIUS_WEIGHTS * error @ jacobian
        cost, slope = cost / self.scale, slope / self.scale
        if self.mode == "floating":
            return cost, slope[6:]
        gap, rows = self.gap(here)
        pull = multipliers + stiffness * gap
        cost += multipliers @ gap + 0.5 * stiffness * gap @ gap
        slope = slope + pull @ rows
        root = here.jacobian(self.soles[0])
        return cost, slope[6:] - np.linalg.solve(root[:, :6], root[:, 6:]).T @ slope[:6]

    def gap(self, here):
        position, rotation = self.anchors[1]
        R = here.rotation(self.soles[1])
        turn = R @ log_rotation(rotation.T @ R)
        return np.concatenate((here.position(self.soles[1]) - position, turn)), here.jacobian(
            self.soles[1]
        )

    def run(self, seed: int) -> float:
        """Return the final cost of one search relative to the start's; inf if not closed."""
        x = np.random.default_rng(seed).uniform(self.lower, self.upper)
        x = self.q[7:] if seed == 0 else x
        multipliers, rounds = np.zeros(6), 1 if self.mode == "floating" else 6
        bounds = list(zip(self.lower, self.upper, strict=True))
        options = {"maxiter": 5000, "maxfun": 20000, "ftol": 1e-12, "gtol": 1e-8}
        found = None
        for k in range(rounds):
            stiffness = 10.0 ** (k + 1)
            found = minimize(
                self.value, x, (multipliers, stiffness), "L-BFGS-B", True,
                bounds=bounds, options=options,
            )  # fmt: skip
            x = found.x
            if self.mode == "double":
                multipliers = multipliers + stiffness * self.gap(self.snapshot(x))[0]
        here = self.snapshot(x)
        closed = self.mode == "floating" or np.abs(self.gap(here)[0]).max() < 1e-5
        return self.squared(here) / self.scale if closed else np.inf


_SEARCHES: dict[Target, Search] = {}


def scipy_search(job: tuple[Target, int]) -> tuple[float, float]:
    """Return the final cost of one search, and its CPU time [s]."""
    target, seed = job
    if target not in _SEARCHES:
        _SEARCHES[target] = Search(target)
    began = process_time()
    return _SEARCHES[target].run(seed), process_time() - began
