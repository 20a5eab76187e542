"""What a caller gets wrong in Python is a WbcError that says what was meant, in every room."""

import logging
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from wbc import (
    Contact,
    KinematicController,
    Limits,
    PoseTask,
    Robot,
    SelfCollision,
    TorqueController,
    WbcError,
    analyze,
    reduce,
    support,
)
from wbc.constraints import Constraint, Obstacles
from wbc.constraints.rows import Bounds
from wbc.gait import Walker
from wbc.problem import load_problem
from wbc.qp.backend import make_backend
from wbc.robot import Snapshot
from wbc.robot.collision import Obstacle
from wbc.tasks import (
    ComTask,
    DampingTask,
    InertiaTask,
    MomentumTask,
    PostureTask,
    RelativePoseTask,
    Task,
)


class Nothing(Constraint):
    """No rows; without a robot or a name unless they are given."""

    def __init__(self, **attributes: Any) -> None:
        for name, value in attributes.items():
            setattr(self, name, value)

    def rows(self, snapshot: Snapshot, dt: float) -> Bounds:
        empty = np.zeros(0)
        return Bounds((), np.zeros((0, snapshot.robot.nv)), empty, empty)


class Unmade(Task):
    """Forgets to call Task.__init__."""

    def __init__(self, **attributes: Any) -> None:
        self.name = "unmade"
        vars(self).update(attributes)

    def residual(self, snapshot: Snapshot) -> Any:
        return None


def controller(robot: Robot, **keywords: Any) -> KinematicController:
    tasks = keywords.pop("tasks", None) or [ComTask(robot, np.zeros(3))]
    return KinematicController(robot, tasks, **{"contacts": ()} | keywords)


def two_hands(robot: Robot, **keywords: Any) -> RelativePoseTask:
    hands = "left_hand", "right_hand"
    return RelativePoseTask(robot, *hands, np.zeros(3), np.eye(3), **keywords)


