"""Symbolic task errors and the NLP's cost against the tasks and the QP they are taken from."""

import casadi as ca
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wbc.constraints import Limits, support
from wbc.controllers import KinematicController
from wbc.errors import InvalidInputError
from wbc.robot import Robot, Snapshot
from wbc.robot.symbolic import SymbolicPosture
from wbc.shaping import GlobalShaping
from wbc.shaping.nlp import build_nlp
from wbc.shaping.problem import ShapingProblem, posture_cost
from wbc.shaping.unknowns import Unknowns
from wbc.tasks import (
    AxisTask,
    ComTask,
    InertiaTask,
    MomentumTask,
    OrientationTask,
    PoseTask,
    PositionTask,
    PostureTask,
    PrincipalInertiaTask,
    Residual,
    Task,
)

TURN = Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix()


def tip(robot: Robot) -> str:
    return robot.joint_names[-1]


def all_tasks(robot: Robot, q: np.ndarray) -> list[Task]:
    """One task of each kind and option, with targets away from anything special."""
    S = robot.mass * np.array([[0.05, 0.01, -0.004], [0.01, 0.06, 0.003], [-0.004, 0.003, 0.02]])
    frame = tip(robot)
    joints = {robot.joint_names[0]: 0.0, robot.joint_names[1]: 2.5}
    return [
        InertiaTask(robot, S, name="world", weight=3.0, gain=0.2),
        InertiaTask(robot, np.diag(S), components=("xx", "yy", "zz"), frame="base", name="base"),
        InertiaTask(
            robot, S, components=("xy", "zz"), frame=frame, per_mass=True, weight=[9.0, 7.0]
        ),
        InertiaTask(robot, 0.1, components=("trace",), name="trace"),
        ComTask(robot, [0.1, 0.2, 0.7], axes=("z", "x"), weight=[2.0, 0.5]),
        PositionTask(robot, frame, [0.3, -0.1, 0.9]),
        OrientationTask(robot, frame, TURN, weight=[1.0, 2.0, 3.0]),
        PoseTask(robot, "base", [0.1, 0.0, 0.6], TURN, gain=0.9),
        AxisTask(robot, frame, [0.0, 0.3, 1.0], axis=[1, 0, 0]),
        PostureTask(robot, q, joints=joints, weight=0.1),
    ]


def test_errors_are_those_of_the_tasks(robot: Robot, rng, random_snapshot) -> None:
    tasks = all_tasks(robot, random_snapshot(robot, rng).q)
    problem = ShapingProblem(robot, tuple(tasks), (), Limits(robot), ())
    unknowns = Unknowns.of(problem)
    for _ in range(2):
        here = random_snapshot(robot, rng)
        values = unknowns.values(here.q)
        x, p = values
        back = unknowns.map(tuple(range(x.size))).configuration(x, np.concatenate((p, x)))
        np.testing.assert_allclose(robot.difference(here.q, back), 0.0, atol=1e-10)
        for task in tasks:
            error = task.symbolic_error(unknowns.posture)
            function = ca.Function("error", [unknowns.x, unknowns.p], [error])
            expected = task.residual(here).error
            # Rotations within a degree of half a turn lose digits; else the same sums reordered.
            np.testing.assert_allclose(
                np.array(function(*values)).ravel(), expected, atol=1e-9 * (1 + abs(expected).max())
            )


def test_cost_is_the_sum_over_tasks_in_any_chart(robot: Robot, rng, random_snapshot) -> None:
    """From a start elsewhere: the base's turn is then an unknown of the NLP, far from zero."""
    start, here = random_snapshot(robot, rng), random_snapshot(robot, rng)
    tasks = all_tasks(robot, start.q)
    built = build_nlp(ShapingProblem(robot, tuple(tasks), (), Limits(robot), ()))
    begin, end = built.start(start.q), built.start(here.q)
    x = end.x.copy()
    turn = start.rotation("base").T @ here.rotation("base")
    n = robot.nv - 6
    assert built.kept[-6:] == tuple(range(n, n + 6))
    x[-3:] = Rotation.from_matrix(turn).as_mrp()
    reached = robot.snapshot(built.configuration(begin, x))
    np.testing.assert_allclose(robot.difference(here.q, reached.q), 0.0, atol=1e-9)
    cost = float(built.nlp.functions(x, begin.p)[0])
    np.testing.assert_allclose(cost, posture_cost(tasks, here), rtol=1e-9)
    np.testing.assert_allclose(
        float(built.nlp.functions(x, built.scaled(begin, 0.25).p)[0]), 0.25 * cost, rtol=1e-12
    )


