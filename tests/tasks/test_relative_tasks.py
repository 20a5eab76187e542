"""Tasks between frames and at rest: in controllers, held exactly, in files and in the search."""

import casadi as ca
import numpy as np
import pytest

import wbc
from tests.standing import commanded
from wbc.constraints import Limits, support
from wbc.controllers import KinematicController
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.robot import Robot
from wbc.robot.symbolic import SymbolicPosture
from wbc.tasks import (
    ComTask,
    DampingTask,
    DistanceTask,
    PositionTask,
    PostureTask,
    RelativePoseTask,
)

LEFT, RIGHT = "left_palm", "right_palm"
YAML = """# Relative tasks in a file.
robot: hoap2_like
start: {{posture: standing}}
support: double
tasks:
  hands: {{type: {kind}, {keys}}}
  com: {{type: com, target: start}}
{more}
stop: {{duration: {seconds}}}
"""


def test_hands_come_to_a_distance(hoap2: Robot) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"))
    task = DistanceTask(hoap2, LEFT, RIGHT, 0.12, gain=0.1)
    controller = KinematicController(
        hoap2, [task, DampingTask(hoap2, weight=0.01)], contacts=support(here, "double"),
        limits=Limits(hoap2),
    )  # fmt: skip
    *_, (_, q) = commanded(controller, here.q, 400)
    there = hoap2.snapshot(q)
    distance = np.linalg.norm(there.position(LEFT) - there.position(RIGHT))
    assert distance == pytest.approx(0.12, abs=1e-4)


def test_two_hands_carry_one_object_exactly(hoap2: Robot) -> None:
    """Held as a contact, the relative pose stays while one hand is moved: the other follows."""
    here = hoap2.snapshot(hoap2.posture("standing", {"*elbow*": -0.8}))
    Ra = here.rotation(RIGHT)
    arm = Ra.T @ (here.position(LEFT) - here.position(RIGHT))
    carried = RelativePoseTask(
        hoap2, LEFT, RIGHT, arm, Ra.T @ here.rotation(LEFT), components=("x", "y", "z")
    )
    task = PositionTask(hoap2, RIGHT, here.position(RIGHT) + [0.02, 0.0, 0.02], gain=0.1)
    controller = KinematicController(
        hoap2, [task, DampingTask(hoap2, weight=0.01)],
        contacts=[*support(here, "double"), carried], limits=Limits(hoap2),
    )  # fmt: skip
    *_, (tick, q) = commanded(controller, here.q, 300)
    there = hoap2.snapshot(q)
    moved = there.rotation(RIGHT).T @ (there.position(LEFT) - there.position(RIGHT))
    np.testing.assert_allclose(moved, arm, atol=1e-5)
    assert np.linalg.norm(tick.errors[f"{RIGHT} position"]) < 2e-3
    assert f"{LEFT} in {RIGHT} x" in tick.qp.labels.equality


def test_damping_slows_what_no_task_needs(hoap2: Robot) -> None:
    here = hoap2.snapshot(hoap2.posture("standing"), 0.1 * np.ones(hoap2.nv))
    com = ComTask(hoap2, here.com + 0.01, weight=10.0)
    speeds = [
        np.linalg.norm(KinematicController(hoap2, tasks, damping=1e-9).step(here).velocity)
        for tasks in ([com], [com, DampingTask(hoap2)])
    ]
    assert speeds[1] < speeds[0]
    task = DampingTask(hoap2, joints={"*": 0.0, "head_*": 2.0}, base=False)
    assert all(row.startswith("head_") for row in task.rows) and (task.weight == 2.0).all()
    tick = KinematicController(hoap2, [task]).step(here)
    np.testing.assert_allclose(tick.errors["damping"], 0.1)  # the measured velocities


