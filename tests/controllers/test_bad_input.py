"""What is no part of a controller, or no number for it, is refused by a typed error.

Of every number that is given the last value that is allowed is taken, the next one is refused.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest

from wbc import (
    AxisTask,
    BrakingParameters,
    ComSupport,
    ComTask,
    Contact,
    ContactForceTask,
    CopTask,
    DampingTask,
    DistanceTask,
    ForceRateTask,
    FrictionCone,
    InertiaTask,
    KinematicController,
    Limits,
    LoadShareTask,
    Obstacle,
    Obstacles,
    PointContact,
    PositionBox,
    PostureTask,
    Robot,
    SelfCollision,
    TiltLimit,
    TorqueController,
    TorqueTask,
    WbcError,
    support,
)
from wbc.constraints.margin import SKIN
from wbc.controllers.stance import stance_torques
from wbc.errors import InvalidInputError
from wbc.qp import make_backend

ROBOT = Robot.load("hoap2_like")
START = ROBOT.snapshot(ROBOT.posture())
HELD = support(START, "double")
CALM = PostureTask(ROBOT, START.q)
SQUARE = [[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]]
BALL = Obstacle.sphere("ball", (3.0, 0.0, 0.0), 0.1)
NO_ROBOT: Any = "hoap2_like"
OTHER = Robot.load("g1")


def made(tasks: Any = (CALM,), **parts: Any) -> KinematicController:
    return KinematicController(ROBOT, tasks, **parts)


BAD: dict[str, tuple[Callable[[], Any], str]] = {
    "a support mode": (lambda: made(contacts="double"), "list of Contact obj.*makes contacts"),
    "words": (lambda: made(constraints=["x"]), "the list has 'x'"),
    "one task": (lambda: made(CALM), "expected a list, got one"),
    "another robot of the same name": (
        lambda: made().step(Robot.load("hoap2_like").snapshot(START.q)),
        "made by the robot object that the controller was made with",
    ),
    "nothing": (lambda: made().step(None), r"expected a snapshot.*; got None$"),
    "a configuration": (lambda: made().step(START.q), r"expected a snapshot.* got array.{,60}$"),
    "a configuration and a velocity": (
        lambda: made().step(START.q, START.v),  # type: ignore[arg-type]
        r"expected a snapshot.*write robot\.snapshot\(q, v\); got array.*, array",
    ),
    "a snapshot and a time": (
        lambda: made().step(START, 0.005),  # type: ignore[arg-type]
        r"expected a snapshot.*got Snapshot\(.*\), 0\.005$",
    ),
    "contacts without their name": (
        lambda: KinematicController(ROBOT, [CALM], support(START, "double")),  # type: ignore[arg-type]
        r"all else by name, as in contacts=.*; got \(Contact",
    ),
    "friction as a number": (
        lambda: support(START, "double", friction=0.6),
        r"expected FrictionCone\(0\.6\), or None, got 0\.6",
    ),
    "slack": (lambda: made(slack="left_sole"), "expected weights by name"),
    "dt": (lambda: made(dt="0.005"), "expected a number, got '0.005'"),
    "robot": (lambda: KinematicController(NO_ROBOT, [CALM]), "expected a robot"),
    "robot of limits": (lambda: Limits(NO_ROBOT), "expected a robot"),
    "robot of bodies": (lambda: SelfCollision(NO_ROBOT), "expected a robot"),
    "robot of a box": (lambda: PositionBox.height(NO_ROBOT, 0.1), "expected a robot"),
    "pairs": (lambda: SelfCollision(ROBOT, pairs="x"), "expected a number"),  # type: ignore[arg-type]
    "one obstacle": (lambda: Obstacles(ROBOT, BALL), "a list of Obstacle"),  # type: ignore[arg-type]
    "polygon": (lambda: ComSupport(ROBOT, "abc"), "expected numbers"),  # type: ignore[arg-type]
    "support 3": (lambda: support(START, 3), "expected a mode"),  # type: ignore[arg-type]
    "a snapshot's com": (lambda: setattr(START, "com", np.zeros(3)), "cannot be assigned"),
    "quaternion": (
        lambda: ROBOT.snapshot(np.r_[START.q[:3], 1, 1, 0, 1, START.q[7:]]), "quaternion"),
    "no task": (lambda: made([]), "no task"),
    "tasks of one name": (lambda: made([CALM, CALM]), "two tasks are called 'posture'"),
    "contacts of one name": (
        lambda: made(contacts=[*HELD, *HELD]), "two contacts are called 'left_sole'"),
    "tasks of another robot": (lambda: KinematicController(OTHER, [CALM]), "another robot"),
    "limits of another robot": (lambda: made(limits=Limits(OTHER)), "another robot"),
    "a snapshot of another robot": (
        lambda: made().step(OTHER.snapshot(OTHER.posture())), "expected a snapshot of hoap2_like"),
    "a solver": (lambda: made(solver="proxpq"), "proxqp"),
    "a failure policy": (lambda: made(on_failure="panic"), "failure policy"),
    "both feet": (lambda: support(START, "both"), "support mode"),
    "slack of an unknown name": (
        lambda: made(contacts=HELD, slack={"left_soul": 1.0}), "did you mean 'left_sole'"),
    "a joint's weight": (
        lambda: made(joint_weights={"left_knee": 2.0}), "did you mean 'left_knee_pitch'"),
    "the base's weight": (lambda: made(joint_weights={"bas": 2.0}), "did you mean 'base'"),
    "weights of some": (
        lambda: made(joint_weights=np.ones(5)), rf"joint_weights: expected shape \({ROBOT.nv},\)"),
    "weight of a number": (
        lambda: made(joint_weights={3: 2.0}), "expected names of joints, got 3"),
    "weights below 0": (
        lambda: made(joint_weights=-np.ones(ROBOT.nv)), "each must be greater than 0, got -1"),
    "a tilt's frame": (lambda: TiltLimit(ROBOT, "trunk", 1.0), "trunk"),
    "a tilt's axis": (lambda: TiltLimit(ROBOT, "base", 1.0, axis=(0, 1)), "axis: expected shape"),
    "a stance of no state": (lambda: stance_torques(None, HELD), "snapshot"),  # type: ignore[arg-type]
    "a stance on one contact": (lambda: stance_torques(START, HELD[0]), "contacts"),  # type: ignore[arg-type]
    "a stance on words": (lambda: stance_torques(START, ["left_sole"]), "contacts"),  # type: ignore[list-item]
    "a stance without corners": (
        lambda: stance_torques(START, [Contact.hold(START, "left_palm")]), "corners"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_a_typed_error(name: str) -> None:
    call, words = BAD[name]
    with pytest.raises(WbcError, match=words):
        call()


def test_what_is_worked_in_is_not_assigned_in_vain() -> None:
    """It would change what the object says of itself, and not what it does."""
    limits, bodies = Limits(ROBOT), SelfCollision(ROBOT)
    over, box = ComSupport.over(START), PositionBox.height(ROBOT, 0.1)
    plain = made(limits=limits)
    bears = TorqueController(ROBOT, [CALM], contacts=HELD)
    for one, names, remedy in (
        (plain, ("tasks", "contacts", "constraints"), r"call change\(\)"),
        (plain, ("dt", "damping", "joint_weights", "backend", "limits"), "make another controller"),
        (bears, ("torque_bounds", "force_damping", "dt"), "make another controller"),
        (limits, ("lower", "upper", "base_twist"), "make other Limits"),
        (bodies, ("margin", "margins", "model"), "make another SelfCollision"),
        (Obstacles(ROBOT, [BALL]), ("obstacles", "model"), "make other Obstacles"),
        (box, ("frame", "lower", "upper"), "make another PositionBox"),
        (over, ("margin",), "make another ComSupport"),
        (over, ("corners",), r"call set_polygon\(\)"),
        (CALM, ("robot", "rows"), "make another task"),
        (InertiaTask(ROBOT, START.inertia), ("per_mass",), "make another task"),
    ):
        for name in names:
            with pytest.raises(WbcError, match=f"{name} cannot be assigned; {remedy}"):
                setattr(one, name, getattr(one, name))
    limits.acceleration = 2.0 * limits.acceleration  # followed from the next tick on
    over.set_polygon(0.9 * over.corners)
    plain.change(tasks=[CALM])


def test_limits_whose_own_box_would_not_be_asked_are_refused() -> None:
    class Slow(Limits):
        def box(self, snapshot, dt):  # type: ignore[no-untyped-def]
            return -np.ones(ROBOT.nv), np.ones(ROBOT.nv)

    for kind in (KinematicController, TorqueController):
        with pytest.raises(InvalidInputError, match=r"box\(\) of a Slow would not be asked"):
            kind(ROBOT, [CALM], contacts=HELD, limits=Slow(ROBOT))


def test_what_is_assigned_is_checked_as_what_is_given() -> None:
    calm = PostureTask(ROBOT, START.q)
    plain, bears = made([calm]), TorqueController(ROBOT, [calm], contacts=HELD)
    assigned: tuple[tuple[Any, str, Any, str], ...] = (
        (plain, "on_failure", "holt", "unknown failure policy 'holt'"),
        (bears, "on_failure", "hold", "unknown failure policy 'hold'"),
        (plain, "deadline", 0.0, "deadline: must be greater than 0"),
        (plain, "deadline", "1 ms", "deadline: expected a number"),
        (bears, "force_ramp", -0.1, "force_ramp: must be at least 0"),
        (bears, "friction_compensation", 1.1, "friction_compensation: 1.1 is above 1"),
        (calm, "singular_threshold", np.nan, "'posture', singular_threshold: must be finite"),
        (calm, "priority", -1, "priority: must be at least 0"),
        (calm, "priority", 0.5, "0.5 is not a whole number"),
        (calm, "name", 3, "name: expected a word"),
        (SelfCollision(ROBOT), "braking", "bounded", "braking: expected a BrakingParameters"),
        (PositionBox.height(ROBOT, 0.1), "braking", None, "braking: expected a BrakingParameters"),
        (SelfCollision(ROBOT), "count", -1, "pairs: must be at least 1"),
        (SelfCollision(ROBOT), "count", "x", "pairs: expected a number"),
        (SelfCollision(ROBOT), "robot", ROBOT, "robot cannot be assigned"),
        (Obstacles(ROBOT, [BALL]), "margin", -0.1, "obstacles, margin: must be at least 0"),
        (SelfCollision(ROBOT), "name", ["x"], "name: expected"),
        (AxisTask(ROBOT, "base", [0, 0, 1]), "axis", [0, 0, 0], "axis: a direction needs"),
        (InertiaTask(ROBOT, START.inertia), "second_order", 2, "second_order: expected"),
        (support(START, "double")[0], "frame", None, "frame: expected its name, got None"),
        (AxisTask(ROBOT, "base", [0, 0, 1]), "frame", "haed", "unknown frame 'haed'.*'head'"),
    )
    for one, name, value, words in assigned:
        before = getattr(one, name)
        with pytest.raises(WbcError, match=words):
            setattr(one, name, value)
        assert getattr(one, name) is before
    plain.on_failure, plain.deadline, bears.force_ramp = "damp", None, 0.0
    assert plain.step(START).ok


def test_misspelt_attributes_are_told_with_what_was_meant() -> None:
    for one, name, meant in (
        (made(), "dampng", "damping"),
        (TorqueController(ROBOT, [CALM], contacts=HELD), "torque_bound", "torque_bounds"),
        (Limits(ROBOT), "aceleration", "acceleration"),
        (SelfCollision(ROBOT), "margn", "margin"),
    ):
        with pytest.raises(WbcError, match=f"no attribute '{name}'; did you mean '{meant}'"):
            setattr(one, name, 1.0)


TINY, LITTLE = 1e-9, 1e-6

Make = Callable[[Any], Any]
kinematic = partial(KinematicController, ROBOT, [CALM], contacts=HELD)
torque = partial(TorqueController, ROBOT, [CALM], contacts=HELD)
share = partial(LoadShareTask, ROBOT)
# What makes it, which number of it, the values at the ends, and values beyond them.
RANGES: dict[str, tuple[Make, tuple[Any, ...], tuple[Any, ...]]] = {
    "dt": (lambda x: kinematic(dt=x), (LITTLE,), (0.0, -LITTLE)),
    "damping": (lambda x: kinematic(damping=x), (TINY,), (0.0,)),
    "slack of 'left_sole'": (lambda x: kinematic(slack={"left_sole": x}), (TINY,), (0.0,)),
    "joint_weights": (lambda x: kinematic(joint_weights={"*": x}), (TINY,), (0.0,)),
    "force_damping": (lambda x: torque(force_damping=x), (TINY,), (0.0,)),
    "force_ramp": (lambda x: torque(force_ramp=x), (0.0,), (-TINY,)),
    "delay": (lambda x: torque(delay=x), (0.0,), (-TINY, np.nan)),
    "spring_time": (lambda x: torque(spring_time=x), (0.0,), (-TINY,)),
    "friction_compensation": (
        lambda x: torque(friction_compensation=x), (0.0, 1.0), (-TINY, 1.0 + LITTLE),
    ),
    "torque_limits": (lambda x: torque(torque_limits=x), (LITTLE,), (0.0,)),
    "stance, torque_limits": (
        lambda x: stance_torques(START, HELD, torque_limits=x), (LITTLE,), (0.0,)),
    "contacts, ramp": (lambda x: torque().set_contacts(HELD, ramp=x), (0.0,), (-TINY,)),
    "priority": (lambda x: ComTask(ROBOT, START.com, priority=x), (0, 3), (-1, 0.5)),
    "weight": (lambda x: ComTask(ROBOT, START.com, weight=x), (0.0,), (-TINY,)),
    "'com', singular_threshold": (
        lambda x: ComTask(ROBOT, START.com, singular_threshold=x), (0.0,), (-TINY, np.nan)),
    "posture'.*weight": (lambda x: PostureTask(ROBOT, START.q, weight=x), (0.0,), (-TINY,)),
    "weight of joint": (
        lambda x: PostureTask(ROBOT, START.q, joints={"left_knee*": x}), (0.0,), (-TINY,)),
    "damping'.*weight": (lambda x: DampingTask(ROBOT, weight=x), (0.0,), (-TINY,)),
    "damping'.*joint": (
        lambda x: DampingTask(ROBOT, joints={"left_knee*": x}), (0.0,), (-TINY,)),
    "target": (
        lambda x: DistanceTask(ROBOT, "left_sole", "right_sole", x), (0.0,), (-TINY,)),
    "'torque', target": (lambda x: TorqueTask(ROBOT, x), (0.0, -5.0), (np.inf, "1")),
    "shares": (
        lambda x: share({"left_sole": x, "right_sole": 1.0}), (0.0,), (-TINY,)),
    "nor all be 0": (lambda x: share({"left_sole": x}), (TINY,), (0.0,)),
    "limits, margin": (lambda x: Limits(ROBOT, margin=x), (0.0,), (-TINY,)),
    "leaves no range for joint": (
        lambda x: Limits(ROBOT, margin=x * (ROBOT.limits.upper - ROBOT.limits.lower).min()),
        (0.4999999,), (0.5000001,)),
    "limits, velocity": (lambda x: Limits(ROBOT, velocity=x), (LITTLE,), (0.0,)),
    "limits, acceleration": (lambda x: Limits(ROBOT, acceleration=x), (TINY, np.inf), (0.0,)),
    "limits, base_twist": (
        lambda x: Limits(ROBOT, base_twist=[x] * 6), (TINY, np.inf), (0.0, np.nan)),
    "limits, recovery": (lambda x: Limits(ROBOT, recovery=x), (LITTLE, 1.0), (0.0, 1.0000001)),
    "friction, coefficient": (FrictionCone, (LITTLE,), (0.0,)),
    "friction, least": (lambda x: FrictionCone(least=x), (0.0,), (-TINY,)),
    "friction, most": (lambda x: FrictionCone(least=2.0, most=x), (2.0,), (1.9999999, np.nan)),
    "friction, facets": (lambda x: FrictionCone(facets=x), (3, 64), (2, 65, 4.5)),
    "braking, deceleration": (BrakingParameters, (LITTLE,), (0.0,)),
    "braking, gain": (lambda x: BrakingParameters(gain=x), (LITTLE, 1.0), (0.0, 1.0000001)),
    "braking, recovery": (
        lambda x: BrakingParameters(recovery=x), (LITTLE, 1.0), (0.0, 1.0000001)),
    "braking, recovery_speed": (
        lambda x: BrakingParameters(recovery_speed=x), (LITTLE, 9.0), (0.0, np.inf)),
    "tilt of .*, angle": (
        lambda x: TiltLimit(ROBOT, "base", x), (LITTLE, np.pi - LITTLE), (0.0, np.pi)),
    "tilt of .*, axis": (lambda x: TiltLimit(ROBOT, "base", 0.1, axis=[0, 0, x]), (TINY,), (0.0,)),
    "contact 'left_sole', normal": (
        lambda x: PointContact.hold(START, "left_sole", normal=[0, 0, x]), (1e-8,), (0.0,)),
    "com support, margin": (
        lambda x: ComSupport(ROBOT, SQUARE, margin=x), (0.0, 0.0999999), (-TINY, 0.1)),
    "com support, polygon": (
        lambda x: ComSupport(ROBOT, [[0, 0], [1, 0], [0.5, x]], margin=0.0),
        (0.01,), (0.0,)),
    "the lower bounds must be below": (
        lambda x: PositionBox(ROBOT, "base", [0, 0, 0], [x, 1, 1]),
        (2.0 * SKIN + TINY,), (2.0 * SKIN,)),
    "no bound is finite": (
        lambda x: PositionBox(ROBOT, "base", [-np.inf] * 3, [np.inf, np.inf, x]),
        (0.0,), (np.inf,)),
    "self-collision, margin": (lambda x: SelfCollision(ROBOT, margin=x), (0.0,), (-TINY,)),
    "self-collision, pairs": (lambda x: SelfCollision(ROBOT, pairs=x), (1,), (0,)),
    "obstacles, margin": (lambda x: Obstacles(ROBOT, [BALL], margin=x), (0.0,), (-TINY,)),
    "obstacles, pairs": (lambda x: Obstacles(ROBOT, [BALL], pairs=x), (1,), (0,)),
    "eps of ProxQP": (lambda x: make_backend("proxqp", eps=x), (1e-12,), (0.99e-12,)),
    "eps of active_set": (lambda x: make_backend("active_set", eps=x), (1e-12,), (0.99e-12,)),
    "eps of clarabel": (lambda x: make_backend("clarabel", eps=x), (1e-12,), (0.99e-12,)),
    "nothing would be checked": (lambda x: make_backend("active_set", eps=x), (1e-2,), (1.01e-2,)),
    "max_iterations of ProxQP": (
        lambda x: make_backend("proxqp", max_iterations=x), (1,), (0,)),
    "max_iterations of active_set": (
        lambda x: make_backend("active_set", max_iterations=x), (1,), (0,)),
}  # fmt: skip


@pytest.mark.parametrize("name", RANGES)
def test_a_number_is_taken_up_to_its_end(name: str) -> None:
    make, allowed, refused = RANGES[name]
    for value in allowed:
        make(value)
    for value in refused:
        with pytest.raises(InvalidInputError, match=name):
            make(value)


@pytest.mark.parametrize("level", [KinematicController, TorqueController])
def test_targets_in_degrees_and_millimetres_are_said(level, caplog):  # type: ignore[no-untyped-def]
    """The ticks were solved, nothing was said, and the robot bent as far as it goes."""
    start = ROBOT.snapshot(ROBOT.posture("standing"))
    degrees = np.r_[start.q[:7], np.degrees(start.q[7:])]
    controller = level(
        ROBOT, [ComTask(ROBOT, 1e3 * start.com), PostureTask(ROBOT, degrees)], contacts=()
    )
    for _ in range(2):
        controller.step(start)
    com, posture = [one.getMessage() for one in caplog.records]
    assert "the target of task 'com' is" in com and com.endswith("m away: is it in mm?")
    assert "task 'posture'" in posture and posture.endswith("rad away: is it in degrees?")


def test_targets_of_tasks_that_are_switched_off_are_not_said(caplog):  # type: ignore[no-untyped-def]
    """Of a walker's feet on the ground, 30 m from where it was made; nothing was wrong."""
    start = ROBOT.snapshot(ROBOT.posture("standing"))
    com = ComTask(ROBOT, start.com + 30.0)
    controller = TorqueController(ROBOT, [com, PostureTask(ROBOT, start.q)], contacts=())
    com.switch_off()
    controller.step(start)
    assert not caplog.records