def test_gradient_is_the_pull_of_the_qp(robot: Robot, rng, random_snapshot) -> None:
    """The controller rests where the NLP's gradient is zero: one tick's g is that gradient / dt.

    Independent of the NLP: the QP is made of the tasks' hand-written Jacobians.
    """
    here = random_snapshot(robot, rng)
    tasks = all_tasks(robot, random_snapshot(robot, rng).q)
    tick = KinematicController(robot, tasks, dt=0.01).step(here)
    built = build_nlp(ShapingProblem(robot, tuple(tasks), (), Limits(robot), ()))
    x, p = built.start(here.q)
    symbols = ca.SX.sym("x", x.size)
    gradient = ca.gradient(built.nlp.functions(symbols, p)[0], symbols)
    found = np.array(ca.Function("g", [symbols], [gradient])(x)).ravel()
    n = robot.nv - 6
    joints = np.array([k for k in built.kept if k < n])
    expected = 0.01 * tick.qp.g
    scale = np.abs(expected).max()
    np.testing.assert_allclose(found[: joints.size], expected[6 + joints], atol=1e-9 * scale)
    # The base: world position, and tan(angle / 4) of a turn in base axes.
    R = here.rotation("base")
    np.testing.assert_allclose(R.T @ found[-6:-3], expected[:3], atol=1e-9 * scale)
    np.testing.assert_allclose(found[-3:] / 4.0, expected[3:6], atol=1e-9 * scale)


def test_principal_moments_are_met_with_axes_of_their_own(robot: Robot, rng, random_snapshot):
    """The lifted error is the task's own where the axes are best, and never less elsewhere."""
    here = random_snapshot(robot, rng)
    task = PrincipalInertiaTask(robot, [1.0, 3.0, 3.5], per_mass=True, weight=2.0, gain=0.4)
    built = build_nlp(ShapingProblem(robot, (task,), (), Limits(robot), ()))
    x, p = built.start(here.q)
    expected = posture_cost([task], here)
    np.testing.assert_allclose(float(built.nlp.functions(x, p)[0]), expected, rtol=1e-10)
    for _ in range(10):
        x[-3:] = rng.normal(size=3)
        assert float(built.nlp.functions(x, p)[0]) >= expected * (1 - 1e-12)


def test_only_what_matters_is_unknown(hoap2) -> None:
    q = hoap2.posture()
    n = hoap2.nv - 6

    def kept(task: Task, mode: str = "floating") -> tuple[int, ...]:
        contacts = support(hoap2.snapshot(q), mode)
        return build_nlp(
            ShapingProblem(hoap2, (task,), contacts, Limits(hoap2), ())
        ).kept  # fmt: skip

    target = np.eye(3)
    assert max(kept(InertiaTask(hoap2, target, frame="base"))) < n
    assert max(kept(InertiaTask(hoap2, target, frame="left_sole"))) < n
    assert max(kept(InertiaTask(hoap2, 1.0, components=("trace",)))) < n
    assert kept(InertiaTask(hoap2, target))[-3:] == (n + 3, n + 4, n + 5)  # turns, no position
    assert max(kept(InertiaTask(hoap2, target), "double")) < n
    assert kept(PositionTask(hoap2, "base", [0, 0, 1])) == (n, n + 1, n + 2)


def test_tasks_that_say_nothing_about_postures_are_refused_by_name(hoap2) -> None:
    q = hoap2.posture()
    posture = PostureTask(hoap2, q)

    class Wish(Task):
        def residual(self, snapshot):
            return posture.residual(snapshot)

        def drift(self, snapshot):
            return posture.drift(snapshot)

    uneven = PrincipalInertiaTask(hoap2, [1, 2, 3], weight=[1, 1, 1, 1, 1, 2])
    for tasks, words in (
        ([posture, MomentumTask(hoap2)], "'momentum' is about momentum"),
        ([posture, ComTask(hoap2, [0, 0, 1], priority=1)], r"priorities \[0, 1\]"),
        ([posture, posture], "two tasks are called 'posture'"),
        ([], "no task"),
        ([uneven], "weighs its six rows differently"),
        ([Wish(hoap2, "wish", ["row"])], "'wish' is a Wish"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            GlobalShaping(hoap2, tasks)


class LevelHands(Task):
    """A task of the caller's: both hands at one height."""

    hands = ("left_hand", "right_hand")

    def residual(self, snapshot: Snapshot) -> Residual:
        left, right = self.hands
        error = (snapshot.position(left) - snapshot.position(right))[2:]
        jacobian = (snapshot.jacobian(left) - snapshot.jacobian(right))[2:3]
        return Residual(error, jacobian, np.zeros(1))

    def drift(self, snapshot: Snapshot) -> np.ndarray:
        left, right = self.hands
        return (snapshot.drift(left) - snapshot.drift(right))[2:3]

    def symbolic_error(self, posture: SymbolicPosture) -> ca.SX:
        left, right = self.hands
        return (posture.position(left) - posture.position(right))[2]


def test_a_task_of_the_callers_needs_no_more_than_itself(hoap2) -> None:
    q = hoap2.posture("standing", {"left_elbow_pitch": -1.0})
    task = LevelHands(hoap2, "level", ["z"])
    assert abs(task.residual(hoap2.snapshot(q)).error[0]) > 0.01
    best = GlobalShaping(hoap2, [task, PostureTask(hoap2, q, weight=1e-4)]).solve(q, 2, workers=1)
    left, right = (hoap2.snapshot(best.best.q).position(hand) for hand in task.hands)
    assert left[2] == pytest.approx(right[2], abs=1e-4)
