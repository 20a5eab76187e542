"""Series of whole-robot quantities against snapshots, one by one, and finite differences."""

import numpy as np
import pinocchio as pin
import pytest

from wbc.constraints import SelfCollision
from wbc.errors import InvalidInputError
from wbc.robot import Robot
from wbc.robot.series import (
    centroidal_derivatives,
    centroidal_series,
    rates,
    revolute_joints,
    sole_series,
    state_series,
    velocities,
)
from wbc.rotations import rotation_vectors, rotations_from
from wbc.spatial import vech_inverse

COUNT = 4


def states(robot: Robot, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    steps = rng.normal(size=(COUNT, robot.nv))
    q = np.array([robot.integrate(robot.postures["neutral"], step, 0.7) for step in steps])
    return q, rng.normal(size=(COUNT, robot.nv)), rng.normal(size=(COUNT, robot.nv))


def test_states_of_the_core_in_a_row(robot: Robot, rng: np.random.Generator) -> None:
    """The very numbers of snapshots."""
    q, v, _ = states(robot, rng)
    frames = [foot.frame for foot in robot.feet.values()]
    series = state_series(robot, q, v, frames)
    for k in range(COUNT):
        here = robot.snapshot(q[k], v[k])
        np.testing.assert_array_equal(series.com[k], here.com)
        np.testing.assert_array_equal(series.inertia[k], here.inertia)
        np.testing.assert_array_equal(series.part("momentum", 6)[k], here.momentum)
        for frame in frames:
            np.testing.assert_array_equal(series.position(frame)[k], here.position(frame))
            np.testing.assert_array_equal(series.rotation(frame)[k], here.rotation(frame))
            np.testing.assert_array_equal(series.jacobian(frame)[k], here.jacobian(frame))
    np.testing.assert_array_equal(
        robot.integrate_all(q, v), [robot.integrate(*one, 1.0) for one in zip(q, v, strict=True)]
    )
    steps = velocities(robot, q, 0.5)
    for a, b, step in zip(q[:-1], q[1:], steps, strict=True):
        np.testing.assert_allclose(robot.difference(robot.integrate(a, step, 0.5), b), 0, atol=1e-9)


def test_change_of_the_momentum_is_pinocchios(robot: Robot, rng: np.random.Generator) -> None:
    """By configurations, at velocities that stay: sums in another order, 1e-12 of the largest."""
    q, v, acceleration = states(robot, rng)
    data, found = robot.model.createData(), state_series(robot, q, v, (), momentum_jacobian=True)
    for k in range(COUNT):
        args = robot.model, data, q[k], v[k], acceleration[k]
        wanted = pin.computeCentroidalDynamicsDerivatives(*args)[0]
        atol = 1e-12 * float(np.abs(wanted).max())
        np.testing.assert_allclose(found.momentum_jacobian[k], wanted, rtol=0.0, atol=atol)


def test_near_pairs_in_a_row(rng: np.random.Generator) -> None:
    """All pairs of all states that are near, against those of each, one by one."""
    robot, limit = Robot.load("hoap2_like"), 0.02  # m
    q, _, _ = states(robot, rng)
    every = SelfCollision(robot, pairs=10_000, margin=0.013)
    where, pairs, clearance, J = every.near(q, state_series(robot, q), limit)
    assert len(where) > 10
    for k in range(COUNT):
        found = every.distances(robot.snapshot(q[k]))
        near = np.flatnonzero(found.clearance < limit)
        np.testing.assert_array_equal(pairs[where == k], found.keys[near])
        # In order of the pairs, measured by the same arithmetic but for bodies inside each other.
        np.testing.assert_allclose(clearance[where == k], found.clearance[near], atol=1e-6)
        np.testing.assert_allclose(J[where == k], found.jacobian[near], atol=1e-6)


def test_series_are_snapshots_in_a_row(robot: Robot, rng: np.random.Generator) -> None:
    q, v, acceleration = states(robot, rng)
    series = centroidal_series(robot, q, v, acceleration)
    size = float(np.abs(series.inertia).max()) + robot.mass
    for k in range(COUNT):
        here = robot.snapshot(q[k], v[k])
        rate = here.centroidal_map @ acceleration[k] + here.momentum_drift
        turned = vech_inverse(here.inertia_jacobian @ v[k])
        for found, wanted in (
            (series.com, here.com),
            (series.momentum, here.momentum),
            (series.momentum_rate, rate),
            (series.inertia, here.inertia),
            (series.inertia_rate, turned),
        ):
            # Different passes over the same tree: equal but for rounding.
            np.testing.assert_allclose(found[k], wanted, rtol=1e-10, atol=1e-11 * size)
        for name, foot in robot.feet.items():
            np.testing.assert_allclose(series.soles[name][k, :3, 3], here.position(foot.frame))
            np.testing.assert_allclose(series.soles[name][k, :3, :3], here.rotation(foot.frame))


def test_soles_alone_are_the_same(robot: Robot, rng: np.random.Generator) -> None:
    q, v, acceleration = states(robot, rng)
    alone, both = sole_series(robot, q), centroidal_series(robot, q, v, acceleration).soles
    assert list(alone) == list(both) == list(robot.feet)
    for name in robot.feet:
        np.testing.assert_allclose(alone[name], both[name], atol=1e-12)


def test_progress_is_reported_to_the_end(hoap2, rng: np.random.Generator) -> None:
    calls = list[tuple[int, int]]()
    q = np.tile(hoap2.postures["standing"], (1100, 1))
    sole_series(hoap2, q, lambda done, total: calls.append((done, total)))
    assert calls == [(500, 1100), (1000, 1100), (1100, 1100)]


def test_which_joints_turn(robot_named) -> None:
    robot = robot_named("mixed_joints")
    joints = (robot.model.joints[robot.model.getJointId(name)] for name in robot.joint_names)
    expected = [joint.shortname().startswith("JointModelR") for joint in joints]
    assert revolute_joints(robot).tolist() == expected
    assert set(expected) == {True, False}


def test_rotations_are_those_of_a_quaternion() -> None:
    half = np.deg2rad([0.0, 15.0, 45.0])
    quaternions = np.column_stack((np.zeros(3), np.zeros(3), np.sin(half), np.cos(half)))
    R = rotations_from(quaternions)
    np.testing.assert_allclose(R[1] @ [1.0, 0.0, 0.0], [np.sqrt(3) / 2, 0.5, 0.0], atol=1e-15)
    np.testing.assert_allclose(R[2] @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)


def test_rotation_vectors_are_pinocchios(rng: np.random.Generator) -> None:
    """Of rotations up to half a turn; both lose half the digits there."""
    w = rng.normal(size=(200, 3))
    w *= (np.linspace(0.0, np.pi - 1e-3, 200) / np.linalg.norm(w, axis=1))[:, None]
    np.testing.assert_allclose(
        rotation_vectors(np.array([pin.exp3(one) for one in w])), w, atol=1e-9
    )


def test_wrong_shapes_are_refused(hoap2) -> None:
    q, v = np.tile(hoap2.postures["standing"], (3, 1)), np.zeros((3, hoap2.nv))
    with pytest.raises(InvalidInputError, match="v: expected shape"):
        centroidal_series(hoap2, q, v[:, 1:], v)
    with pytest.raises(InvalidInputError, match="acceleration: NaN"):
        centroidal_series(hoap2, q, v, v + np.nan)
    with pytest.raises(InvalidInputError, match="has norm 2, expected 1"):
        hoap2.integrate_all(np.vstack((q[:2], 2.0 * q[:1])), v)


def test_derivatives_are_those_of_differences(hoap2: Robot, rng: np.random.Generator) -> None:
    model = hoap2.model
    q = pin.integrate(model, hoap2.postures["standing"], 0.2 * rng.normal(size=hoap2.nv))
    v, a = rng.normal(size=hoap2.nv), 5.0 * rng.normal(size=hoap2.nv)
    found = centroidal_derivatives(hoap2, q[None], v[None], a[None])
    steps = 1e-6 * np.vstack((np.eye(hoap2.nv), -np.eye(hoap2.nv)))
    turned = np.array([pin.integrate(model, q, step) for step in steps])
    still = np.tile(q, (len(steps), 1)), np.tile(v, (len(steps), 1)), np.tile(a, (len(steps), 1))

    def quotients(values: np.ndarray) -> np.ndarray:
        ahead, behind = np.split(values, 2)
        return (ahead - behind).T / 2e-6

    by_q = centroidal_series(hoap2, turned, *still[1:])
    by_v = centroidal_series(hoap2, still[0], v + steps, still[2])
    by_a = centroidal_series(hoap2, *still[:2], a + steps)
    vech = by_q.inertia[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    # Differences of 1e-6: right to 1e-9 of values of up to 300.
    for exact, values in (
        (found.com, by_q.com),
        (found.inertia, vech),
        (found.momentum_by_q, by_q.momentum),
        (found.rate_by_q, by_q.momentum_rate),
        (found.rate_by_v, by_v.momentum_rate),
        (found.centroidal_map, by_v.momentum),
        (found.centroidal_map, by_a.momentum_rate),
        (found.soles[:, 0, :3], by_q.soles["left"][:, :3, 3]),
    ):
        np.testing.assert_allclose(exact[0], quotients(values), atol=1e-6)


def test_two_configurations_have_one_velocity_and_no_rate_of_it(hoap2: Robot) -> None:
    q = hoap2.postures["standing"]
    step = np.linspace(-0.1, 0.1, hoap2.nv)
    v, acceleration = rates(hoap2, np.stack((q, hoap2.integrate(q, step, 1.0))), 0.5)
    np.testing.assert_allclose(v, np.stack((step, step)) / 0.5, atol=1e-12)
    np.testing.assert_array_equal(acceleration, np.zeros((2, hoap2.nv)))
