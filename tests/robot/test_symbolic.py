"""The symbolic chain against the snapshot (test_kernel), SciPy, and finite differences."""

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wbc.errors import UnknownNameError
from wbc.placement import SERIES_BELOW, from_mrp, from_quaternion, rotation_log
from wbc.robot import Robot
from wbc.robot.symbolic import LocalRobot, SymbolicPosture, angle_turns, vech_symbolic
from wbc.spatial import COLUMNS, ROWS

STATES = 4
# The same sums in another order: a few units in the last place of the largest entry.
RELATIVE = 1e-12


def last_frame(robot: Robot) -> str:
    """A link far from the base: many joints lie between."""
    return max(robot.frame_names, key=lambda f: robot.model.frames[robot.frame_id(f)].parentJoint)


def assert_near(actual: object, expected: np.ndarray) -> None:
    scale = max(np.abs(expected).max(), 1e-3)
    flat = np.array(actual, dtype=float).reshape(expected.shape, order="F")
    np.testing.assert_allclose(flat, expected, rtol=0, atol=RELATIVE * scale)


def test_com_and_frames_are_the_snapshots(robot: Robot, rng, random_snapshot) -> None:
    frames = (last_frame(robot), "base")
    q = ca.SX.sym("q", robot.nq)
    here = SymbolicPosture.at(robot, q)
    parts = [part for frame in frames for part in (here.position(frame), here.rotation(frame))]
    function = ca.Function("f", [q], [here.com, *parts])
    for _ in range(STATES):
        s = random_snapshot(robot, rng)
        wanted = [part for frame in frames for part in (s.position(frame), s.rotation(frame))]
        for found, expected in zip(function(s.q), (s.com, *wanted), strict=True):
            assert_near(found, expected)


@pytest.mark.parametrize(
    "about", ["com", "world", "base", "last frame", np.array((0.3, -0.4, 0.5))], ids=str
)
def test_inertia_about_other_points_is_the_snapshots(about, robot: Robot, rng, random_snapshot):
    frame = last_frame(robot)
    about = frame if str(about) == "last frame" else about
    q = ca.SX.sym("q", robot.nq)
    symbolic = SymbolicPosture.at(robot, q)
    axes = ("world", "base", frame)
    outputs = [vech_symbolic(symbolic.inertia_in(one, about)) for one in axes]
    function = ca.Function("f", [q], outputs)
    here = random_snapshot(robot, rng)
    for one, found in zip(axes, function(here.q), strict=True):
        assert_near(found, here.inertia_in(one, about)[ROWS, COLUMNS])


def test_first_and_second_derivatives_are_those_of_the_snapshot(
    robot: Robot, rng, random_snapshot
) -> None:
    """The snapshot differentiates by spins of Newton-Euler passes, CasADi by the chain rule."""
    joints = ca.SX.sym("joints", robot.nv - 6)
    inertia = LocalRobot(robot, angle_turns(robot, joints)).inertia
    weights = np.array([[1.0, 0.3, -0.2], [0.3, -0.5, 0.7], [-0.2, 0.7, 2.0]])
    hessian, _ = ca.hessian(ca.dot(ca.DM(weights), inertia), joints)
    jacobian = ca.jacobian(vech_symbolic(inertia), joints)
    function = ca.Function("derivatives", [joints], [jacobian, hessian])
    here = random_snapshot(robot, rng)
    first, second = function(robot.limits.joint_positions(here.q))
    expected = here.base_inertia_jacobian[:, 6:]
    # Both exact; the passes subtract products of large spins: 1e-10 of the size.
    np.testing.assert_allclose(first, expected, rtol=0, atol=1e-10 * np.abs(expected).max())
    expected = here.base_inertia_hessian(weights)[6:, 6:]
    np.testing.assert_allclose(second, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_rotations_of_quaternions_and_rodrigues_parameters() -> None:
    rotations = Rotation.random(20, random_state=1)
    quaternion, sigma = ca.SX.sym("q", 4), ca.SX.sym("s", 3)
    of_quaternion = ca.Function("q", [quaternion], [from_quaternion(quaternion)])
    of_mrp = ca.Function("s", [sigma], [from_mrp(sigma)])
    for rotation in rotations:
        expected = rotation.as_matrix()
        np.testing.assert_allclose(of_quaternion(rotation.as_quat()), expected, atol=1e-14)
        np.testing.assert_allclose(of_mrp(rotation.as_mrp()), expected, atol=1e-14)
    # Beyond half a turn there is no singularity either: the same rotation from the other side.
    sigma_far = 1.5 * np.array([0.6, 0.0, 0.8])
    expected = Rotation.from_rotvec(4 * np.arctan(1.5) * np.array([0.6, 0.0, 0.8])).as_matrix()
    np.testing.assert_allclose(of_mrp(sigma_far), expected, atol=1e-14)


EDGE = np.arccos(1 - SERIES_BELOW)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, EDGE - 1e-9, EDGE + 1e-9, 1.0, 3.0])
def test_logarithm_of_a_rotation(angle: float) -> None:
    """Value by SciPy; first and second derivatives along a turn by differences of SciPy's."""
    axis, spin = np.array([0.48, -0.6, 0.64]), np.array([0.3, 1.0, -0.2])
    w = ca.SX.sym("w", 3)
    turned = ca.mtimes(ca.DM(Rotation.from_rotvec(angle * axis).as_matrix()), from_mrp(w / 4))
    log = rotation_log(turned)
    slope = ca.jtimes(log, w, ca.DM(spin))
    along = ca.Function("log", [w], [log, slope, ca.jtimes(slope, w, ca.DM(spin))])
    value, first, second = (np.array(out).ravel() for out in along(np.zeros(3)))

    def by_scipy(t: float) -> np.ndarray:
        return (Rotation.from_rotvec(angle * axis) * Rotation.from_mrp(t * spin / 4)).as_rotvec()

    h = 1e-4
    low, middle, high = by_scipy(-h), by_scipy(0.0), by_scipy(h)
    # Near half a turn the angle is the arc cosine of almost -1: 1e-16 / sin(3) and its square.
    np.testing.assert_allclose(value, middle, atol=1e-13)
    np.testing.assert_allclose(first, (high - low) / (2 * h), atol=1e-5)  # h^2 * third derivative
    np.testing.assert_allclose(second, (high - 2 * middle + low) / h**2, atol=1e-4)


def test_unknown_frames_are_named(hoap2: Robot) -> None:
    here = SymbolicPosture.at(hoap2, ca.SX.sym("q", hoap2.nq))
    with pytest.raises(UnknownNameError, match="unknown frame 'left_sol'"):
        here.position("left_sol")
