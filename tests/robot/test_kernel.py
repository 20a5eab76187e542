"""The native core's pass against Pinocchio's, which is what runs without it."""

import pickle
import threading

import numpy as np
import pinocchio as pin
import pytest

from tests.conftest import ROBOTS, load, random_state
from tests.needs import needs_core
from wbc.errors import InvalidInputError
from wbc.native import VARIABLE, NativeCoreError, status
from wbc.robot import Robot, kernel
from wbc.robot.kernel import NativeTree
from wbc.robot.kernel_check import disagreement

QUANTITIES = (
    *("com", "inertia", "momentum", "centroidal_map", "com_jacobian", "inertia_jacobian"),
    *("base_inertia_jacobian", "joint_twists", "com_velocity", "average_angular_velocity"),
    *("mass_matrix", "bias", "com_drift", "momentum_drift", "inertia_drift"),
)
INERTIAL = ("inertia_jacobian_in", "inertia_drift_in")
pytestmark = needs_core


def both(name: str, monkeypatch) -> tuple[Robot, Robot]:
    """Return a robot in the native core, and the same in Python."""
    source = load(name).path
    known = name if name in ROBOTS[:-1] else source
    robots = []
    for mode in ("require", "off"):
        monkeypatch.setenv(VARIABLE, mode)
        robot = Robot.load(known)
        assert (robot.native is not None) == (mode == "require")
        robots.append(robot)
    return robots[0], robots[1]


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_every_quantity_is_that_of_the_python_path(name: str, rng, monkeypatch) -> None:
    """Sums in another order: 1e-12 of the largest entry."""
    fast, plain = both(name, monkeypatch)
    frames = [fast.frame_names[k] for k in rng.permutation(len(fast.frame_names))[:40]]
    for _ in range(20):
        q, v = random_state(plain, rng)
        ours, theirs = fast.snapshot(q, v), plain.snapshot(q, v)
        pairs = [(key, getattr(ours, key), getattr(theirs, key)) for key in QUANTITIES]
        parts = zip(ours.joint_placements, theirs.joint_placements, strict=True)
        pairs += [("placements", a, b) for a, b in parts]
        for frame in frames:
            for key in ("position", "rotation", "jacobian", "drift", *INERTIAL):
                pairs.append(
                    (f"{key} {frame}", getattr(ours, key)(frame), getattr(theirs, key)(frame))
                )
        for key, a, b in pairs:
            assert a.shape == b.shape
            assert not a.flags.writeable
            scale = max(1.0, float(np.abs(b).max()))
            np.testing.assert_allclose(a, b, rtol=0.0, atol=1e-12 * scale, err_msg=key)


@pytest.mark.parametrize("name", ROBOTS)
def test_it_agrees_with_pinocchio(name: str) -> None:
    robot = load(name)
    tree = NativeTree(status().core, robot.model)
    assert disagreement(tree, robot.workspace, states=50, seed=1) < 1e-11


@pytest.mark.parametrize("name", ["g1", "mixed_joints"])
def test_where_a_step_leads_is_pinocchios(name: str, rng, monkeypatch) -> None:
    """From steps that only series can tell from none, through where these end, to two turns."""
    robot, _ = both(name, monkeypatch)
    for size in (1e-9, 1e-4, 9e-3, 1.1e-2, 0.3, 3.0, 12.0):
        q, _ = random_state(robot, rng)
        turn = rng.normal(size=robot.nv)
        step = size * turn / np.linalg.norm(turn[3:6])
        out = robot.integrate(q, step / 0.01, 0.01)
        expected = pin.integrate(robot.model, q, step)
        np.testing.assert_allclose(out, expected, rtol=0.0, atol=1e-14 * max(1.0, 10.0 * size))


@pytest.mark.parametrize("name", ["g1", "mixed_joints"])
def test_what_is_measured_is_that_of_the_python_path(name: str, rng, monkeypatch) -> None:
    """Copies, read-only, normalised; and whatever Python refuses is refused in the same words."""
    fast, plain = both(name, monkeypatch)
    q, v = random_state(plain, rng)
    q[3:7] *= 1.0 + 5e-4
    given = q.copy()
    ours, theirs = fast.snapshot(q, v), plain.snapshot(q, v)
    q[0], v[0] = 7.0, 7.0
    np.testing.assert_allclose(ours.q, theirs.q, rtol=1e-15)
    np.testing.assert_array_equal(ours.v, theirs.v)
    assert not (ours.q.flags.writeable or ours.v.flags.writeable)
    np.testing.assert_array_equal(fast.snapshot(given[:], theirs.v).q, ours.q)
    long = np.repeat(given, 2)[::2]  # entries that are not side by side
    np.testing.assert_array_equal(fast.snapshot(long, theirs.v).q, ours.q)
    turns = [plain.limits.starts[k] for k in plain.limits.unbounded]
    for entry in (0, 4, fast.nq - 1, *turns):
        for wrong in (np.nan, np.inf, -np.inf, 1.1e6, 1e200):
            spoiled = given.copy()
            spoiled[entry] = wrong
            said = []
            for robot in (fast, plain):
                for call in (robot.snapshot, lambda q, v, r=robot: r.integrate(q, v, 0.1)):
                    with pytest.raises(InvalidInputError) as refused:
                        call(spoiled, theirs.v)
                    said.append(str(refused.value))
            assert said == said[:1] * 4
    for entry in (4, *turns):
        spoiled = given.copy()
        spoiled[entry] += 0.5
        with pytest.raises(InvalidInputError, match="has norm"):
            fast.snapshot(spoiled, theirs.v)
    given[3:7], far = (0.0, 0.0, 0.0, 1.0), np.zeros(fast.nv)
    far[0] = 9e5
    for robot in (fast, plain):
        assert robot.integrate(given, far, 0.5)[0] > 1e5
        with pytest.raises(InvalidInputError, match="beyond 1e\\+06"):
            robot.integrate(robot.integrate(given, far, 0.9), far, 0.9)


