"""What the results of all shipped problems say, checked by code that shares nothing with this one.

Of a robot's result only the saved file is read. Robots are read from their URDF again by Pinocchio,
joints locked by pattern here; soles are hulled by SciPy, raw meshes measured by Coal, limits read
by ElementTree; only where a sole is in its link is believed. Of pendulums the history that the run
returned is checked, by differences. Robots are run once, for a quarter of a second or as many
seconds as WBC_CHECK_SECONDS says, pendulums to their end.
"""

import json
import os
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from fnmatch import fnmatch
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
from ruamel.yaml import YAML
from scipy.spatial import ConvexHull

from wbc.problem import load_problem
from wbc.problem.pendulum.result import PendulumStatus
from wbc.robot import Robot
from wbc.robot.library import find_robot

PROBLEMS = Path(__file__).parents[2] / "problems"
SECONDS = float(os.environ.get("WBC_CHECK_SECONDS", "0.25"))
ROWS = 25  # of a history that are looked at
SUNK = 8e-3  # m: how far contacts of the physics give way, tilt included


def described(path: Path) -> dict[str, Any]:
    return YAML(typ="safe").load(path.read_text())


TEXTS = {path.stem: described(path) for path in sorted(PROBLEMS.glob("*.yaml"))}
PENDULUMS = [name for name, text in TEXTS.items() if "model" in text]
SIMULATED = [name for name, text in TEXTS.items() if "simulation" in text]
MOVED = [name for name in TEXTS if name not in (*PENDULUMS, *SIMULATED)]


class Body:
    """A robot's URDF as Pinocchio reads it, by the joint values of a result."""

    def __init__(self, spec: str | dict[str, Any], joints: list[str]) -> None:
        model = spec if isinstance(spec, str) else spec["model"]
        self.path = find_robot(model).path
        self.model = pin.buildModelFromUrdf(str(self.path), pin.JointModelFreeFlyer())
        self.data = self.model.createData()
        locked = {} if isinstance(spec, str) else spec.get("locked", {})
        self.base = pin.neutral(self.model)
        for joint in self.model.names[2:]:
            for pattern, value in locked.items():
                if fnmatch(joint, pattern):
                    self.base[self.model.idx_qs[self.model.getJointId(joint)]] = value
        self.free = [self.model.getJointId(joint) for joint in joints]
        assert all(self.model.nqs[joint] == 1 for joint in self.free)

    def q(self, q: np.ndarray) -> np.ndarray:
        full = self.base.copy()
        full[:7] = q[:7]
        full[[self.model.idx_qs[joint] for joint in self.free]] = q[7:]
        return full

    def v(self, v: np.ndarray) -> np.ndarray:
        full = np.zeros(self.model.nv)
        full[:6] = v[:6]
        full[[self.model.idx_vs[joint] for joint in self.free]] = v[6:]
        return full

    def place(self, q: np.ndarray) -> None:
        pin.ccrba(self.model, self.data, self.q(q), np.zeros(self.model.nv))
        pin.framesForwardKinematics(self.model, self.data, self.q(q))

    def limits(self) -> dict[str, dict[str, float]]:
        found = {}
        for joint in ET.parse(self.path).getroot().findall("joint"):
            limit = joint.find("limit")
            if limit is not None and joint.get("type") == "revolute":
                found[joint.get("name", "")] = {k: float(v) for k, v in limit.attrib.items()}
        return found


def outcome(name: str) -> tuple[dict[str, Any], dict[str, np.ndarray], Body]:
    """Run a problem and return what its file says: summary, arrays, and the robot read again."""
    text, changed = TEXTS[name], dict[str, Any]()
    ticks = iter(range(round(SECONDS / text.get("controller", {}).get("dt", 0.005))))
    stopped: Callable[[], bool] | None = partial(_used_up, ticks)
    if text.get("controller", {}).get("method") == "global":  # its search asks too
        stopped = None
        changed |= {"stop.duration": SECONDS}
        changed |= {} if SECONDS >= 5.0 else {"controller.starts": 2, "controller.workers": 1}
    problem = load_problem(PROBLEMS / f"{name}.yaml", changed)
    run = problem.simulate if name in SIMULATED else problem.run
    return read_again(name, run(cancelled=stopped))


def _used_up(ticks: Iterator[int]) -> bool:
    return next(ticks, None) is None