@pytest.mark.parametrize("case", ["relative", "masked", "distance", "damping"])
def test_symbolic_errors_are_the_residuals(case: str, g1_27: Robot, rng) -> None:
    """Oracle: the residual by Pinocchio at random configurations."""
    frames = "left_rubber_hand", "torso_link"
    R = g1_27.snapshot(g1_27.posture("standing")).rotation("pelvis")
    task = {
        "relative": lambda: RelativePoseTask(g1_27, *frames, [0.1, 0.2, 0.3], R),
        "masked": lambda: RelativePoseTask(g1_27, *frames, [0.1, 0, 0], R, components=("rz", "x")),
        "distance": lambda: DistanceTask(g1_27, *frames, 0.2),
        "damping": lambda: DampingTask(g1_27),
    }[case]()
    q = ca.SX.sym("q", g1_27.nq)
    error = ca.Function("error", [q], [task.symbolic_error(SymbolicPosture.at(g1_27, q))])
    for _ in range(5):
        step = np.concatenate((rng.normal(size=6), rng.normal(scale=0.5, size=g1_27.nv - 6)))
        here = g1_27.snapshot(g1_27.integrate(g1_27.posture("standing"), step, 1.0))
        found = np.asarray(error(here.q)).ravel()
        np.testing.assert_allclose(found, task.residual(here).error, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "keys"),
    [
        ("distance", "frame: left_palm, other: right_palm, target: 0.2, ramp: 0.5"),
        (
            "relative_pose",
            "frame: left_palm, relative_to: base, components: [x, y, z], "
            "target: {position: {offset: [0.01, 0, 0.02]}}",
        ),
        ("damping", "weight: 0.1, joints: {'*head*': 5}"),
    ],
)
@pytest.mark.parametrize("search", [False, True])
def test_in_files_and_in_the_global_search(kind, keys, search, tmp_path) -> None:
    if search and kind == "distance":
        keys = keys.replace(", ramp: 0.5", "")
    more = "controller: {method: global, starts: 2, workers: 1}" if search else ""
    path = tmp_path / "relative.yaml"
    text = YAML.format(kind=kind, keys=keys, more=more, seconds=5.0 if search else 1.0)
    path.write_text(text, encoding="utf-8")
    result = wbc.load_problem(path).run()
    assert not result.failures
    if kind != "damping":
        assert np.abs(result.tasks["hands"].error).max() < 2e-3


def test_what_makes_no_sense_is_refused(hoap2: Robot) -> None:
    with pytest.raises(InvalidInputError, match="has no distance from itself"):
        DistanceTask(hoap2, LEFT, LEFT, 0.1)
    with pytest.raises(InvalidInputError, match="never moves as seen from itself"):
        RelativePoseTask(hoap2, LEFT, LEFT, np.zeros(3), np.eye(3))
    apart = DistanceTask(hoap2, LEFT, RIGHT, 0.1)
    seen = RelativePoseTask(hoap2, LEFT, RIGHT, np.zeros(3), np.eye(3))
    for task, name in ((apart, "other"), (seen, "relative_to")):
        for value, told in ((LEFT, "itself"), (None, f"{name}: expected its name, got None")):
            with pytest.raises(InvalidInputError, match=told):  # None crashed the process
                setattr(task, name, value)
        with pytest.raises(UnknownNameError, match="unknown frame 'palm'"):
            setattr(task, name, "palm")
        setattr(task, name, "base")
    with pytest.raises(UnknownNameError, match="component of a pose 'r'"):
        RelativePoseTask(hoap2, LEFT, RIGHT, np.zeros(3), np.eye(3), components=("r",))
    with pytest.raises(InvalidInputError, match="nothing left to damp"):
        DampingTask(hoap2, joints={"*": 0.0}, base=False)


def test_weights_of_joints_multiply_that_of_the_posture(hoap2: Robot) -> None:
    """Of the cost: a row's weight is the task's times its joint's."""
    task = PostureTask(hoap2, hoap2.posture(), weight=3.0, joints={"*": 0.5, "*knee*": 10.0})
    expected = [30.0 if "knee" in name else 1.5 for name in hoap2.joint_names]
    np.testing.assert_allclose(task.weight, expected, rtol=1e-15)
