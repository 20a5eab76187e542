"""Wrong targets, weights and names are refused in words; laws keep what they promise."""

import re
from collections.abc import Callable

import numpy as np
import pytest

from wbc.constraints import Contact
from wbc.controllers import KinematicController
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.laws import AccelerationLaw, Residual, VelocityLaw
from wbc.robot import Robot
from wbc.tasks import (
    AxisTask,
    ComTask,
    ContactForceTask,
    DampingTask,
    DistanceTask,
    ForceRateTask,
    InertiaTask,
    MomentumTask,
    OrientationTask,
    PoseTask,
    PositionTask,
    PostureTask,
    PrincipalInertiaTask,
    RelativePoseTask,
    Task,
    TorqueTask,
)

NAN = float("nan")
WRONG: dict[str, tuple[Callable[[Robot], object], str]] = {
    "com size": (lambda r: ComTask(r, [0, 1]), r"target: expected shape \(3,\), got \(2,\)"),
    "weight of one row": (lambda r: ComTask(r, [0, 0, 1], weight=[1, -1, 1]), "must not be neg"),
    "axis short": (lambda r: AxisTask(r, "base", [0, 0.9e-9, 0]), "needs some length"),
    "weight size": (lambda r: ComTask(r, [0, 0, 1], weight=[1, 2]), "weight: expected shape"),
    "damping": (lambda r: ComTask(r, [0, 0, 1], lm_damping=-1), "lm_damping: must be at least"),
    "rate": (lambda r: ComTask(r, [0, 0, 1]).set_target([0, 0, 1], [NAN, 0, 0]), "target rate"),
    "inertia shape": (lambda r: InertiaTask(r, [1, 2]), "expected a symmetric .* got shape"),
    "inertia": (lambda r: InertiaTask(r, np.arange(9.0).reshape(3, 3)), "symmetric"),
    "inertia below 0": (lambda r: InertiaTask(r, -np.eye(3)), "xx is negative"),
    "inertia set below 0": (
        lambda r: InertiaTask(r, np.eye(3)).set_target(np.diag([1.0, -1.0, 1.0])),
        "yy is negative",
    ),
    "moment below 0": (lambda r: PrincipalInertiaTask(r, [1, -2, 1]), "-2 is negative"),
    "trace below 0": (lambda r: InertiaTask(r, -1.0, components="trace"), "trace is negative"),
    "inertia three": (lambda r: InertiaTask(r, [1, 2, 3]), "only those are controlled"),
    "rotation": (lambda r: OrientationTask(r, "base", 2 * np.eye(3)), "not a rotation matrix"),
    "mirror": (lambda r: OrientationTask(r, "base", -np.eye(3)), "not a rotation matrix"),
    "axis": (lambda r: AxisTask(r, "base", [0, 0, 0]), "needs some length"),
    "posture size": (lambda r: PostureTask(r, np.zeros(3)), "shape"),
    "posture zero": (lambda r: PostureTask(r, r.posture(), joints={"*": 0}), "leave the task out"),
}
UNKNOWN: dict[str, tuple[Callable[[Robot], object], str]] = {
    "axes": (lambda r: ComTask(r, [0, 0, 0], axes=("x", "w")), "unknown axis 'w'"),
    "frame": (lambda r: PositionTask(r, "left_sol", [0, 0, 0]), "did you mean 'left_sole'"),
    "inertia frame": (lambda r: InertiaTask(r, np.eye(3), frame="torsso"), "did you mean 'torso'"),
    "component": (lambda r: InertiaTask(r, np.eye(3), components=("xx", "zx")), "component 'zx'"),
    "momentum component": (lambda r: MomentumTask(r, components=("kw",)), "unknown momentum"),
    "joint": (lambda r: PostureTask(r, r.posture(), joints={"left_kneee*": 1}), "unknown joint"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_values(case: str, hoap2: Robot) -> None:
    make, words = WRONG[case]
    with pytest.raises(InvalidInputError, match=words):
        make(hoap2)


@pytest.mark.parametrize("case", UNKNOWN)
def test_unknown_names(case: str, hoap2: Robot) -> None:
    make, words = UNKNOWN[case]
    with pytest.raises(UnknownNameError, match=re.escape(words)):
        make(hoap2)


def test_a_refused_target_leaves_the_old_one(hoap2: Robot) -> None:
    task = ComTask(hoap2, [0.0, 0.0, 0.3])
    with pytest.raises(InvalidInputError):
        task.set_target([NAN, 0, 0])
    assert task.target.tolist() == [0.0, 0.0, 0.3]


def test_misspelt_keywords_are_refused(hoap2: Robot) -> None:
    for make in (ComTask, InertiaTask, MomentumTask, PrincipalInertiaTask):
        with pytest.raises(UnknownNameError, match="'gian'; did you mean 'gain'"):
            make(hoap2, np.ones(6 if make is MomentumTask else 3), gian=0.3)
    with pytest.raises(UnknownNameError, match="'axis'; did you mean 'axes'"):
        PositionTask(hoap2, "left_sole", [0, 0, 0], axis=["x"])
    with pytest.raises(UnknownNameError, match="'position_cost'; did you mean 'weight'"):
        ComTask(hoap2, np.ones(3), position_cost=1.0)
    # Points have axes, other quantities components: 'axes' was taken for 'name'.
    with pytest.raises(UnknownNameError, match="'axes'; did you mean 'components'"):
        MomentumTask(hoap2, axes=["kx"])
    with pytest.raises(UnknownNameError, match="'components'; did you mean 'axes'"):
        ComTask(hoap2, np.ones(3), components=["x"])


def test_assigning_is_setting_with_its_checks(hoap2: Robot) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"))
    posture, shape = PostureTask(hoap2, here.q), InertiaTask(hoap2, here.inertia)
    posture.target = hoap2.posture("neutral")
    shape.target = 2 * here.inertia
    assert np.abs(posture.residual(here).error).max() > 0.1
    assert np.abs(shape.residual(here).error).max() > 0.01
    with pytest.raises(InvalidInputError, match="gain: 5 is above 1"):
        shape.gain = 5.0
    with pytest.raises(InvalidInputError, match="gain: must be greater than 0, got 0"):
        shape.law = VelocityLaw(gain=0.0)
    with pytest.raises(InvalidInputError, match="NaN"):
        shape.target = np.full((3, 3), NAN)
    shape.weight = 2.0
    assert shape.weight.tolist() == [2.0] * 6
    with pytest.raises(InvalidInputError, match="no row given"):
        ComTask(hoap2, [0, 0, 1], axes=())
    with pytest.raises(InvalidInputError, match="expected numbers"):
        ComTask(hoap2, [10**400, 0, 0])
    com = ComTask(hoap2, [0, 0, 1])
    with pytest.raises(InvalidInputError):
        com.set_target([0, 0, 2], [0.9, 0, 0], [NAN, 0, 0])
    assert com.target_rate.tolist() == [0, 0, 0]


def test_a_misspelt_attribute_is_an_error(hoap2: Robot) -> None:
    task = ComTask(hoap2, np.zeros(3))
    with pytest.raises(InvalidInputError, match=r"no attribute 'wieght'; did you mean 'weight'\?$"):
        task.wieght = 5.0
    with pytest.raises(InvalidInputError, match=r"kp: is of its law: acceleration_law = wbc"):
        task.kp = 30.0
    with pytest.raises(InvalidInputError, match=r"no attribute 'cost'; did you mean 'weight'\?$"):
        task.cost = 5.0
    task.weight = 5.0
    assert (task.weight == 5.0).all()


def test_units_are_those_of_the_rows(hoap2: Robot) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"))
    eye, zero = np.eye(3), np.zeros(3)
    place, turn = ("m",) * 3, ("rad",) * 3
    said = {
        ComTask(hoap2, here.com): place,
        PositionTask(hoap2, "left_palm", zero): place,
        OrientationTask(hoap2, "left_palm", eye): turn,
        AxisTask(hoap2, "left_palm", eye[2]): ("1",) * 3,
        PoseTask(hoap2, "left_palm", zero, eye): (*place, *turn),
        RelativePoseTask(hoap2, "left_palm", "right_palm", zero, eye): (*place, *turn),
        DistanceTask(hoap2, "left_palm", "right_palm", 0.1): ("m",),
        InertiaTask(hoap2, here.inertia, components=["xx", "yz"]): ("kg m^2",) * 2,
        PrincipalInertiaTask(hoap2, np.linalg.eigvalsh(here.inertia)): None,
        PostureTask(hoap2, here.q, joints={"*": 1e-6}): ("rad",) * (hoap2.nv - 6),
    }
    for task, units in said.items():
        assert units is None or task.units == units, task
        assert len(task.units) == len(task.deviation(here, task.residual(here)))


ASSIGNED: dict[str, tuple[str, object, str]] = {
    "law": ("law", 0.5, r"law: expected VelocityLaw, got 0\.5"),
    "other level's law": ("law", AccelerationLaw(), "law: expected VelocityLaw"),
    "acceleration law": ("acceleration_law", None, "expected AccelerationLaw, got None"),
    "rate alone": ("target_rate", np.ones(6), "goes with the target: set_target"),
    "acceleration alone": ("target_acceleration", np.ones(6), "goes with the target"),
    "place nan": ("position", [0, NAN, 0], "position: NaN or infinite"),
    "place size": ("position", [0, 0], r"position: expected shape \(3,\)"),
    "mirror": ("rotation", -np.eye(3), "not a rotation matrix"),
}


@pytest.mark.parametrize("case", ASSIGNED)
def test_what_is_assigned_is_checked_as_what_is_given(robot: Robot, case: str) -> None:
    name, value, said = ASSIGNED[case]
    here = robot.snapshot(robot.posture())
    held = Contact.hold(here, "base")
    pose = PoseTask(robot, "base", held.position, held.rotation)
    for task in (pose, held) if "target" not in name else (pose,):
        before = getattr(task, name)
        with pytest.raises(InvalidInputError, match=said):
            setattr(task, name, value)
        assert getattr(task, name) is before


def test_half_a_placement_is_assigned_and_the_other_half_stays(robot: Robot) -> None:
    here = robot.snapshot(robot.posture())
    held = Contact.hold(here, "base")
    pose = PoseTask(robot, "base", held.position, held.rotation)
    pose.set_target(held.position, held.rotation, np.ones(6))
    moved, turned = held.position + (0.0, 0.0, 0.1), held.rotation @ np.diag([-1.0, -1.0, 1.0])
    for task in (pose, held):
        task.position = moved.tolist()
        np.testing.assert_array_equal(task.residual(here).error[:3], here.position("base") - moved)
        task.rotation = turned
        np.testing.assert_array_equal(task.rotation, turned)
    np.testing.assert_array_equal(pose.target[:3], np.column_stack((turned, moved)))
    assert not pose.target_rate.any()  # as when the whole target is assigned


WRENCH, EYE = [0.0] * 6, np.eye(3)
KINDS: dict[type[Task], dict[str, object]] = {
    PostureTask: {"target": [0.0]},
    PositionTask: {"frame": "base", "target": [0.0, 0.0, 1.0]},
    ComTask: {"target": [0.0, 0.0, 1.0]},
    DampingTask: {},
    TorqueTask: {},
    ForceRateTask: {},
    ContactForceTask: {"frame": "left_sole", "target": WRENCH},
    Contact: {"frame": "left_sole", "position": [0.0, 0.0, 1.0], "rotation": EYE},
}


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_task_of_no_robot_is_an_error_that_shows_what_was_given(kind, named) -> None:
    """The robot's name is, not what comes after it; the task is named by its kind."""
    said = f"{kind.__name__}: expected a robot as Robot.load() returns it, got 'g1'"
    make: Callable[..., Task] = kind
    with pytest.raises(InvalidInputError, match=re.escape(said)):
        if named:
            make(robot="g1", **KINDS[kind])
        else:
            make("g1", *KINDS[kind].values())


class OwnTask(ComTask):
    """Keeps something of its own, in attributes that no class declares."""

    def __init__(self, robot: Robot) -> None:
        self.early = "before Task is made"
        super().__init__(robot, [0.0, 0.0, 1.0])
        self.late = "after it"


def test_attribute_of_a_users_own_class_can_be_assigned(robot: Robot) -> None:
    task = OwnTask(robot)
    task.later = "from outside"
    kept = task.early, task.late, task.later
    assert kept == ("before Task is made", "after it", "from outside")
    with pytest.raises(InvalidInputError, match="gain: 5 is above 1"):
        task.gain = 5.0  # checked as ever


def test_a_short_direction_is_one(robot: Robot) -> None:
    """A nanometre is the least that is taken."""
    np.testing.assert_allclose(AxisTask(robot, "base", [0, 0, 1e-9]).target, [0, 0, 1])


def test_velocity_law_removes_the_gain_in_one_tick(robot, rng, random_snapshot) -> None:
    here = random_snapshot(robot, rng)
    task = ComTask(robot, here.com + [0.01, -0.02, 0.03], gain=0.25)
    dt = 1e-4
    v = KinematicController(robot, [task], contacts=(), dt=dt).step(here).velocity
    there = robot.snapshot(robot.integrate(here.q, v, dt))
    before, after = task.residual(here).error, task.residual(there).error
    np.testing.assert_allclose(after, 0.75 * before, atol=2e-3 * np.abs(before).max())


def test_velocity_law_follows_a_moving_target(robot, rng, random_snapshot) -> None:
    here = random_snapshot(robot, rng)
    task = ComTask(robot, here.com)
    rate = np.array([0.1, 0.2, -0.3])
    task.set_target(here.com, rate)
    v = KinematicController(robot, [task], contacts=()).step(here).velocity
    np.testing.assert_allclose(here.com_jacobian @ v, rate, rtol=1e-4)  # the damping is 1e-6


@pytest.mark.parametrize("kd", [None, 5.0])
def test_momentum_decays_by_kd_to_a_target_that_moves(hoap2, rng, kd: float | None) -> None:
    """Oracle: h - h* = (h - h*)(0) exp(-kd t), with h*' = force, whatever the joints do."""
    q, v = hoap2.posture("standing"), 0.3 * rng.normal(size=hoap2.nv)
    force, dt, steps = np.array([2.0, -1.0, 3.0, 0.1, 0.2, -0.3]), 5e-5, 1000
    task = MomentumTask(hoap2, np.zeros(6), kd=kd)
    start = hoap2.snapshot(q, v).momentum
    for k in range(steps):
        task.set_target(k * dt * force, force)
        here = hoap2.snapshot(q, v)
        residual = task.residual(here)
        slowing = -task.acceleration_law.velocity_gain * residual.rate(v) - task.drift(here)
        v = v + np.linalg.pinv(residual.jacobian) @ (dt * slowing)
        q = hoap2.integrate(q, v, dt)
    task.set_target(steps * dt * force, force)
    here = hoap2.snapshot(q, v)
    expected = start * np.exp(-(20.0 if kd is None else kd) * steps * dt)
    # Euler steps: kd dt / 2 of the whole decay in proportion, 5e-4 for 20/s, and the drift's own.
    found = task.deviation(here, task.residual(here))
    np.testing.assert_allclose(found, expected, rtol=0, atol=3e-3 * np.abs(start).max())


def test_capture_point_law_moves_the_capture_point_exponentially() -> None:
    """Oracle: c'' = w^2 (c - xi - k e_xi) integrated in closed form by its two real modes."""
    height, gain, gravity = 0.7, 2.5, 9.81
    law = AccelerationLaw.capture_point(height, gain, gravity)
    omega = np.sqrt(gravity / height)
    assert law.kd is not None
    modes = np.roots([1.0, law.kd, law.kp])
    np.testing.assert_allclose(np.sort(modes), [-gain * omega, -omega], rtol=1e-12)
    for error, rate in np.random.default_rng(3).normal(size=(5, 2)):
        wanted = -law.kp * error - law.kd * rate
        point = error + rate / omega  # of the capture point, from the target
        pivot = point + gain * point
        np.testing.assert_allclose(wanted, omega**2 * (error - pivot), rtol=1e-12)
    with pytest.raises(InvalidInputError, match="capture point, height"):
        AccelerationLaw.capture_point(0.0)


def test_what_acts_on_errors_is_refused_by_tasks_without(hoap2) -> None:
    for key in ("gain", "gain_per_second", "lm_damping", "curvature_damping", "weighs_error", "kp"):
        for kind in (MomentumTask, DampingTask):
            with pytest.raises(InvalidInputError, match=f"{key}: has no effect.*give kd"):
                kind(hoap2, **{key: 1.0})
    task = MomentumTask(hoap2, kd=3.0)
    with pytest.raises(InvalidInputError, match="gain: has no effect"):
        task.gain = 0.3
    assert task.acceleration_law == AccelerationLaw(kd=3.0)


class Fixed(Task):
    """Two joints, with an error and a curvature that are given."""

    def residual(self, snapshot):
        J = np.eye(2, self.robot.nv, 6)
        return Residual(np.array([3.0, 4.0]), J, np.zeros(2), curvature_bound=3.0)


@pytest.mark.parametrize(
    ("law", "added"),
    [
        ({"gain": 1.0}, 1.5),
        ({"gain": 0.5}, 0.75),
        ({"gain": 1.0, "curvature_damping": False}, 0.0),  # the plain step of eq. 38
        ({"gain": 1.0, "curvature_damping": False, "lm_damping": 0.1}, 1.0),
    ],
)
def test_damping_is_that_of_curvature_and_weighted_error(robot, law, added: float) -> None:
    """0.5 gain times the curvature's bound 3; lm_damping times |2 (3, 4)|."""
    task = Fixed(robot, "fixed", ("a", "b"), weight=2.0, **law)
    controller = KinematicController(robot, [task], contacts=(), damping=1e-6)
    diagonal = controller.step(robot.snapshot(robot.posture("standing"))).qp.P[8, 8]
    assert diagonal == pytest.approx(added + 1e-6, abs=1e-12)


def test_a_pose_is_damped_by_the_error_of_all_its_rows(robot) -> None:
    """It is two blocks to the core: place, and turn."""
    here = robot.snapshot(robot.posture("standing"))
    turned = np.diag([1.0, -1.0, -1.0]) @ here.rotation("base")
    task = PoseTask(robot, "base", here.position("base") + [0.1, 0.0, 0.0], turned, lm_damping=0.1)
    qp = KinematicController(robot, [task], contacts=(), damping=1e-6).step(here).qp
    added = 0.1 * np.linalg.norm(task.residual(here).error)
    np.testing.assert_allclose(np.diag(qp.P)[6:], added + 1e-6, rtol=1e-9)


def test_laws_are_checked_where_they_are_given(robot) -> None:
    for bad in ({"gain": 0.0}, {"gain": 1.5}, {"gain_per_second": 0.0}, {"kp": -1.0}):
        (name,) = bad
        with pytest.raises(InvalidInputError, match=f"task 'com', {name}"):
            ComTask(robot, np.zeros(3), **bad)
    with pytest.raises(InvalidInputError, match="gain or gain_per_second, not both"):
        ComTask(robot, np.zeros(3), gain=0.5, gain_per_second=3.0)
    task = ComTask(robot, np.zeros(3), gain_per_second=3.0, kp=50.0)
    task.gain = 0.25
    assert task.law == VelocityLaw(0.25)
    assert task.acceleration_law == AccelerationLaw(50.0)
    here = robot.snapshot(robot.posture())
    assert Contact.hold(here, "base").acceleration_law == AccelerationLaw(100.0)
