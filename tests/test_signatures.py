"""What inspect, help() and an interactive session show of a class is all that it takes."""

import inspect
import pydoc
from typing import Any

import numpy as np
import pytest

import wbc
from wbc.laws import AccelerationLaw, VelocityLaw
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
def test_signature_of_a_task_about_a_rate_shows_no_gain_that_is_refused(
    kind: type[wbc.Task], hoap2: Robot
) -> None:
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