CASES: dict[str, tuple[Callable[[Robot], Any], str]] = {
    "a walker's posture for its gait": (lambda r: Walker(r, r.posture()), "gait: expected {name"),
    "weights of joints": (lambda r: PostureTask(r, r.posture(), weight=np.ones(25)), "weighs them"),
    "weights by name": (lambda r: PostureTask(r, r.posture(), weight={"a": 1}), "weighs them"),
    "contacts at once": (
        lambda r: Contact.hold(r.snapshot(r.posture()), ["left_sole"]),
        "unknown f",
    ),
    "a robot to reduce": (reduce, "reduce: expected a snapshot"),
    "a file to analyze": (lambda r: analyze("motion.csv"), "analyze: expected a motion"),
    "a posture by joints": (lambda r: r.posture({"head_yaw": 0.1}), "unknown posture {'head_yaw"),
    "joints for a posture's name": (
        lambda r: r.posture({"head_yaw": 0.1}),
        r"name comes first, then joints: posture\('standing', {joint: value}\)$",
    ),
    "a configuration for a posture's name": (
        lambda r: r.posture(r.posture()),
        r"^unknown posture array\([^\n]+\.\.\.; its name comes first",
    ),
    "one link": (lambda r: SelfCollision(r, include=["a"]), "include: expected a list of two"),
    "a number": (lambda r: SelfCollision(r, include=3), "include: expected a list of two"),
    "one of a pair": (lambda r: SelfCollision(r, exclude=[("x",)]), "exclude: expected.*'x',"),
    "three of a pair": (lambda r: SelfCollision(r, exclude=[("a", "b", "c")]), "exclude: exp"),
    "a pair itself": (lambda r: SelfCollision(r, exclude=("a", "b")), "exclude: expected"),
    "no word in a pair": (lambda r: SelfCollision(r, exclude=[("left*", 3)]), "unknown link 3"),
    "a model and pairs": (
        lambda r: SelfCollision(r, model=SelfCollision(r).model, exclude=[("a", "b")]),
        "leave out include",
    ),
    "inertia components": (lambda r: InertiaTask(r, np.eye(3), components=3), "components: exp"),
    "components twice": (
        lambda r: InertiaTask(r, np.eye(3), components=("xx", "xx")),
        "components: 'xx' is named twice",
    ),
    "a component of none": (lambda r: InertiaTask(r, 1.0, components=("xx", 3)), "names, got 3"),
    "momentum components": (lambda r: MomentumTask(r, components=3), "components: expected"),
    "pose components": (lambda r: two_hands(r, components=3), "components: expected"),
    "axes": (lambda r: ComTask(r, np.zeros(3), axes=3), "axes of a point: expected"),
    "axes as a word": (lambda r: ComTask(r, np.zeros(3), axes="xz"), "unknown axis 'xz'"),
    "a posture's joints": (lambda r: r.posture(joints="x"), "joints: expected {name: value}"),
    "joints as a list": (lambda r: r.posture(joints=["x"]), "joints: expected {name: value}"),
    "a joint without name": (lambda r: r.posture(joints={3: 1.0}), "names as keys, got 3"),
    "joints of a task": (
        lambda r: PostureTask(r, r.posture(), joints="x"),
        "task 'posture', joints: expected {name: value}",
    ),
    "joints to damp": (lambda r: DampingTask(r, joints=["x"]), "'damping', joints: expected"),
    "joint indices": (lambda r: r.joint_indices(3), "unknown joint 3"),
    "a frame": (lambda r: r.frame_id(["a"]), "unknown frame"),
    "locked": (lambda r: Robot.load("hoap2_like", locked="x"), "locked: expected {name"),
    "feet": (lambda r: Robot.load("hoap2_like", feet="x"), "feet: expected {name: value}"),
    "folders": (lambda r: Robot.load("hoap2_like", package_dirs=3), "package_dirs: expected"),
    "a solver": (lambda r: controller(r, solver=3), "solver: expected a name such as 'proxqp'"),
    "a solver's class": (
        lambda r: controller(r, solver=type(make_backend("proxqp"))),
        "solver: expected a name",
    ),
    "a task's name": (lambda r: ComTask(r, np.zeros(3), name=3), "ComTask, name: expected a word"),
    "no name": (lambda r: ComTask(r, np.zeros(3), name=""), "ComTask, name: expected a word"),
    "half a level": (lambda r: ComTask(r, np.zeros(3), priority=1.5), "1.5 is not a whole number"),
    "a file": (lambda r: load_problem(3), "load_problem: expected the path of a file, got 3"),
    "no file": (lambda r: load_problem(None), "expected the path of a file, got None"),
    "overrides": (lambda r: load_problem("x.yaml", 3), "overrides: expected {name: value}"),
    "an override": (lambda r: load_problem("x.yaml", {3: 3}), "names as keys, got 3"),
    "obstacles": (lambda r: Obstacles(r, 3), "obstacles: expected a list of Obstacle"),
    "a sphere's radius before its centre": (
        lambda r: Obstacle.sphere("ball", 0.1, (0, 0, 1)),  # type: ignore[arg-type]
        "sphere, centre",
    ),
    "no robot": (lambda r: controller(r, constraints=[Nothing()]), "a Nothing has no robot"),
    "a nameless constraint": (
        lambda r: controller(r, constraints=[Nothing(robot=r)]),
        "a Nothing has no name",
    ),
    "an unmade task": (lambda r: controller(r, tasks=[Unmade()]), "Unmade has no robot.*super"),
    "a task with a robot alone": (
        lambda r: controller(r, tasks=[Unmade(robot=r)]),
        "Unmade has no rows; write super",
    ),
    "an unmade task for torques": (
        lambda r: TorqueController(r, [Unmade()], contacts=()),
        "Unmade has no robot.*super",
    ),
    "no weight": (
        lambda r: controller(r, tasks=[ComTask(r, np.zeros(3), weight=[0, 0, 0])]),
        "task 'com' has no weight",
    ),
}


@pytest.mark.parametrize(("make", "told"), CASES.values(), ids=CASES)
def test_mistakes_are_typed_and_named(make: Callable[[Robot], Any], told: str, hoap2) -> None:
    with pytest.raises(WbcError, match=told.replace("{", re.escape("{"))):
        make(hoap2)


