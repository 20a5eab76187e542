"""What users see: names that exist and are documented, signatures, and objects in one line."""

import inspect
import pickle
import pydoc
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wbc
from wbc.laws import AccelerationLaw, VelocityLaw
from wbc.problem import load_problem
from wbc.robot import Robot

CLASSES = [name for name in wbc.__all__ if inspect.isclass(getattr(wbc, name))]
TASKS = [name for name in CLASSES if issubclass(getattr(wbc, name), wbc.Task)]
LAWS = ("gain", "gain_per_second", "lm_damping", "singular_threshold", "curvature_damping",
        "weighs_error", "kp", "kd")  # fmt: skip
# Not made by users: raised, derived from, or read from a file.
CALLED = [
    getattr(wbc, name)
    for name in wbc.__all__
    if callable(getattr(wbc, name))
    and name not in ("Dynamics", "Gains", "PlanMismatchError", "Robot", "WbcError")
] + [wbc.Robot.load, wbc.Contact.hold]
PROBLEMS = Path(__file__).parents[1] / "problems"


def test_public_names_are_documented() -> None:
    assert not [name for name in wbc.__all__ if not inspect.getdoc(getattr(wbc, name))]


def test_public_names_are_those_of_the_rooms() -> None:
    wanted = {"ComTask", "Contact", "KinematicController", "Robot", "Obstacle", "Bounds"}
    assert wanted <= set(wbc.__all__) == set(dir(wbc))
    assert not [name for name in dir(wbc) if name.startswith("_") and name != "__version__"]


def test_unknown_names_are_attribute_errors() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Robto'; did you mean 'Robot'"):
        _ = wbc.Robto


@pytest.mark.parametrize(
    ("there", "here"), [("FrameTask", "PoseTask"), ("solve_ik", "KinematicController")]
)
def test_names_of_other_packages_lead_to_ours(there: str, here: str) -> None:
    with pytest.raises(AttributeError, match=f"no attribute '{there}'; did you mean '{here}'"):
        getattr(wbc, there)


SNAPSHOT = (
    "com com_jacobian com_drift inertia inertia_jacobian inertia_drift momentum centroidal_map "
    "mechanical_connection mass_matrix bias"
)


def test_snapshot_names(hoap2: Robot) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"))
    shapes = {name: getattr(here, name).shape for name in SNAPSHOT.split()}
    assert shapes["inertia"] == (3, 3)
    assert shapes["inertia_jacobian"] == (6, hoap2.nv)
    assert shapes["inertia_drift"] == (6,)
    assert shapes["com_jacobian"] == (3, hoap2.nv)


@pytest.mark.parametrize(
    ("read", "meant"),
    [
        (lambda one, _: one.solve, "; did you mean 'step'?"),
        (lambda one, _: one.limits.velocity, "'Limits' object has no attribute 'velocity'"),
        (lambda _, tick: tick.dq, "; did you mean 'velocity'?"),
        (lambda _, tick: tick.v, "; did you mean 'velocity'?"),
        (lambda _, tick: tick.torque, "; torques and forces are of a TorqueController's ticks"),
    ],
)
def test_a_name_that_is_read_and_not_there_is_answered_with_the_one_that_is(
    hoap2: Robot, read: Callable[[Any, Any], object], meant: str
) -> None:
    here = hoap2.snapshot(hoap2.posture())
    one = wbc.KinematicController(
        hoap2, [wbc.PostureTask(hoap2, here.q)], contacts=(), limits=wbc.Limits(hoap2)
    )
    with pytest.raises(AttributeError) as refusal:
        read(one, one.step(here))
    assert str(refusal.value).endswith(meant) and "choose from" not in str(refusal.value)


def test_a_misspelt_attribute_is_answered_by_python(hoap2, capsys) -> None:
    task: Any = wbc.ComTask(hoap2, [0.0, 0.0, 0.3])
    with pytest.raises(AttributeError) as refusal:
        _ = task.wieght
    sys.__excepthook__(type(refusal.value), refusal.value, None)  # as at the end of a script
    assert capsys.readouterr().err.endswith("Did you mean: 'weight'?\n")