def read_again(name: str, result: Any) -> tuple[dict[str, Any], dict[str, np.ndarray], Body]:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "result.npz"
        result.save(path)
        with np.load(path) as file:
            arrays = dict(file)
    summary = json.loads(str(arrays.pop("summary")))
    joints = [str(joint) for joint in arrays["joint_names"]]
    return summary, arrays, Body(TEXTS[name]["robot"], joints)


def model_of(name: str) -> str:
    """Return the robot that a problem names."""
    spec = TEXTS[name]["robot"]
    return spec if isinstance(spec, str) else spec["model"]


def rows_of(arrays: dict[str, np.ndarray]) -> list[int]:
    count = len(arrays["time"])
    return sorted({*range(0, count, max(1, count // ROWS)), count - 1})


@cache
def sole_in_link(model: str, foot: str) -> tuple[str, pin.SE3, np.ndarray]:
    """Return a foot's link, its sole's placement there and its corners; the only thing believed."""
    robot = Robot.load(model)
    s = robot.snapshot(robot.posture("neutral"))
    link, sole = robot.feet[foot].link, robot.feet[foot].frame
    poses = [pin.SE3(s.rotation(f), s.position(f)) for f in (link, sole)]
    return link, poses[0].actInv(poses[1]), robot.feet[foot].polygon


def soles(name: str, body: Body, support: str) -> list[tuple[pin.SE3, np.ndarray]]:
    found = []
    for foot in support.split(","):
        link, offset, polygon = sole_in_link(model_of(name), foot)
        found.append((body.data.oMf[body.model.getFrameId(link)] * offset, polygon))
    return found


def entries_of(inertia: np.ndarray) -> np.ndarray:
    """Return xx xy xz yy yz zz of a symmetric matrix."""
    return inertia[[0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]


def margin_in_hull(points: np.ndarray, where: np.ndarray) -> float:
    equations = ConvexHull(points).equations
    return float(-(equations[:, :2] @ where + equations[:, 2]).max())


# ------------------------------------------------------------------------- robots that are moved


def test_every_problem_is_checked_here() -> None:
    assert {*PENDULUMS, *SIMULATED, *MOVED} == {path.stem for path in PROBLEMS.glob("*.yaml")}
    assert len(MOVED) >= 17 and len(SIMULATED) >= 3 and len(PENDULUMS) >= 13


@pytest.mark.slow
@pytest.mark.parametrize("name", MOVED)
def test_moved_robots_do_what_their_results_say(name: str) -> None:
    """One test a problem: each is run once, whichever worker has it."""
    said = outcome(name)
    check_com_inertia_and_motion_by_pinocchio(*said)
    check_joints_stay_within_what_the_urdf_allows(*said)
    if TEXTS[name]["support"] != "floating":
        check_feet_stand_still_and_the_com_is_over_them(name, *said)
    if "constraints" in TEXTS[name]:
        check_margins_are_kept_by_raw_shapes(name, *said)


def check_com_inertia_and_motion_by_pinocchio(
    summary: dict[str, Any], arrays: dict[str, np.ndarray], body: Body
) -> None:
    dt = float(arrays["time"][1] - arrays["time"][0])
    for k in rows_of(arrays):
        body.place(arrays["q"][k])
        np.testing.assert_allclose(arrays["com"][k], body.data.com[0], atol=1e-9)
        inertia = np.asarray(body.data.Ig.inertia)
        np.testing.assert_allclose(arrays["inertia"][k], entries_of(inertia), atol=1e-9)
        if k + 1 < len(arrays["time"]):
            moved = pin.integrate(body.model, body.q(arrays["q"][k]), dt * body.v(arrays["v"][k]))
            np.testing.assert_allclose(moved, body.q(arrays["q"][k + 1]), atol=1e-9)
    body.place(np.array(summary["final"]["q"]))
    np.testing.assert_allclose(summary["final"]["com"], body.data.com[0], atol=1e-9)
    inertia = np.asarray(body.data.Ig.inertia)
    np.testing.assert_allclose(summary["final"]["inertia_world"], entries_of(inertia), atol=1e-9)
    R = body.data.oMi[1].rotation
    for reading in summary["inertia"].values():
        inertia = np.asarray(body.data.Ig.inertia)
        if reading["axes"] == "base":
            inertia = R.T @ inertia @ R
        reached = [
            inertia["xyz".index(row), "xyz".index(column)] for row, column in reading["components"]
        ]
        np.testing.assert_allclose(reading["reached"], reached, atol=1e-9)


def check_joints_stay_within_what_the_urdf_allows(
    summary: dict[str, Any], arrays: dict[str, np.ndarray], body: Body
) -> None:
    limits = body.limits()
    ranges = np.array(
        [[limits[str(j)][k] for k in ("lower", "upper")] for j in arrays["joint_names"]]
    )
    speeds = np.array([limits[str(joint)]["velocity"] for joint in arrays["joint_names"]])
    q = np.vstack((arrays["q"], summary["final"]["q"]))[:, 7:]
    left = np.minimum(q - ranges[:, 0], ranges[:, 1] - q)
    assert left.min() > -1e-6  # rad
    assert (np.abs(arrays["v"][:, 6:]) <= speeds + 1e-6).all()
    assert summary["joint_limits"]["smallest_margin"] == pytest.approx(left.min(), abs=1e-9)


def check_feet_stand_still_and_the_com_is_over_them(
    name: str, summary: dict[str, Any], arrays: dict[str, np.ndarray], body: Body
) -> None:
    anchors: dict[str, pin.SE3] = {}
    worst, stood = 0.0, ""
    for k in range(len(arrays["time"])):
        support = str(arrays["support"][k])
        if support != stood:  # feet that go on standing keep their place
            anchors = {foot: anchors[foot] for foot in support.split(",") if foot in anchors}
            stood = support
        elif k % max(1, len(arrays["time"]) // ROWS):
            continue
        body.place(arrays["q"][k])
        here = soles(name, body, support)
        for foot, (pose, _) in zip(support.split(","), here, strict=True):
            anchor = anchors.setdefault(foot, pose.copy())
            worst = max(worst, float(np.linalg.norm(pose.translation - anchor.translation)))
        corners = [pose.act(np.append(c, 0.0))[:2] for pose, polygon in here for c in polygon]
        margin = margin_in_hull(np.array(corners), np.array(body.data.com[0][:2]))
        assert arrays["balance"][k] == pytest.approx(margin, abs=1e-6)
    assert worst < 1e-3  # m
    assert summary["slip"]["largest"] >= worst - 1e-6


def check_margins_are_kept_by_raw_shapes(
    name: str, summary: dict[str, Any], arrays: dict[str, np.ndarray], body: Body
) -> None:
    """Watched pairs of links, measured by Coal where the result says that they were nearest."""
    folders = [str(parent) for parent in body.path.parents]
    shapes = pin.buildGeomFromUrdf(
        body.model, str(body.path), pin.GeometryType.COLLISION, package_dirs=folders
    )
    by_link: dict[str, list[Any]] = {}
    for shape in shapes.geometryObjects:
        by_link.setdefault(body.model.frames[shape.parentFrame].name, []).append(shape)

    def placed(link: str) -> list[tuple[Any, coal.Transform3s]]:
        poses = [(s, body.data.oMi[s.parentJoint] * s.placement) for s in by_link[link]]
        return [(s.geometry, coal.Transform3s(p.rotation, p.translation)) for s, p in poses]

    for constraint, spec in TEXTS[name]["constraints"].items():
        for k in rows_of(arrays)[::5]:
            left, where = (
                arrays[f"clearance/{constraint}"][k],
                str(arrays[f"nearest/{constraint}"][k]),
            )
            assert left > -1e-6  # m
            body.place(arrays["q"][k])
            if spec["type"] == "self_collision":
                first, second = (
                    part.partition("#")[0].partition("/")[0] for part in where.split(" vs ")
                )
                apart = min(
                    coal.distance(*a, *b, coal.DistanceRequest(), coal.DistanceResult())
                    for a in placed(first)
                    for b in placed(second)
                )
                # its shapes are around the raw ones; a pair that stands nearer keeps half of that
                assert apart > min(spec["margin"], 0.5 * apart) + left - 1e-6
                assert apart > left + 2e-4
            elif spec["type"] == "obstacles":
                wall = spec["things"]["wall"]
                normal, origin = (np.array(wall[key], float) for key in ("half_space", "position"))
                away = 1e9
                for link in by_link:
                    if any(fnmatch(link, pattern) for pattern in spec["links"]):
                        for geometry, at in placed(link):
                            box = coal.Halfspace(normal, float(normal @ origin))
                            away = min(
                                away,
                                coal.distance(
                                    geometry, at, box, coal.Transform3s(),
                                    coal.DistanceRequest(), coal.DistanceResult(),
                                ),
                            )  # fmt: skip
                assert away > spec["margin"] + left - 1e-6
            elif spec["type"] == "box":
                z = body.data.oMf[body.model.getFrameId(spec["frame"])].translation[2]
                assert left == pytest.approx(z - spec["lower"][2], abs=1e-6)
            else:  # its region stays where the soles were at the start
                slip = summary["slip"]["largest"]
                balance = arrays["balance"][k] - spec["margin"]
                assert left == pytest.approx(balance, abs=1e-6 + slip)


# -------------------------------------------------------------------- robots that are simulated


@pytest.mark.slow
@pytest.mark.parametrize("name", SIMULATED)
def test_simulated_robots_obey_their_motors_the_ground_and_gravity(name: str) -> None:
    summary, arrays, body = outcome(name)
    limits = body.limits()
    effort = np.array([limits[str(joint)]["effort"] for joint in arrays["joint_names"]])
    assert (np.abs(arrays["torque"]) <= effort * (1.0 + 1e-9)).all()
    assert summary["simulation"]["stood"] is True
    ground = TEXTS[name]["simulation"].get("terrain", {}).get("slope", [0.0, 0.0])
    stands = name.startswith(("stand", "push", "track")) and TEXTS[name]["support"] == "double"
    mass = sum(inertia.mass for inertia in body.model.inertias)
    assert summary["mass"] == pytest.approx(mass, rel=1e-9)
    for k in rows_of(arrays):
        body.place(arrays["q"][k])
        corners = np.array(
            [
                pose.act(np.append(corner, 0.0))
                for pose, polygon in soles(name, body, "left,right")
                for corner in polygon
            ]
        )
        heights = corners[:, 2] - corners[:, :2] @ np.array(ground)
        assert heights.min() > -SUNK
        assert not stands or heights.max() < SUNK
        cop, loaded = arrays["cop"][k], corners[heights < SUNK]
        if np.isfinite(cop).all() and len(loaded) > 2:
            assert margin_in_hull(loaded[:, :2], cop[:2]) > -SUNK
    if stands:  # over a while the ground carries the weight and pushes the rest
        forces = sum(arrays[key] for key in arrays if key.startswith("forces/"))
        held = forces[len(forces) // 2 :, 2].mean()
        assert 0.7 < held / (9.81 * mass) < 1.3


# ----------------------------------------------------------------------------------- pendulums


@pytest.mark.slow
@pytest.mark.parametrize("name", PENDULUMS)
def test_pendulums_obey_newton_and_their_bounds(name: str) -> None:
    """CoM against its velocity, force against its change: trapezoids and differences."""
    text = TEXTS[name]
    result = load_problem(PROBLEMS / f"{name}.yaml").run()
    if "law" in text:
        assert result.status is PendulumStatus.COMPLETED, result.reason
        accepted = text["stop"]["accept"]
        assert all(result.measures[key] <= tolerance for key, tolerance in accepted.items())
        # The QP's own accuracy, in N m.
        margins = {key: room for key, room in result.measures.items() if key[:6] == "margin"}
        assert all(room > -1e-6 for room in margins.values()), margins
    else:
        assert result.status is PendulumStatus.PLANNED, result.reason
        assert result.measures["largest defect"] < 1e-6
        assert result.measures["largest violation"] < 1e-6
        assert result.measures["momentum drift in flight"] < 1e-8
    h = result.history
    steps = np.diff(h.time)[:, None]
    mean = 0.5 * (h.com_velocity[1:] + h.com_velocity[:-1])
    jumps = np.abs(np.diff(h.com, axis=0) - steps * mean)
    pushed = [push["time"] for push in text.get("pushes", ())]
    jumps = jumps[
        [not any(abs(t - h.time[:-1][k]) < 0.01 for t in pushed) for k in range(len(jumps))]
    ]
    # the rule's error is step^3 c'''/12, and the CoM's jerk is below 500 m/s^3
    assert jumps.max() < 500.0 * float(steps.max()) ** 3 / 12.0 + 1e-9
    assert np.isfinite(h.radii).all() and (h.radii[:, 0] > 0.0).all()
    for R in h.axes[:: max(1, len(h.axes) // ROWS)]:
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-8)
    for support in h.supports:
        inside = (h.time >= support.start) & (h.time <= support.end) & np.isfinite(h.cop[:, 0])
        corners = np.asarray(support.polygon)
        for cop in h.cop[inside][:: max(1, int(inside.sum()) // ROWS)]:
            if len(corners) > 2:
                assert margin_in_hull(corners, cop[:2]) > -1e-6
            else:
                low, high = sorted(corners[:, 0])
                assert low - 1e-6 <= cop[0] <= high + 1e-6
