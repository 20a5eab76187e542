"""Drift of the pendulum's integrators, in energy and momentum and from the true path.

The motion is that of compare_steps: a free solid reaction mass pendulum that passes close to the
singular orientation of Euler angles. Energy and momenta: the largest deviations over all steps, as
fractions of the start. Attitude: the largest deviation [rad] over the first ten seconds from an
integration to 1e-12. The step on the rotation group conserves the invariants best, for ever;
Runge-Kutta 4 on quaternions follows the path best, since it is of fourth order and the other of
second. Nothing is written.

    python benchmarks/rmp_drift.py [--steps 100000] [--dt 0.005]
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is loaded

import argparse
from dataclasses import dataclass
from time import process_time

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from rmp_steps import Springs, energy_momentum, rollout, runge_kutta
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from wbc.rmp.pendulum import ReactionMassPendulum
from wbc.rmp.solid import EulerSolidRmp, SolidRmp
from wbc.validate import Array

SPRINGS = Springs(4000.0, 1.0, 3000.0, np.array((0.3, 0.35, 0.4)))


@dataclass(frozen=True)
class Drift:
    """Largest deviations from the start, as fractions of the energy and of |k_G| at the start.

    Attributes
    ----------
    energy:
        Of T + V and the springs' energy.
    spin:
        Of the angular momentum about the CoM, k_G.
    yaw:
        Of the vertical part of the angular momentum about the CoP, k_P.
    """

    energy: float
    spin: float
    yaw: float


def measure_drift(
    model: ReactionMassPendulum, step: ca.Function, springs: Springs, start: ArrayLike, count: int
) -> Drift:
    """Return the drift of a free solid pendulum over ``count`` steps."""
    states = rollout(step, start, np.zeros(len(model.V)), count)
    q, v = states[:, : len(model.Q)], states[:, len(model.Q) :]
    kinetic, potential = _over(model.functions["energies"], q, v)
    energy = (kinetic + potential)[:, 0] + springs.energy(model, q)
    k_G, k_P = _over(model.functions["momenta"], q, v)
    size = float(np.linalg.norm(k_G[0]))
    return Drift(
        energy=float(np.abs(energy - energy[0]).max() / abs(energy[0])),
        spin=float(np.linalg.norm(k_G - k_G[0], axis=1).max()) / size,
        yaw=float(np.abs(k_P[:, 2] - k_P[0, 2]).max()) / size,
    )


def compare_steps(count: int = 100_000, dt: float = 5e-3) -> dict[str, Drift]:
    """Return the drift of each step on one motion: a body that tumbles on a bouncing leg.

    It swings below its foot, and turns at 4 rad/s mostly about x, by which the Euler angles pass
    close to their singular orientation. The keys are ``energy_momentum``, ``runge_kutta`` (both
    SolidRmp) and ``runge_kutta_angles`` (EulerSolidRmp). 100,000 steps take some seconds each.
    """
    return {
        name: measure_drift(model, step, SPRINGS, start, count)
        for name, (model, step, start) in _runs(dt).items()
    }


def compare_paths(duration: float = 10.0, dt: float = 5e-3) -> dict[str, float]:
    """Return the largest error of the masses' attitude [rad] of each step, keys as compare_steps.

    The reference is SciPy's DOP853 on the quaternions, to 1e-12.
    """
    runs, count = _runs(dt), round(duration / dt)
    solid, _, start = runs["runge_kutta"]
    x = ca.SX.sym("x", len(solid.Q) + len(solid.V))
    u = ca.vertcat(ca.SX.zeros(2), SPRINGS.forces(solid, x[: len(solid.Q)]))
    rate = ca.Function("rate", [x], [solid.functions["state_rate"](x, u)])
    times = np.arange(count + 1) * dt
    true = solve_ivp(
        lambda _, at: rate(at).full().ravel(),
        (0.0, times[-1]),
        start,
        method="DOP853",
        t_eval=times,
        rtol=1e-12,
        atol=1e-12,
    )
    back = Rotation.from_quat(true.y[5:9].T).inv()
    errors = {}
    for name, (model, step, start) in runs.items():
        q = rollout(step, start, np.zeros(len(model.V)), count)[:, 5:9]
        if isinstance(model, EulerSolidRmp):
            attitude = Rotation.from_euler("YXZ", q[:, :3] * (-1.0, 1.0, 1.0))
        else:
            attitude = Rotation.from_quat(q)
        errors[name] = float((back * attitude).magnitude().max())
    return errors


def _runs(dt: float) -> dict[str, tuple[ReactionMassPendulum, ca.Function, tuple[float, ...]]]:
    """Return model, step and start of each run by name."""
    solid, angles = SolidRmp(20.0), EulerSolidRmp(20.0)
    leg, radii = (0.0, 0.0, 0.3 - np.pi / 2, 0.2, 1.0), (0.3, 0.35, 0.4)
    leg_rate, slide = (0.0, 0.0, 0.5, 0.4, 0.1), (0.1, 0.0, -0.1)
    # Axes along the world's; then the angles' rates are the body rate's parts along -y, x and z.
    turning = (*leg, 0.0, 0.0, 0.0, 1.0, *radii, *leg_rate, 4.0, 1.0, 0.5, *slide)
    by_angles = (*leg, 0.0, 0.0, 0.0, *radii, *leg_rate, -1.0, 4.0, 0.5, *slide)
    return {
        "energy_momentum": (solid, energy_momentum(solid, dt, SPRINGS), turning),
        "runge_kutta": (solid, runge_kutta(solid, dt, SPRINGS), turning),
        "runge_kutta_angles": (angles, runge_kutta(angles, dt, SPRINGS), by_angles),
    }


def _over(function: ca.Function, q: Array, v: Array) -> list[Array]:
    """Return the function's results, one row for each state."""
    return [each.full().T for each in function.map(len(q))(q.T, v.T)]


def main() -> None:
    """Run the comparison and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=100_000)
    parser.add_argument("--dt", type=float, default=5e-3, help="length of a step [s]")
    options = parser.parse_args()
    start = process_time()
    found, paths = compare_steps(options.steps, options.dt), compare_paths(dt=options.dt)
    print(f"{options.steps} steps of {options.dt:g} s, {process_time() - start:.1f} s of CPU time")
    print(f"{'step':<20} {'energy':>9} {'spin':>9} {'yaw':>9} {'attitude':>9}")
    for name, drift in found.items():
        numbers = (drift.energy, drift.spin, drift.yaw, paths[name])
        print(f"{name:<20}", *(f"{number:>9.1e}" for number in numbers))


if __name__ == "__main__":
    main()
