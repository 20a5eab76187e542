"""The largest push that the momentum law survives without a step, with two theoretical bounds.

A solid reaction mass pendulum stands on a rectangular sole and is pushed at its CoM, in directions
all around; the full equations of motion are integrated. The largest impulse that it survives is
found by bisection: it comes to rest upright, the masses return, no bound is violated, and the same
holds for its neighbours 1 mrad either way. Bounds are those of the sole without the law's CoP
margin.

    python benchmarks/push_recovery.py [--body g1] [--directions 16] [--grid 20] [--output FILE]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded: threads only add noise here

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from time import thread_time

import numpy as np
from numpy.typing import ArrayLike
from region_of_attraction import rest_error

from wbc.polygon import inset
from wbc.qp import make_backend
from wbc.rmp.balance.law import LawBounds, PendulumCommand
from wbc.rmp.balance.momentum_qp import MomentumQp
from wbc.rmp.balance.push_limits import PushLimits, Wheel, compass, push_limits, unit_directions
from wbc.rmp.balance.record import Ending, Simulation
from wbc.rmp.balance.simulate import Blow, simulate
from wbc.rmp.solid import SolidRmp
from wbc.validate import Array

# How near to rest, as :func:`benchmarks.region_of_attraction.rest_error` measures it.
NEAR = 0.02
# Rotation of directions that tells a robust recovery from a lucky one [rad].
TURN = 1e-3


@dataclass(frozen=True, eq=False)
class Recovery:
    """The result of a push.

    Attributes
    ----------
    impulse:
        Level (2,) [N s].
    survived:
        It came to rest upright, the masses where they were, and no bound was broken on the way.
    settled_at:
        When it was at rest [s]; the end of the run if it was not.
    broken:
        Names of the bounds that were broken; see :meth:`Simulation.broken`.
    simulation:
        The motion.
    """

    impulse: Array
    survived: bool
    settled_at: float
    broken: tuple[str, ...]
    simulation: Simulation


def standing(law: MomentumQp) -> tuple[Array, Array]:
    """Return (q, v) at rest, the leg upright below the CoM's place of rest."""
    x, y, height = np.asarray(law.com).tolist()
    turned = (0.0, 0.0, 0.0, 1.0)
    q = np.array((x, y, np.pi / 2, 0.0, height, *turned, *np.asarray(law.radii)))
    return q, np.zeros(11)


def recover(law: MomentumQp, impulse: ArrayLike, *, duration: float = 8.0) -> Recovery:
    """Push a pendulum at rest at time zero and simulate it until it settles or falls.

    The law is asked every ``law.dt``.

    Parameters
    ----------
    impulse:
        Level, at the CoM (2,) [N s].
    duration:
        Longest run [s].
    """
    level = np.asarray(impulse, dtype=float)
    start, still = standing(law)

    def settled(time: float, q: Array, v: Array, command: PendulumCommand) -> bool:
        return time > 0.0 and _error(q, v, start) <= NEAR

    run = simulate(
        law,
        start,
        still,
        duration,
        dt=law.dt,
        bounds=law.bounds,
        pushes=[Blow(0.0, (*level, 0.0))],
        stop=settled,
    )
    broken = tuple(run.broken())
    back = run.ending is Ending.COMPLETE and _error(run.q[-1], run.v[-1], start) <= NEAR
    return Recovery(level, back and not broken, run.ended_at, broken, run)


def largest_impulses(
    law: MomentumQp, directions: ArrayLike, bracket: ArrayLike, *, resolution: float = 0.1
) -> Array:
    """Return the largest impulses survived (n,) [N s], by bisection, each to ``resolution``.

    Survived by :func:`survives`, not by one run.

    Bisection sees one border only; :func:`recover` on a grid of impulses tells whether there are
    holes below it.

    Parameters
    ----------
    directions:
        (n, 2), of any length but zero.
    bracket:
        An impulse that is survived and one that is not, for each direction (n, 2) [N s]. An end
        that turns out on the wrong side is returned as it is.
    resolution:
        [N s].
    """
    pairs = zip(unit_directions(directions), bracket, strict=True)
    return np.array([_bisected(law, e, low, high, resolution) for e, (low, high) in pairs])


def survives(law: MomentumQp, impulse: Array) -> bool:
    """Whether an impulse is survived, and so are its neighbours turned by ``TURN`` either way.

    Beyond the bound of theory a single run is decided by rounding: mirror images end differently.
    """
    for angle in (0.0, TURN, -TURN):
        turned = np.array(((1.0, -angle), (angle, 1.0))) @ impulse
        if not recover(law, turned).survived:
            return False
    return True


def _bisected(
    law: MomentumQp, direction: Array, low: float, high: float, resolution: float
) -> float:
    while high - low > resolution:
        middle = (low + high) / 2
        if survives(law, middle * direction):
            low = middle
        else:
            high = middle
    return low


def _error(q: Array, v: Array, rest: Array) -> float:
    return float(rest_error(np.concatenate((q, v))[None], rest)[0])


