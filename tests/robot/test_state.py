"""The snapshot and payloads against Pinocchio's, and against the paper's link-by-link formulas."""

from __future__ import annotations

import pickle

import numpy as np
import pinocchio as pin
import pytest

import wbc
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.robot import Payload, Robot, Snapshot
from wbc.robot.postures import com_from_middle, is_standing
from wbc.simulation import Plant
from wbc.spatial import vech


def pseudo_inertia(Y: pin.Inertia) -> np.ndarray:
    """Second moments [[Sigma, h], [h', m]] of a body in its own frame (theory, section 2)."""
    return np.array(pin.PseudoInertia.FromInertia(Y).toMatrix())


def hat(twist: np.ndarray) -> np.ndarray:
    top = np.column_stack((np.array(pin.skew(twist[3:])), twist[:3]))
    return np.vstack((top, np.zeros(4)))


def centroidal(P: np.ndarray) -> np.ndarray:
    h, mass = P[:3, 3], P[3, 3]
    S = P[:3, :3] - np.outer(h, h) / mass
    return np.trace(S) * np.eye(3) - S


def link_sums(robot: Robot, here: Snapshot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """P, dP/dt and its rate at zero acceleration of v, summed over the links in the world."""
    model, data = robot.model, robot.model.createData()
    pin.forwardKinematics(model, data, here.q, here.v, np.zeros(robot.nv))
    total, rate, second = np.zeros((3, 4, 4))
    for Y, T, v, a in zip(model.inertias, data.oMi, data.v, data.a, strict=True):
        G = T.homogeneous
        P, V, A = pseudo_inertia(Y), hat(v.vector), hat(a.vector)
        B = A + V @ V
        total += G @ P @ G.T
        rate += G @ (V @ P + P @ V.T) @ G.T
        second += G @ (B @ P + P @ B.T + 2 * V @ P @ V.T) @ G.T
    return total, rate, second


def test_inertia_and_its_rates_are_the_sums_over_links(robot: Robot, rng, random_snapshot) -> None:
    """Paper eqs. 12, 24-27 and the drift, by pseudo-inertias; the library uses spins instead."""
    for _ in range(5):
        here = random_snapshot(robot, rng)
        P, rate, second = link_sums(robot, here)
        mass = P[3, 3]
        h, dh, ddh = P[:3, 3], rate[:3, 3], second[:3, 3]
        S = P[:3, :3] - np.outer(h, h) / mass
        dS = rate[:3, :3] - (np.outer(dh, h) + np.outer(h, dh)) / mass
        cross = np.outer(ddh, h) + np.outer(h, ddh) + 2 * np.outer(dh, dh)
        ddS = second[:3, :3] - cross / mass
        scale = np.abs(centroidal(P)).max()
        for actual, moment in (
            (vech(here.inertia), S),
            (here.inertia_jacobian @ here.v, dS),
            (here.inertia_drift, ddS),
        ):
            expected = vech(np.trace(moment) * np.eye(3) - moment)
            # Differences of large sums (the robot stands away from the origin): 1e-10 of the size.
            size = max(scale, np.abs(expected).max())
            np.testing.assert_allclose(actual, expected, atol=1e-10 * size)


def test_base_inertia_depends_on_joints_alone(robot: Robot, rng, random_snapshot) -> None:
    here = random_snapshot(robot, rng)
    assert (here.base_inertia_jacobian[:, :6] == 0).all()
    moved = here.v.copy()
    moved[6:] = 0.0
    there = robot.snapshot(robot.integrate(here.q, moved, 1.0), here.v)
    np.testing.assert_allclose(there.inertia_in("base"), here.inertia_in("base"), atol=1e-11)


def test_spatial_inertia_about_a_frame(robot: Robot, rng, random_snapshot) -> None:
    """Eq. 12 for the base: the top-left block of Pinocchio's mass matrix is that same matrix."""
    here = random_snapshot(robot, rng)
    expected = here.mass_matrix[:6, :6]
    np.testing.assert_allclose(here.inertia_about("base"), expected, atol=1e-11 * robot.mass)


def test_nine_rows_are_the_links_about_the_spatial_origin(robot, rng, random_snapshot) -> None:
    """Eqs. 24-28: entries and Jacobian against sums over links and their derivatives, the way v."""

    def entries(P: np.ndarray) -> np.ndarray:
        S = P[:3, :3]
        return np.concatenate((vech(np.trace(S) * np.eye(3) - S), P[:3, 3]))

    def seen_from(P: np.ndarray, point: np.ndarray) -> np.ndarray:
        T = np.eye(4)
        T[:3, 3] = -point
        return T @ P @ T.T

    here = random_snapshot(robot, rng)
    frame = robot.frame_names[-1]
    total, rate, _ = link_sums(robot, here)
    point, ahead = np.array([0.3, -0.2, 0.7]), here.position(frame)
    moved = np.zeros((4, 4))  # what the frame's own motion adds to the rate seen from it
    moved[:3, 3] = -(here.jacobian(frame)[:3] @ here.v)
    at_frame = seen_from(total, ahead)
    cases = {
        "world": (total, rate),
        tuple(point): (seen_from(total, point), seen_from(rate, point)),
        frame: (at_frame, seen_from(rate, ahead) + moved @ at_frame + at_frame @ moved.T),
    }
    for about, (P, dP) in cases.items():
        for found, expected in (
            (here.spatial_inertia_entries(about), entries(P)),
            (here.spatial_inertia_jacobian(about) @ here.v, entries(dP)),
        ):
            np.testing.assert_allclose(found, expected, atol=1e-10 * np.abs(expected).max())
    assert here.spatial_inertia_jacobian().shape == (9, robot.nv)
    np.testing.assert_array_equal(here.spatial_inertia_jacobian("com")[6:], 0.0)


def test_mechanical_connection(robot: Robot, rng, random_snapshot) -> None:
    """Eq. 17: base momentum is I_0 (v_0 + A qdot); oracle: Pinocchio's centroidal momentum."""
    here = random_snapshot(robot, rng)
    v0, rates = here.v[:6], here.v[6:]
    at_base = here.inertia_about("base") @ (v0 + here.mechanical_connection @ rates)
    R, p = here.rotation("base"), here.position("base")
    linear, angular = here.momentum[:3], here.momentum[3:]
    expected = np.concatenate((R.T @ linear, R.T @ (angular + np.cross(here.com - p, linear))))
    np.testing.assert_allclose(at_base, expected, rtol=1e-9, atol=1e-9)


def everything(s: Snapshot, frame: str) -> list[np.ndarray]:
    return [
        s.com, s.inertia, s.inertia_jacobian, s.inertia_drift, s.base_inertia_jacobian,
        s.inertia_in(frame), s.inertia_jacobian_in(frame), s.inertia_drift_in(frame),
        s.inertia_in(frame, frame), s.inertia_jacobian_in(frame, "world"),
        s.inertia_drift_in("world", frame), s.inertia_drift_in(frame, (1.0, 2.0, 3.0)),
        s.spatial_inertia_entries(), s.spatial_inertia_jacobian(frame),
        s.inertia_about(frame), s.com_jacobian, s.com_velocity, s.com_drift, s.centroidal_map,
        s.momentum, s.momentum_drift, s.average_angular_velocity, s.mechanical_connection,
        s.mass_matrix, s.bias, s.position(frame), s.rotation(frame), s.jacobian(frame),
        s.drift(frame),
    ]  # fmt: skip


def test_snapshots_do_not_change_each_other(robot: Robot, rng, random_snapshot) -> None:
    first = random_snapshot(robot, rng)
    alone = [x.copy() for x in everything(robot.snapshot(first.q, first.v), "base")]
    # Interleaved: every quantity of `late` is read only after another state was evaluated, twice.
    late = robot.snapshot(first.q, first.v)
    for _ in range(2):
        everything(random_snapshot(robot, rng), "base")
        for actual, expected in zip(everything(late, "base"), alone, strict=True):
            np.testing.assert_array_equal(actual, expected)


def test_nothing_can_be_written(robot: Robot, rng, random_snapshot) -> None:
    here = random_snapshot(robot, rng)
    for array in [here.q, here.v, *everything(here, "base")]:
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


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
