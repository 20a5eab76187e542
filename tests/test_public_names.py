"""The names that users rely on exist, are documented, and are the ones listed."""

import inspect
import pickle
import sys
from collections.abc import Callable
from typing import Any

import pytest

import wbc
from wbc.robot import Robot


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


def test_a_misspelt_attribute_is_answered_by_python(
    hoap2: Robot, capsys: pytest.CaptureFixture[str]
) -> None:
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
