"""The core's pass over a robot against Pinocchio's; the symbolic chain against both and SciPy."""

import pickle
import sys
import threading

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from tests.conftest import ROBOTS, load, random_state
from wbc.errors import InvalidInputError, ModelError, UnknownNameError
from wbc.placement import SERIES_BELOW, from_mrp, from_quaternion, rotation_log
from wbc.robot import Robot, kernel
from wbc.robot.symbolic import LocalRobot, SymbolicPosture, angle_turns, vech_symbolic
from wbc.spatial import COLUMNS, ROWS

ALIGNED = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
READ = (
    *("centroidal_map", "momentum", "momentum_drift", "com_drift", "inertia_jacobian"),
    *("inertia_drift", "joint_placements", "joint_twists", "mass_matrix", "bias"),
)


def loaded(name: str) -> Robot:
    """Return a robot that nothing was asked of yet."""
    return Robot.load(name if name in ROBOTS[:-1] else load(name).path)


@pytest.mark.parametrize("name", ROBOTS)
def test_every_quantity_is_pinocchios(name: str, rng) -> None:
    """Sums in another order: 1e-12 of the largest entry. The inertia's rates: see test_state."""
    robot = loaded(name)
    model, data = robot.model, robot.model.createData()
    frames = [robot.frame_names[k] for k in rng.permutation(len(robot.frame_names))[:40]]
    for _ in range(5):
        q, v = random_state(robot, rng)
        here = robot.snapshot(q, v)
        pin.ccrba(model, data, q, v)
        pairs = [
            ("com", here.com, data.com[0].copy()),
            ("inertia", here.inertia, data.Ig.inertia.copy()),
            ("momentum", here.momentum, data.hg.vector.copy()),
            ("centroidal map", here.centroidal_map, data.Ag.copy()),
            ("com jacobian", here.com_jacobian, pin.jacobianCenterOfMass(model, data, q).copy()),
            ("twists", here.joint_twists, pin.computeJointJacobians(model, data, q).copy()),
            ("mass matrix", here.mass_matrix, pin.crba(model, data, q).copy()),
            ("bias", here.bias, pin.nonLinearEffects(model, data, q, v).copy()),
        ]
        rotations, origins = here.joint_placements
        pairs.append(("rotations", rotations, np.array([pose.rotation for pose in data.oMi])))
        pairs.append(("origins", origins, np.array([pose.translation for pose in data.oMi])))
        pin.computeCentroidalMomentumTimeVariation(model, data, q, v, np.zeros(robot.nv))
        rate = data.dhg.vector.copy()
        pairs.append(("momentum drift", here.momentum_drift, rate))
        pairs.append(("com drift", here.com_drift, rate[:3] / robot.mass))
        for frame in frames:
            k = robot.frame_id(frame)
            pose = pin.updateFramePlacement(model, data, k)
            drift = pin.getFrameClassicalAcceleration(model, data, k, ALIGNED).vector
            pairs += [
                (f"position {frame}", here.position(frame), pose.translation.copy()),
                (f"rotation {frame}", here.rotation(frame), pose.rotation.copy()),
                (f"drift {frame}", here.drift(frame), drift.copy()),
            ]
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        for frame in frames:
            J = pin.getFrameJacobian(model, data, robot.frame_id(frame), ALIGNED)
            pairs.append((f"jacobian {frame}", here.jacobian(frame), J))
        for key, ours, theirs in pairs:
            assert ours.shape == theirs.shape, key
            assert not ours.flags.writeable, key
            scale = max(1.0, float(np.abs(theirs).max()))
            np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-12 * scale, err_msg=key)


@pytest.mark.parametrize("name", ["g1", "mixed_joints"])
def test_where_a_step_leads_is_pinocchios(name: str, rng) -> None:
    """From steps that only series can tell from none, through where these end, to two turns."""
    robot = loaded(name)
    for size in (1e-9, 1e-4, 9e-3, 1.1e-2, 0.3, 3.0, 12.0):
        q, _ = random_state(robot, rng)
        turn = rng.normal(size=robot.nv)
        step = size * turn / np.linalg.norm(turn[3:6])
        out = robot.integrate(q, step / 0.01, 0.01)
        expected = pin.integrate(robot.model, q, step)
        np.testing.assert_allclose(out, expected, rtol=0.0, atol=1e-14 * max(1.0, 10.0 * size))