def test_far_from_the_origin_nothing_is_lost(monkeypatch) -> None:
    """Where bodies are is lost to rounding at 900 km; how they lie to each other is not."""
    fast, _ = both("g1_27", monkeypatch)
    q = fast.posture()
    here = fast.snapshot(q)
    q[:3] += 9e5
    there = fast.snapshot(q)
    np.testing.assert_allclose(there.inertia, here.inertia, atol=1e-12)
    np.testing.assert_allclose(there.inertia_jacobian, here.inertia_jacobian, atol=1e-12)
    np.testing.assert_allclose(there.centroidal_map, here.centroidal_map, atol=1e-12)


def test_a_state_lasts(rng, monkeypatch) -> None:
    """Nothing of a snapshot changes when others are made, or when frames join."""
    fast, _ = both("hoap2_like", monkeypatch)
    first = fast.snapshot(*random_state(fast, rng))
    before = first.inertia_jacobian.copy(), first.jacobian("left_hand").copy()
    for frame in fast.frame_names[:60]:  # more than states keep
        fast.snapshot(*random_state(fast, rng)).position(frame)
    assert len(fast.native.slots) == kernel.KEPT
    np.testing.assert_array_equal(first.inertia_jacobian, before[0])
    np.testing.assert_array_equal(first.jacobian("left_hand"), before[1])
    np.testing.assert_array_equal(
        first.jacobian(fast.frame_names[40]), fast.snapshot(first.q).jacobian(fast.frame_names[40])
    )


def test_frames_are_the_same_bits_kept_or_asked_for_later(rng, monkeypatch) -> None:
    fast, _ = both("talos", monkeypatch)
    q, v = random_state(fast, rng)
    first, again = fast.snapshot(q, v), None
    for frame in ("base", "left_sole", "right_sole"):
        first.position(frame)
    again = fast.snapshot(q, v)
    assert set(fast.native.slots) == {"base", "left_sole", "right_sole"}
    for frame in fast.native.slots:
        np.testing.assert_array_equal(again.jacobian(frame), first.jacobian(frame))
        np.testing.assert_array_equal(again.position(frame), first.position(frame))
        np.testing.assert_array_equal(again.rotation(frame), first.rotation(frame))


def test_small_quantities_do_not_keep_the_whole(monkeypatch) -> None:
    """Who records the CoM of a million ticks must not keep a million Jacobians."""
    fast, _ = both("hoap2_like", monkeypatch)
    for _ in range(2):
        here = fast.snapshot(fast.posture())
        for small in (here.com, here.inertia, here.momentum, here.position("base")):
            root = small
            while root.base is not None:
                root = root.base
            assert root.nbytes <= 100


def test_each_thread_has_its_own_memory(monkeypatch) -> None:
    fast, _ = both("hoap2_like", monkeypatch)
    mine, found = fast.native, []
    thread = threading.Thread(target=lambda: found.append(fast.native))
    thread.start()
    thread.join()
    assert found[0] is not mine
    assert found[0].tree is mine.tree


def test_a_stone_is_known_too(tmp_path, monkeypatch) -> None:
    """Nothing that turns changes its inertia: what is left of that is rounding."""
    path = tmp_path / "stone.urdf"
    path.write_text(
        '<robot name="stone"><link name="stone"><inertial><mass value="2"/><inertia ixx="1" ixy="0"'
        ' ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link></robot>'
    )
    monkeypatch.setenv(VARIABLE, "require")
    assert Robot.load(path, base="floating").native is not None


def test_a_core_that_is_wrong_is_refused_with_a_warning(monkeypatch, caplog) -> None:
    """As if a compiler had got one body's inertia wrong by a thousandth."""
    right = kernel._body
    monkeypatch.setattr(kernel, "_body", lambda inertia: right(inertia) * (1 + 1e-3))
    monkeypatch.setenv(VARIABLE, "auto")
    robot = Robot.load("hoap2_like")
    assert robot.native is None
    assert "the native core and Pinocchio differ by" in caplog.text
    assert np.isfinite(robot.snapshot(robot.posture()).com).all()
    monkeypatch.setenv(VARIABLE, "require")
    with pytest.raises(NativeCoreError, match="differ by"):
        Robot.load("hoap2_like").snapshot(robot.posture()).com.sum()


def test_a_core_that_answers_nan_is_refused(monkeypatch) -> None:
    right = kernel._body
    monkeypatch.setattr(kernel, "_body", lambda inertia: right(inertia) * np.nan)
    monkeypatch.setenv(VARIABLE, "auto")
    assert Robot.load("hoap2_like").native is None


@needs_core
def test_integrate_gives_the_same_bits_for_unpickled_arrays_lists_and_robots() -> None:
    """The type of an unpickled array is another object than NumPy's own."""
    robot = Robot.load("hoap2_like")
    unpickled = pickle.loads(pickle.dumps(robot))
    rng = np.random.default_rng(0)
    q = robot.posture("standing")
    for _ in range(50):
        v = rng.standard_normal(robot.nv)
        q = robot.integrate(q, v, 0.1)
        want = robot.integrate(q, v, 0.005).tobytes()
        again_q, again_v = pickle.loads(pickle.dumps((q, v)))
        assert robot.integrate(again_q, again_v, 0.005).tobytes() == want
        assert robot.integrate(q.tolist(), v.tolist(), 0.005).tobytes() == want
        assert unpickled.integrate(q, v, 0.005).tobytes() == want
        assert unpickled.integrate(again_q, v, 0.005).tobytes() == want
