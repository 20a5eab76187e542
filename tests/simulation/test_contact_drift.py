"""Contacts with J' q': against MuJoCo's own derivative, and a foot that rests while legs fold."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import wbc
from tests.conftest import load
from wbc.simulation import Plant, Terrain
from wbc.simulation.contact_drift import ContactDrift
from wbc.validate import Array


def folding(robot: wbc.Robot, sink: float) -> tuple[Array, Array]:
    """Return a stance with bent knees, and the velocity of least norm at which it sinks [m/s].

    Its feet are at rest: the rates are those of the joints, by the feet's Jacobians.
    """
    q = robot.posture("standing")
    s = robot.snapshot(q)
    feet = np.vstack([s.jacobian(foot.frame) for foot in robot.feet.values()])
    base = np.eye(6, robot.nv)
    wanted = np.concatenate((np.zeros(len(feet)), (0.0, 0.0, -sink, 0.0, 0.0, 0.0)))
    v = np.linalg.lstsq(np.vstack((feet, base)), wanted, rcond=None)[0]
    return q, v


def test_drift_is_mujocos_own_derivative() -> None:
    """By mj_jacDot, at points of contact of a robot that moves in all ways."""
    g1 = load("g1")
    plant = Plant(g1, terrain=Terrain(slope=(0.05, -0.1)))
    rng = np.random.default_rng(3)
    q = g1.posture("standing")
    q[2] -= 0.01
    plant.reset(q, rng.standard_normal(g1.nv))
    model, data = plant.model, plant.data
    mujoco.mj_step1(model, data)
    assert data.ncon >= 4
    found = ContactDrift(model).at(data)
    for contact, drift in zip(data.contact, found, strict=True):
        derivative = np.zeros((3, model.nv))
        body = model.geom_bodyid[contact.geom2]
        mujoco.mj_jacDot(model, data, derivative, None, contact.pos, body)
        expected = contact.frame.reshape(3, 3) @ derivative @ data.qvel
        assert model.geom_bodyid[contact.geom1] == 0
        np.testing.assert_allclose(drift, expected, atol=1e-10 * (1.0 + np.abs(expected).max()))


@pytest.mark.parametrize("drift", [False, True])
def test_a_foot_rests_while_legs_fold(drift: bool) -> None:
    """Without J' q' the ground lets it go at that acceleration; with it, it stays."""
    g1 = load("g1")
    plant = Plant(g1, terrain=Terrain(drift=drift))
    q, v = folding(g1, 1.5)
    q[2] -= 1e-4  # pressed, so that all corners touch
    plant.reset(q, v)
    # Legs press down with three times the weight, so that no corner would have to be pulled.
    start, push = g1.snapshot(q, v), np.array((0.0, 0.0, 1.5 * g1.weight, 0.0, 0.0, 0.0))
    pressed = sum(start.jacobian(one.frame).T @ push for one in g1.feet.values())
    plant.step((start.bias - pressed)[6:], plant.physics_dt)
    after = g1.snapshot(*plant.state())
    foot = next(iter(g1.feet.values())).frame
    vertical = after.jacobian(foot)[2] @ after.v
    own = start.drift(foot)[2] * plant.physics_dt
    assert own > 0.01
    if drift:
        assert abs(vertical) < 0.1 * own
    else:
        assert vertical == pytest.approx(own, rel=0.2)