@pytest.mark.parametrize("name", ["g1", "mixed_joints"])
def test_what_is_measured_is_copied_and_normalised_and_what_is_no_state_refused(name, rng) -> None:
    """In the core as in Python, which reads lists: the same numbers, the same words."""
    robot = loaded(name)
    q, v = random_state(robot, rng)
    q[3:7] *= 1.0 + 5e-4
    given, moving = q.copy(), v.copy()
    ours, theirs = robot.snapshot(q, v), robot.snapshot(q.tolist(), v.tolist())
    q[0], v[0] = 7.0, 7.0
    np.testing.assert_allclose(ours.q, theirs.q, rtol=1e-15)
    np.testing.assert_allclose(ours.q[:3], given[:3], rtol=0.0)
    np.testing.assert_allclose(ours.q[3:7], given[3:7] / np.linalg.norm(given[3:7]), rtol=1e-15)
    np.testing.assert_array_equal(ours.v, moving)
    assert not (ours.q.flags.writeable or ours.v.flags.writeable)
    long = np.repeat(given, 2)[::2]  # entries that are not side by side
    np.testing.assert_array_equal(robot.snapshot(long, moving).q, ours.q)
    turns = [robot.limits.starts[k] for k in robot.limits.unbounded]
    for entry in (0, 4, robot.nq - 1, *turns):
        for wrong in (np.nan, np.inf, -np.inf, 1.1e6, 1e200):
            spoiled = given.copy()
            spoiled[entry] = wrong
            said = []
            for form in (spoiled, spoiled.tolist()):
                for call in (robot.snapshot, lambda q, v: robot.integrate(q, v, 0.1)):
                    with pytest.raises(InvalidInputError) as refused:
                        call(form, moving)
                    said.append(str(refused.value))
            assert said == said[:1] * 4
    for entry in (4, *turns):
        spoiled = given.copy()
        spoiled[entry] += 0.5
        with pytest.raises(InvalidInputError, match="has norm"):
            robot.snapshot(spoiled, moving)
    given[3:7], far = (0.0, 0.0, 0.0, 1.0), np.zeros(robot.nv)
    far[0] = 9e5
    assert robot.integrate(given, far, 0.5)[0] > 1e5
    with pytest.raises(InvalidInputError, match="beyond 1e\\+06"):
        robot.integrate(robot.integrate(given, far, 0.9), far, 0.9)


def test_far_from_the_origin_nothing_is_lost() -> None:
    """Where bodies are is lost to rounding at 900 km; how they lie to each other is not."""
    robot = loaded("g1_27")
    q = robot.posture()
    here = robot.snapshot(q)
    q[:3] += 9e5
    there = robot.snapshot(q)
    np.testing.assert_allclose(there.inertia, here.inertia, atol=1e-12)
    np.testing.assert_allclose(there.inertia_jacobian, here.inertia_jacobian, atol=1e-12)
    np.testing.assert_allclose(there.centroidal_map, here.centroidal_map, atol=1e-12)


def test_small_quantities_do_not_keep_the_whole() -> None:
    """Who records the CoM of a million ticks must not keep a million Jacobians."""
    robot = loaded("hoap2_like")
    for _ in range(2):
        here = robot.snapshot(robot.posture())
        for small in (here.com, here.inertia, here.momentum, here.position("base")):
            root = small
            while root.base is not None:
                root = root.base
            assert root.nbytes <= 100


@pytest.mark.parametrize("wrong", [1 + 1e-3, np.nan])
def test_a_core_that_is_wrong_refuses_the_robot_by_name(wrong: float, monkeypatch) -> None:
    """As if a compiler had got the bodies' inertias wrong by a thousandth, or worse."""
    right = kernel._body
    monkeypatch.setattr(kernel, "_body", lambda inertia: right(inertia) * wrong)
    with pytest.raises(ModelError, match="robot 'hoap2_like': the compiled core and Pinocchio"):
        Robot.load("hoap2_like")


def test_integrate_gives_the_same_bits_for_unpickled_arrays_lists_and_robots(hoap2, rng) -> None:
    """The type of an unpickled array is another object than NumPy's own."""
    unpickled, q = pickle.loads(pickle.dumps(hoap2)), hoap2.posture("standing")
    for _ in range(50):
        v = rng.standard_normal(hoap2.nv)
        q = hoap2.integrate(q, v, 0.1)
        want = hoap2.integrate(q, v, 0.005).tobytes()
        again = pickle.loads(pickle.dumps((q, v)))
        for given in (again, (q.tolist(), v.tolist())):
            assert hoap2.integrate(*given, 0.005).tobytes() == want
        for given in ((q, v), (again[0], v)):
            assert unpickled.integrate(*given, 0.005).tobytes() == want


@pytest.fixture
def fast_switching():
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.usefixtures("fast_switching")
def test_threads_share_a_robot():
    robot, rng = Robot.load("hoap2_like"), np.random.default_rng(0)
    states = [
        (robot.integrate(robot.posture(), 0.3 * v, 1.0), v)
        for v in rng.standard_normal((40, robot.nv))
    ]

    def everything(k):
        snapshot = robot.snapshot(*states[k])
        found = [np.concatenate([np.ravel(p) for p in getattr(snapshot, name)]) for name in READ]
        found += [snapshot.jacobian("base").ravel(), snapshot.drift("base"), snapshot.com]
        return np.concatenate(found)

    expected = [everything(k) for k in range(len(states))]
    wrong = []

    def read(first):
        for k in 8 * [*range(first, len(states)), *range(first)]:
            try:
                if not np.array_equal(everything(k), expected[k]):
                    wrong.append(k)
            except Exception as error:  # an exception in a thread would only be printed
                wrong.append(error)

    threads = [threading.Thread(target=read, args=(first,)) for first in (0, 13, 26)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


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