@pytest.mark.parametrize("level", [KinematicController, TorqueController])
def test_joints_in_degrees_are_said_once_and_those_within_limits_never(level, caplog):  # type: ignore[no-untyped-def]
    q = ROBOT.posture("standing")
    controller = level(ROBOT, [PostureTask(ROBOT, q)], contacts=())
    controller.step(ROBOT.snapshot(q))
    assert not caplog.records
    controller = level(ROBOT, [PostureTask(ROBOT, q)], contacts=())
    wrong = ROBOT.snapshot(np.r_[q[:7], np.degrees(q[7:])])
    for _ in range(2):
        controller.step(wrong)
    (said,) = [one.getMessage() for one in caplog.records]
    assert "joints outside their limits" in said and "is q in degrees" in said


@pytest.mark.parametrize(
    ("task", "told"),
    [
        (LoadShareTask(ROBOT, {"left_foot": 1.0, "right_sole": 2.0}), "at left_foot, where"),
        (ContactForceTask(ROBOT, "left_palm"), "at left_palm, where"),
        (CopTask(ROBOT, [0.0, 0.0], frame="left_foot"), "at left_foot, where"),
        (ForceRateTask(ROBOT, ["left_foot"]), "at left_foot, where"),
        (ContactForceTask(ROBOT, "right_sole"), None),  # a foot that lands later
        (CopTask(ROBOT, [0.0, 0.0]), None),
    ],
    ids=repr,
)
def test_tasks_about_forces_where_no_contact_is_are_said(task, told, caplog):  # type: ignore[no-untyped-def]
    """The error of shares at links in place of soles was 0, and nothing was said."""
    start = ROBOT.snapshot(ROBOT.posture("standing"))
    held = support(start, "left")
    TorqueController(ROBOT, [ComTask(ROBOT, start.com), task], contacts=held).step(start)
    said = [one.getMessage() for one in caplog.records]
    assert [told in one for one in said] == [True] if told else not said