def test_call_that_does_not_fit_is_pythons_error_and_names_what_is_amiss(hoap2) -> None:
    foot = hoap2.foot("left").frame
    for pose in (np.eye(4), pin.SE3.Identity()):
        for kind in (PoseTask, Contact):
            with pytest.raises(TypeError, match=rf"{kind.__name__}.*missing .* 'rotation'"):
                kind(hoap2, foot, pose)
    with pytest.raises(TypeError, match=r"PostureTask.*missing 2 .* 'robot' and 'target'"):
        PostureTask(weight=1e-3)
    with pytest.raises(TypeError, match=r"SelfCollision.*takes 2 positional arguments"):
        SelfCollision(hoap2, 0.01)
    with pytest.raises(TypeError, match=r"Limits.*unexpected keyword argument 'margn'"):
        Limits(hoap2, margn=0.1)
    with pytest.raises(TypeError, match="unexpected keyword argument 'dampng'"):
        controller(hoap2, dampng=0.1)
    with pytest.raises(TypeError, match="abstract"):
        Task(hoap2, "nothing", ("x",))


def test_pose_in_place_of_a_position_is_an_error_that_says_what_of_it_to_give(hoap2) -> None:
    foot = hoap2.foot("left").frame
    task = PoseTask(hoap2, foot, *hoap2.snapshot(hoap2.posture()).placement(foot))
    with pytest.raises(WbcError, match=r"give T.translation, T.rotation, or assign target = T"):
        task.set_target(pin.SE3.Identity())


def test_a_time_step_in_milliseconds_is_noted(hoap2, caplog: pytest.LogCaptureFixture) -> None:
    tasks = [PostureTask(hoap2, hoap2.posture())]
    KinematicController(hoap2, tasks, contacts=(), dt=0.1)
    assert not caplog.records
    KinematicController(hoap2, tasks, contacts=(), dt=5)
    assert "5 ms are dt=0.005" in caplog.text


def test_a_margin_in_millimetres_is_noted(hoap2, caplog: pytest.LogCaptureFixture) -> None:
    SelfCollision(hoap2, margin=10)
    assert "margin is in metres" in caplog.text and "10 mm are margin=0.01" in caplog.text


def test_floating_has_to_be_said(hoap2, caplog: pytest.LogCaptureFixture) -> None:
    here = hoap2.snapshot(hoap2.posture())
    tasks = [ComTask(hoap2, here.com)]
    with caplog.at_level(logging.WARNING):
        for contacts in ((), support(here, "double"), support(here, "floating")):
            KinematicController(hoap2, tasks, contacts=contacts)
        assert not caplog.records
        floating = KinematicController(hoap2, tasks)
    assert "nothing holds the feet of hoap2_like, it floats" in caplog.text
    assert 'support(snapshot, "all") makes it stand' in caplog.text  # also one on four feet
    assert floating.contacts == ()


def test_nothing_floats_that_is_bolted(robot_named, caplog: pytest.LogCaptureFixture) -> None:
    bolted = Robot.load("hoap2_like", base="fixed")
    with caplog.at_level(logging.WARNING):
        caplog.clear()
        KinematicController(bolted, [PostureTask(bolted, bolted.posture())])
    assert "floats" not in caplog.text


@pytest.mark.parametrize("aloud", [True, False])
def test_a_task_may_be_switched_off_later(hoap2, caplog, aloud: bool) -> None:
    """By an assignment, which a user may not have meant, or on purpose; the CoM then is free."""
    here = hoap2.snapshot(hoap2.posture())
    com = ComTask(hoap2, here.com + (0.0, 0.0, -0.05))
    made = KinematicController(
        hoap2, [com, PostureTask(hoap2, here.q)], contacts=support(here, "double")
    )
    assert np.abs(made.step(here).velocity).max() > 0.01
    with caplog.at_level(logging.WARNING):
        if aloud:
            com.weight = 0.0
            com.weight = 0.0  # said once
        else:
            com.switch_off()
    assert caplog.text.count("'com': its weight is set to 0") == aloud
    tick = made.step(here)
    assert tick.ok
    assert np.abs(tick.velocity).max() < 1e-9  # rad/s: solver's rounding
    com.weight = 1.0
    assert np.abs(made.step(here).velocity).max() > 0.01


def test_a_constraint_with_robot_and_name_is_enough(hoap2) -> None:
    here = hoap2.snapshot(hoap2.posture())
    assert controller(hoap2, constraints=[Nothing(robot=hoap2, name="none")]).step(here).ok
