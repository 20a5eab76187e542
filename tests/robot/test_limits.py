"""Joint limits against the URDF's XML, and joint positions against angles put in by hand."""

import pickle
import xml.etree.ElementTree as ET
from collections.abc import Callable

import numpy as np
import pytest

from tests import urdf
from wbc.robot import JointLimits, Robot

Load = Callable[[str], Robot]


@pytest.mark.parametrize("name", ["hoap2_like", "g1", "talos", "icub", "romeo"])
def test_limits_are_those_of_the_file(name: str, robot_named: Load) -> None:
    robot = robot_named(name)
    limits = robot.limits
    joints = ET.parse(robot.path).findall("joint")
    found = {joint.get("name"): joint.find("limit") for joint in joints}
    assert limits.names == robot.joint_names
    for key in ("lower", "upper", "velocity", "effort"):
        written = [float(found[joint].get(key, "nan")) for joint in limits.names]
        np.testing.assert_array_equal(getattr(limits, key), written)


@pytest.fixture
def chain() -> Robot:
    """Wheel (continuous), rail (prismatic), elbow (revolute), wheel again; few limits."""
    kinds = {
        "wheel": ("continuous", '<limit effort="0" velocity="7"/>'),
        "rail": ("prismatic", '<limit lower="-0.5" upper="0.25" effort="20" velocity="0"/>'),
        "elbow": ("revolute", ""),
        "spinner": ("continuous", ""),
    }
    parts = [urdf.link(f"l{k}", at="0.1 0.1 0.1") for k in range(5)]
    for k, (name, (kind, limit)) in enumerate(kinds.items()):
        between = f"l{k}", f"l{k + 1}"
        parts.append(urdf.joint(name, *between, kind=kind, axis="0 0 1", limit=limit))
    return Robot.load(urdf.robot("chain", *parts))


def test_missing_limits_are_infinite_and_named(chain: Robot) -> None:
    limits = chain.limits
    assert limits.names == ("wheel", "rail", "elbow", "spinner")
    inf = np.inf
    np.testing.assert_array_equal(limits.lower, [-inf, -0.5, -inf, -inf])
    np.testing.assert_array_equal(limits.upper, [inf, 0.25, inf, inf])
    np.testing.assert_array_equal(limits.velocity, [7, inf, inf, inf])
    np.testing.assert_array_equal(limits.effort, [inf, 20, inf, inf])
    missing = "wheel: effort, rail: velocity, elbow: position, elbow: velocity, elbow: effort"
    assert ", ".join(limits.missing) == f"{missing}, spinner: velocity, spinner: effort"


def test_joint_positions_are_angles(chain: Robot) -> None:
    assert (chain.nq, chain.nv) == (13, 10)
    for wheel, spinner in ((0.3, -3.0), (np.pi / 2, -np.pi / 2), (3.1, 1.0)):
        q = np.zeros(chain.nq)
        q[6] = 1.0
        q[7:] = np.cos(wheel), np.sin(wheel), 0.2, -4.0, np.cos(spinner), np.sin(spinner)
        positions = chain.limits.joint_positions(q)
        np.testing.assert_allclose(positions, [wheel, 0.2, -4.0, spinner], atol=1e-15)


def test_joint_positions_of_many_and_how_far_they_are_past_limits(chain: Robot) -> None:
    rng, limits = np.random.default_rng(0), chain.limits
    qs = np.array([chain.integrate(chain.postures["neutral"], rng.normal(size=chain.nv), 1.0)
                   for _ in range(6)])  # fmt: skip
    positions = limits.joint_positions(qs.reshape(2, 3, -1))
    each = [limits.joint_positions(q) for q in qs]
    np.testing.assert_array_equal(positions.reshape(6, -1), each)
    for past, at in zip(limits.past(positions).reshape(6, -1), each, strict=True):
        for k, value in enumerate(at):
            beyond = [limits.lower[k] - value, value - limits.upper[k]]
            assert past[k] == max(beyond)
    assert (limits.past(np.full(4, np.nan)) > 0.0).sum() == 0


def test_joint_positions_follow_the_velocity(chain: Robot) -> None:
    v = np.array([0, 0, 0, 0, 0, 0, 0.5, 0.1, -0.4, 2.0])
    q = chain.integrate(chain.postures["neutral"], v, 0.5)
    np.testing.assert_allclose(chain.limits.joint_positions(q), 0.5 * v[6:], atol=1e-14)


def test_joint_positions_are_a_view_without_continuous_joints(g1: Robot) -> None:
    q = g1.posture()
    positions = g1.limits.joint_positions(q)
    assert np.shares_memory(positions, q)
    np.testing.assert_array_equal(positions, q[7:])


def test_limits_cannot_be_changed(hoap2: Robot) -> None:
    limits = hoap2.limits
    copied: JointLimits = pickle.loads(pickle.dumps(limits))
    for each in (limits, copied):
        for array in (each.lower, each.upper, each.velocity, each.effort):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 0.0
    np.testing.assert_array_equal(copied.upper, limits.upper)
