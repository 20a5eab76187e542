"""What a command means for a robot, against differences along the motion that it brings about."""

import numpy as np
import pytest

from wbc.rmp.balance.law import Command, centroidal_reference
from wbc.rmp.integrators import rollout, runge_kutta
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp

H = 1e-4  # s


def measured(model, states: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """CoM, momentum about it and moments of inertia at three states, one row each."""
    nq = len(model.Q)
    rows = []
    for x in states:
        q, v = x[:nq], x[nq:]
        rows.append((model.com(q, v)[0], model.momenta(q, v)[0], model.inertia(q)))
    return tuple(np.array([np.atleast_1d(row[k]) for row in rows]) for k in range(3))


@pytest.mark.parametrize("kind", (PlanarRmp, SolidRmp))
@pytest.mark.parametrize("seed", range(5))
def test_rates_are_those_of_the_motion(kind: type, seed: int) -> None:
    rng = np.random.default_rng(seed)
    model = kind(20.0)
    driven = len(model.V) - len(model.F)
    q = rng.uniform(0.3, 0.9, len(model.Q))
    if kind is SolidRmp:
        q[5:9] = rng.standard_normal(4)
        q[5:9] /= np.linalg.norm(q[5:9])
    v = rng.normal(size=len(model.V))
    command = Command(rng.normal(size=len(model.F)) * 10.0, rng.normal(size=driven))
    found = centroidal_reference(model, q, v, command)
    # One step back and one ahead under the same command; Runge and Kutta's error is h^5.
    u = np.concatenate((command.cop_acceleration, command.force))
    here = np.concatenate((q, v))
    ahead = rollout(runge_kutta(model, H), here, u, 1)[-1]
    behind = _backward(model, here, u)
    com, momentum, inertia = measured(model, np.array((behind, here, ahead)))
    # Central differences: h^2 times third derivatives of order 1e3, and 1e-16 / h^2 of rounding.
    bend = (com[2] - 2 * com[1] + com[0]) / H**2
    np.testing.assert_allclose(found.com_acceleration, bend, atol=1e-4)
    slope = (momentum[2] - momentum[0]) / (2 * H)
    np.testing.assert_allclose(found.momentum_rate, slope, atol=1e-4)
    slope = (inertia[2] - inertia[0]) / (2 * H)
    np.testing.assert_allclose(found.inertia_rate, slope, atol=1e-4)


def _backward(model, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """One step of Runge and Kutta's against time."""

    def rate(at: np.ndarray) -> np.ndarray:
        return model.functions["state_rate"](at, u).full().ravel()

    k1 = rate(x)
    k2 = rate(x - H / 2 * k1)
    k3 = rate(x - H / 2 * k2)
    k4 = rate(x - H * k3)
    return x - H / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