def test_no_name_is_looked_for_where_nobody_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    # A change of contacts in a walk took 10 ms, nine of which went into words that were thrown
    # away: hasattr, and getattr with a default, ask for names that may not be there.
    def looked_for(*_: object) -> object:
        raise AssertionError("a nearest name was looked for")

    robot = wbc.Robot.load("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    soles = [wbc.Contact.hold(here, foot.frame) for foot in robot.feet.values()]
    controller = wbc.TorqueController(robot, [wbc.ComTask(robot, here.com)], contacts=soles)
    monkeypatch.setattr("difflib.SequenceMatcher", looked_for)
    assert not hasattr(controller.tasks[0], "wieght")
    controller.step(here)
    controller.set_contacts(soles[:1])
    assert controller.step(here).ok


def test_what_is_said_of_a_name_outlives_its_process() -> None:
    with pytest.raises(AttributeError) as refusal:
        _ = wbc.Robto
    assert str(pickle.loads(pickle.dumps(refusal.value))) == str(refusal.value)


@pytest.mark.parametrize("called", CALLED, ids=lambda one: one.__qualname__)
def test_signature_of_what_users_call_shows_each_parameter_with_its_type(called: Any) -> None:
    for parameter in inspect.signature(called).parameters.values():
        assert parameter.kind is not parameter.VAR_KEYWORD, parameter
        assert parameter.annotation is not parameter.empty, parameter


@pytest.mark.parametrize("name", TASKS)
def test_signature_of_a_task_is_that_of_what_makes_it(name: str) -> None:
    """The class's, its constructor's and help()'s: one."""
    kind = getattr(wbc, name)
    shown, made = inspect.signature(kind), inspect.signature(kind.__init__)
    assert [*shown.parameters.values()] == [*made.parameters.values()][1:]
    assert f"class {name}(" in pydoc.render_doc(kind, renderer=pydoc.plaintext)
    first = pydoc.render_doc(kind, renderer=pydoc.plaintext).split("\n |  Method resolution")[0]
    assert all(one in first for one in shown.parameters)


def test_defaults_that_a_signature_shows_are_those_that_a_task_gets(hoap2: Robot) -> None:
    for kind, target in ((wbc.ComTask, np.zeros(3)), (wbc.InertiaTask, np.eye(3))):
        plain = kind(hoap2, target)
        parameters = inspect.signature(kind).parameters
        assert set(LAWS) <= parameters.keys()
        shown = {key: one.default for key, one in parameters.items()}
        for law in (plain.law, plain.acceleration_law):
            for key in LAWS:
                if hasattr(law, key) and key != "kd":  # None: twice the root of kp
                    assert getattr(law, key) == shown[key], key
        assert (plain.weight == shown["weight"]).all()
        assert plain.priority == shown["priority"]


def test_every_keyword_of_a_signature_is_taken_and_arrives(hoap2: Robot) -> None:
    first: dict[str, Any] = {"gain": 0.3, "lm_damping": 0.1, "singular_threshold": 0.2}
    first |= {"curvature_damping": False, "weighs_error": True}
    task = wbc.ComTask(hoap2, [0.0, 0.0, 0.3], weight=3.0, priority=2, kp=50.0, kd=9.0, **first)
    assert task.law == VelocityLaw(**first)
    assert task.acceleration_law == AccelerationLaw(50.0, 9.0)
    assert (task.weight == 3.0).all() and task.priority == 2


@pytest.mark.parametrize("kind", [wbc.MomentumTask, wbc.DampingTask])
def test_signature_of_a_task_about_a_rate_shows_no_gain_that_is_refused(kind, hoap2) -> None:
    shown = inspect.signature(kind).parameters.keys()
    assert {"kd", "singular_threshold", "weight", "priority"} <= shown
    make: Any = kind
    for key in set(LAWS) - shown:
        with pytest.raises(wbc.WbcError, match=f"{key}: has no effect"):
            make(hoap2, **{key: 0.5})
    assert set(LAWS) & shown == {"kd", "singular_threshold"}


def test_signature_of_a_users_task_shows_each_keyword_that_it_hands_on() -> None:
    from typing import Unpack

    from wbc.tasks.keywords import Gains

    class Own(wbc.Task):
        """A user's."""

        def __init__(self, robot: wbc.Robot, **law: Unpack[Gains]) -> None:
            super().__init__(robot, "own", ("x",), **law)

    class Plain(wbc.Task):
        """A user's, which says nothing of its keywords."""

        def __init__(self, *args: object, **keywords: object) -> None: ...

    assert {"weight", "kp"} <= inspect.signature(Own).parameters.keys()
    assert [*inspect.signature(Plain).parameters] == ["args", "keywords"]


def test_contact_that_holds_a_frame_shows_its_keywords() -> None:
    parameters = inspect.signature(wbc.Contact.hold).parameters
    assert {"snapshot", "frame", "kp", "gain"} <= parameters.keys()
    assert "law" not in parameters


def objects() -> dict[str, object]:
    robot = wbc.Robot.load("hoap2_like")
    start = robot.snapshot(robot.posture("standing"))
    limits = wbc.Limits(robot)
    tasks = [
        wbc.InertiaTask(robot, start.inertia, components=["zz"]),
        wbc.ComTask(robot, start.com),
        wbc.PostureTask(robot, start.q),
    ]
    contacts = wbc.support(start, "double")
    kinematic = wbc.KinematicController(robot, tasks, contacts=contacts, limits=limits)
    tick = kinematic.step(start)
    hands = [
        wbc.PositionTask(robot, f"{side}_palm", start.position(f"{side}_palm"), name=name)
        for side, name in (("left", "left"), ("right", "right"))
    ]
    fuller = wbc.KinematicController(robot, [*tasks[1:], *hands], contacts=contacts)
    problem = load_problem(PROBLEMS / "astronaut_expand.yaml", {"stop.duration": 0.02})
    result = problem.run()
    pendulum = load_problem(PROBLEMS / "rmp_spin.yaml")
    times = np.arange(40) * 0.01
    motion = wbc.Motion(robot, times, np.tile(start.q[7:], (40, 1)), np.tile(start.q[:7], (40, 1)))
    return {
        "robot": robot,
        "snapshot": start,
        "limits": limits,
        "limits of the model": robot.limits,
        "foot": robot.feet["left"],
        "task": tasks[0],
        "contact": contacts[0],
        "controller": kinematic,
        "tick": tick,
        "fuller tick": fuller.step(start),
        "qp": tick.qp,
        "solution": tick.solution,
        "state": wbc.reduce(start),
        "flight": wbc.reduce(start, np.array([0.0, 0.0, -20.0, *np.zeros(robot.nv - 3)])),
        "obstacle": wbc.Obstacle.sphere("ball", (0, 0, 0), 0.1),
        "support": wbc.ComSupport.over(start, ["left", "right"]),
        "stance": wbc.stance_torques(start, contacts),
        "box": wbc.PositionBox.height(robot, 0.1),
        "problem": problem,
        "result": result,
        "history": result.history,
        "pendulum": pendulum,
        "pendulum's result": pendulum.run(),
        "motion": motion,
        "series": wbc.analyze(motion),
    }


@pytest.fixture(scope="module")
def shown() -> dict[str, str]:
    return {name: repr(one) for name, one in objects().items()}


def test_it_fits_a_line(shown: dict[str, str]) -> None:
    for name, text in shown.items():
        assert len(text) <= 110 and "\n" not in text, f"{name}: {text}"
        assert " object at 0x" not in text, f"{name}: {text}"


def test_it_says_what_matters(shown: dict[str, str]) -> None:
    assert shown["robot"].startswith("Robot('hoap2_like'")
    assert shown["tick"] == "Tick(solved, nv=31, errors: inertia, com, posture)"
    assert shown["fuller tick"] == "Tick(solved, nv=31, errors: com, posture, left and 1 more)"
    controller = "KinematicController('hoap2_like', 3 tasks, 2 contacts, 0 constraints, dt=0.005)"
    assert shown["controller"] == controller
    assert shown["limits of the model"] == "JointLimits(25 joints, 0 missing)"
    assert shown["history"] == "History(4 ticks, 0 to 0.015 s)"
    assert shown["result"] == "Result(timeout, 'hoap2_like', 4 ticks, 1 tasks)"
    assert "in the air" in shown["flight"]


def test_tab_offers_public_names_only() -> None:
    assert [name for name in dir(wbc) if name.startswith("_") and name != "__version__"] == []
