"""Orientations next to half a turn from their targets, in the core: Pinocchio's log3."""

import numpy as np
import pinocchio as pin
import pytest

from wbc.controllers import KinematicController, TorqueController
from wbc.tasks import OrientationTask

FRAME = "left_hand"
DAMPING = 1e-6


@pytest.mark.parametrize("short", [1e-3, 1e-5, 1e-7, 1e-9])
@pytest.mark.parametrize("level", [KinematicController, TorqueController])
def test_errors_and_rows_next_to_half_a_turn_are_log3(hoap2, rng, short, level) -> None:
    """About any axis, those of the frame too, by pi less a bit.

    Oracle: Pinocchio's log3, whose angle is an arc cosine there, and the rotation it was made of.
    """
    q = hoap2.integrate(hoap2.posture("standing"), 0.1 * rng.normal(size=hoap2.nv), 1.0)
    here = hoap2.snapshot(q)
    axes = [*np.eye(3), *-np.eye(3), *rng.normal(size=(4, 3))]
    for axis in axes:
        turn = (np.pi - short) * axis / np.linalg.norm(axis)
        R = here.rotation(FRAME)
        task = OrientationTask(hoap2, FRAME, R @ pin.exp3(-turn))
        tick = level(hoap2, [task], contacts=(), damping=DAMPING).step(here)
        error = tick.errors[task.name]
        relative = task.target.T @ R
        # The arc cosine of -1 + 1e-16 is 1e-8 off; the axis is known as well.
        np.testing.assert_allclose(error, pin.log3(relative), atol=1e-7)
        # To rounding of the rotations; beside an axis it is halved where it is squared.
        np.testing.assert_allclose(error, turn, atol=1e-12)
        own = here.rotation(FRAME).T @ here.jacobian(FRAME)[3:]
        J = pin.Jlog3(relative) @ own
        expected = J.T @ J + DAMPING * np.eye(hoap2.nv)
        P = tick.qp.P[: hoap2.nv, : hoap2.nv]
        np.testing.assert_allclose(P, expected, atol=1e-6 * np.abs(expected).max())
        assert np.isfinite(tick.velocity).all()
