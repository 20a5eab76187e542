"""Payloads against Pinocchio's model with a body appended by hand, and against MuJoCo."""

from __future__ import annotations

import pickle

import numpy as np
import pinocchio as pin
import pytest

import wbc
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.robot import Payload, Robot
from wbc.robot.postures import com_from_middle, is_standing
from wbc.simulation import Plant

MASS, COM = 2.5, np.array([0.08, -0.02, 0.03])
INERTIA = np.array([[0.012, 0.001, 0.0], [0.001, 0.02, -0.002], [0.0, -0.002, 0.015]])
ARM = """
<mujoco model="arm"><worldbody><body name="upper" pos="0 0 1">
  <joint name="shoulder" axis="0 1 0" range="-114 114"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.4" size=".03" mass="2"/>
  <body name="lower" pos="0 0 -.4"><joint name="elbow" axis="0 1 0" range="-114 114"/>
    <geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" mass="1"/></body>
</body></worldbody></mujoco>
"""


def test_mass_matrix_bias_and_inertia_are_those_of_a_model_edited_by_hand(
    hoap2: Robot, random_snapshot, rng: np.random.Generator
) -> None:
    """To rounding: Pinocchio's CRBA and RNEA of its own model with the body appended."""
    carrying = hoap2.with_payload("left_hand", MASS, COM, INERTIA)
    model, frame = hoap2.model.copy(), hoap2.frame("left_hand")
    body = pin.Inertia(MASS, COM, INERTIA)
    model.appendBodyToJoint(frame.parentJoint, body, frame.placement)
    data = model.createData()
    s = random_snapshot(carrying, rng)
    M = pin.crba(model, data, s.q)
    np.testing.assert_allclose(s.mass_matrix, M, atol=1e-12 * abs(M).max())
    bias = pin.rnea(model, data, s.q, s.v, np.zeros(model.nv))
    np.testing.assert_allclose(s.bias, bias, atol=1e-11 * abs(bias).max())
    com = pin.centerOfMass(model, data, s.q)
    np.testing.assert_allclose(s.com, com, atol=1e-13)
    pin.ccrba(model, data, s.q, s.v)
    inertia = np.array(data.Ig.inertia)
    np.testing.assert_allclose(s.inertia, inertia, atol=1e-12 * abs(inertia).max())
    assert carrying.mass == pytest.approx(hoap2.mass + MASS, rel=1e-14)
    assert hoap2.mass == pytest.approx(carrying.mass - MASS, rel=1e-14)  # stays as it is


def test_it_stands_with_its_com_where_it_was_over_the_soles(hoap2: Robot) -> None:
    carrying = hoap2.with_payload("left_hand", 1.0).with_payload("head", 0.5, inertia=(1e-3,) * 3)
    before = com_from_middle(hoap2.model, hoap2.posture(), hoap2.feet)
    after = com_from_middle(carrying.model, carrying.posture(), carrying.feet)
    np.testing.assert_allclose(after, before, atol=1e-6)  # Gauss-Newton ends at 1e-7
    assert is_standing(carrying.model, carrying.posture(), carrying.feet)
    again = pickle.loads(pickle.dumps(carrying))
    assert [one.frame for one in again.payloads] == ["left_hand", "head"]
    np.testing.assert_array_equal(again.posture(), carrying.posture())
    # Pictures show both, besides all that they showed before.
    assert carrying.visual_model.ngeoms == max(
        hoap2.visual_model.ngeoms, hoap2.collision_model.ngeoms
    ) + len(carrying.payloads)
    assert carrying.collision_model.ngeoms == hoap2.collision_model.ngeoms
    assert any("carries 1 kg" in note for note in carrying.notes)


def test_the_plant_of_an_mjcf_robot_weighs_it() -> None:
    """Oracle: MuJoCo's own bias of the file with the payload written into it by hand."""
    import mujoco

    robot = Robot.load(ARM, base="fixed").with_payload("lower", MASS, COM, INERTIA)
    spec = mujoco.MjSpec.from_string(ARM)
    body = spec.body("lower").add_body(name="crate", mass=MASS, explicitinertial=True)
    body.ipos = COM
    body.fullinertia = INERTIA[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    by_hand = spec.compile()
    data = mujoco.MjData(by_hand)
    data.qpos[:], data.qvel[:] = (0.4, -0.7), (0.5, 1.1)
    mujoco.mj_forward(by_hand, data)
    plant = Plant(robot)
    q = robot.posture("neutral", {"shoulder": 0.4, "elbow": -0.7})
    v = np.concatenate((np.zeros(6), (0.5, 1.1)))
    plant.reset(q, v)
    np.testing.assert_allclose(plant.data.qfrc_bias, data.qfrc_bias, atol=1e-12)
    np.testing.assert_allclose(robot.snapshot(q, v).bias[6:], data.qfrc_bias, atol=1e-12)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"frame": "left_hnd"}, "did you mean 'left_hand'"),
        ({"mass": 0.0}, "payload, mass"),
        ({"mass": float("nan")}, "payload, mass"),
        ({"com": (0.0, 1.0)}, "payload, com"),
        ({"inertia": np.diag([1.0, 1.0, 3.0])}, "no rigid body has principal moments 1, 1, 3"),
        ({"inertia": [[1.0, 0.2, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]}, "not symmetric"),
    ],
)
def test_what_no_payload_is_is_refused_by_name(hoap2, given: dict[str, object], said: str) -> None:
    with pytest.raises((InvalidInputError, UnknownNameError), match=said):
        hoap2.with_payload(**{"frame": "left_hand", "mass": 1.0, **given})
    with pytest.raises((InvalidInputError, UnknownNameError), match=said):
        Payload(**{"frame": "left_hand", "mass": 1.0, **given}).attached(hoap2.model)


def test_the_drawn_ellipsoid_has_the_payloads_inertia() -> None:
    """A solid ellipsoid's moments, m (b^2 + c^2) / 5, in its principal axes."""
    payload = wbc.robot.Payload("hand", MASS, COM, INERTIA)
    radii, axes = payload.shape()
    moments = MASS / 5.0 * (np.sum(radii**2) - radii**2)
    np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, INERTIA, atol=1e-15)