@dataclass(frozen=True)
class Body:
    """A pendulum of a humanoid's size; lengths in m, sole (back, front, right, left)."""

    mass: float
    height: float
    sole: tuple[float, float, float, float]
    radii: tuple[float, float, float]
    torque: float
    angle: float

    def polygon(self) -> np.ndarray:
        back, front, right, left = self.sole
        return np.array(((back, right), (front, right), (front, left), (back, left)))

    def law(self, dt: float, solver: str = "proxqp_cold", **bounds: float) -> MomentumQp:
        """The law; with a cold solver a run does not depend on the run before it."""
        bounds = LawBounds(
            polygon=self.polygon(),
            friction=0.8,
            leg_force=(0.0, 3.0 * self.mass * 9.81),
            leg_length=(0.6 * self.height, 1.15 * self.height),
            wheel_torque=self.torque,
            wheel_angle=self.angle,
            radius=(0.05, 0.6),
            **bounds,
        )
        com = (0.0, 0.0, self.height)
        backend = make_backend(solver)
        return MomentumQp(SolidRmp(self.mass), bounds, com, self.radii, dt=dt, backend=backend)

    def limits(self, directions: np.ndarray, margin: float = 0.0) -> PushLimits:
        """The bounds of theory on a sole without its margin."""
        r = np.square(self.radii)
        inertia = self.mass / 3.0 * (r.sum() - r)[:2]
        wheel = Wheel(inertia, self.torque, self.angle)
        polygon = inset(self.polygon(), margin)
        return push_limits(directions, polygon, wheel, mass=self.mass, height=self.height)


# A G1 with both soles side by side, and a robot of TALOS's size whose CoM is not above the middle.
BODIES = {
    "g1": Body(35.0, 0.7, (-0.1, 0.1, -0.1, 0.1), (0.3, 0.3, 0.3), 50.0, 0.6),
    "talos": Body(90.0, 0.9, (-0.08, 0.12, -0.15, 0.15), (0.3, 0.25, 0.4), 120.0, 0.5),
}


def survived_shares(law: MomentumQp, limits: PushLimits, count: int, most: float) -> np.ndarray:
    """Return (n, count) booleans: impulses evenly from 0 to ``most`` times the wheel's bound."""
    shares = most * np.arange(1, count + 1) / count
    return np.array(
        [
            [recover(law, share * bound * e).survived for share in shares]
            for e, bound in zip(limits.directions, limits.wheel, strict=True)
        ]
    )


def tick_times(law: MomentumQp, impulse: np.ndarray) -> np.ndarray:
    """Return the thread time of each tick [s] along a recovery, each asked again."""
    run = recover(law, impulse).simulation
    times = []
    for q, v in zip(run.q[:-1], run.v[:-1], strict=True):
        start = thread_time()
        law.command(q, v, 0.0)
        times.append(thread_time() - start)
    return np.array(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--body", choices=sorted(BODIES), default="g1")
    parser.add_argument("--directions", type=int, default=16)
    parser.add_argument("--dt", type=float, default=2e-3, help="between commands [s]")
    parser.add_argument("--resolution", type=float, default=0.005, help="part of the bound")
    parser.add_argument("--grid", type=int, default=0, help="impulses to scan for holes")
    parser.add_argument("--output", type=Path, help="write the arrays as JSON")
    options = parser.parse_args()
    body = BODIES[options.body]
    law = body.law(options.dt)
    limits = body.limits(compass(options.directions), law.bounds.cop_margin)
    bracket = np.column_stack((0.5 * limits.wheel, 1.5 * limits.wheel))
    resolution = options.resolution * float(limits.wheel.min())
    measured = largest_impulses(law, limits.directions, bracket, resolution=resolution)
    print(f"{options.body}: {body}, dt {options.dt:g} s; impulses in N s")
    print("direction    ankle    wheel  survived  /wheel")
    angles = np.degrees(np.arctan2(limits.directions[:, 1], limits.directions[:, 0])) % 360.0
    columns = zip(angles, limits.ankle, limits.wheel, measured, strict=True)
    for angle, ankle, wheel, most in columns:
        print(f"{angle:9.1f} {ankle:8.2f} {wheel:8.2f} {most:9.2f} {most / wheel:7.3f}")
    warm = body.law(options.dt, "proxqp")
    times = 1e6 * tick_times(warm, 0.9 * limits.wheel[1] * limits.directions[1])
    print(
        "tick [us]: median {:.0f}, p90 {:.0f}, p99 {:.0f}".format(
            *np.percentile(times, (50, 90, 99))
        )
    )
    holes = np.zeros((0, 0), dtype=bool)
    if options.grid:
        holes = ~survived_shares(law, limits, options.grid, 0.98)
        print(f"grid: {holes.sum()} of {holes.size} impulses below 0.98 of the bound not survived")
    if options.output:
        arrays = {
            "angle": np.radians(angles).tolist(),
            "ankle": limits.ankle.tolist(),
            "wheel": limits.wheel.tolist(),
            "survived": measured.tolist(),
            "holes": holes.tolist(),
        }
        options.output.write_text(json.dumps(arrays, indent=2))


if __name__ == "__main__":
    main()
