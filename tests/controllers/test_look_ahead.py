"""Commands are tried before they are given; what cannot be kept by rows is kept by going slower."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.conftest import random_state
from wbc.constraints import Limits, SelfCollision
from wbc.constraints.rows import Bounds, Constraint
from wbc.controllers import KinematicController
from wbc.controllers.look_ahead import RELAXED, ROUNDS, MarginRows, solve_with_look_ahead
from wbc.controllers.outcome import Outcome
from wbc.controllers.slack import Slacks
from wbc.laws import Residual, Rows
from wbc.qp import Status
from wbc.qp.solution import Conflict, ConflictRow, KktResiduals, Solution
from wbc.robot import Robot
from wbc.tasks import PositionTask, PostureTask

DT = 0.005


class Slow(Constraint):
    """Allows no speed above ``most``, and says so only when a command is tried.

    With ``useful`` its cuts are rows that keep the speed down; otherwise they say nothing.
    """

    name = "slow"

    def __init__(self, robot: Robot, most: float, useful: bool) -> None:
        self.robot, self.most, self.useful = robot, most, useful
        self.tried: list[float] = []

    def rows(self, snapshot, dt) -> Bounds:
        nothing = np.zeros((1, self.robot.nv))
        return Bounds(("nothing",), nothing, np.array([-1.0]), np.array([1.0]))

    def may_violate(self, rows, v, dt) -> bool:
        return True

    def cutting_planes(self, there, v, dt, rows) -> Bounds | None:
        k = int(np.argmax(np.abs(v)))
        self.tried.append(float(np.abs(v[k])))
        np.testing.assert_allclose(there.robot.difference(self.start, there.q), v * dt, atol=1e-12)
        if self.tried[-1] <= self.most + 1e-9:
            return None
        matrix = np.zeros((1, self.robot.nv))
        if self.useful:
            matrix[0, k] = 1.0
        bound = np.full(1, self.most)
        return Bounds((f"speed {k}",), matrix, -bound, bound)


class OwnPosture(PostureTask):
    """A posture in Python, which counts how often it is asked."""

    asked = 0

    def residual(self, snapshot) -> Residual:
        type(self).asked += 1
        return super().residual(snapshot)


def moving(
    robot: Robot, constraint: Slow, joint: str, deadline: float | None = None
) -> KinematicController:
    q = robot.posture("standing", {joint: -0.2}, on_ground=False)
    limits = Limits(robot, acceleration=1e4)
    task = PostureTask(robot, q)
    return KinematicController(
        robot, [task], limits=limits, constraints=[constraint], dt=DT, deadline=deadline
    )


def test_cuts_are_added_until_the_place_is_good(hoap2, here) -> None:
    constraint = Slow(hoap2, 0.5, useful=True)
    control = moving(hoap2, constraint, "left_elbow_pitch")
    constraint.start = here.q
    tick = control.step(here)
    assert tick.ok
    assert tick.step_scale == 1.0
    assert len(constraint.tried) == 2
    assert constraint.tried[0] > 0.6
    assert np.abs(tick.velocity).max() == pytest.approx(0.5, abs=1e-6)
    k = hoap2.joint_index("left_elbow_pitch")
    assert tick.active == (f"speed {k}",)
    assert tick.qp.labels.inequality == ("nothing", f"speed {k}")


def test_a_task_in_python_is_asked_once_in_a_tick_of_several_rounds(hoap2, here) -> None:
    constraint = Slow(hoap2, 0.5, useful=True)
    constraint.start = here.q
    task = OwnPosture(hoap2, hoap2.posture("standing", {"left_elbow_pitch": -0.2}, on_ground=False))
    limits = Limits(hoap2, acceleration=1e4)
    control = KinematicController(hoap2, [task], limits=limits, constraints=[constraint], dt=DT)
    plain = moving(hoap2, constraint, "left_elbow_pitch").step(here)
    control.step(here)  # the first finds out what the task returns
    constraint.tried, OwnPosture.asked = [], 0
    tick = control.step(here)
    assert len(constraint.tried) == 2
    assert OwnPosture.asked == 1
    np.testing.assert_allclose(tick.velocity, plain.velocity, atol=1e-9)


def test_joints_brake_harder_for_a_cut_of_a_later_round_too(hoap2) -> None:
    """Bounded braking gives way to margins, whenever in the tick they are seen."""
    constraint = Slow(hoap2, 0.5, useful=True)
    q, v = hoap2.posture("standing"), np.zeros(hoap2.nv)
    v[6 + hoap2.joint_index("left_elbow_pitch")] = -1.0
    limits = Limits(hoap2, acceleration=10.0, braking="bounded")  # 0.05 rad/s in a tick
    task = PostureTask(hoap2, q, gain=0.01)
    control = KinematicController(hoap2, [task], limits=limits, constraints=[constraint], dt=DT)
    here = hoap2.snapshot(q, v)
    constraint.start = here.q
    tick = control.step(here)
    assert tick.ok and tick.step_scale == 1.0, tick.report()
    assert constraint.tried[0] > 0.9
    assert np.abs(tick.velocity).max() <= 0.5 + 1e-6
    assert "brakes harder" in tick.report()


def test_a_command_of_another_attempt_at_the_first_level_is_tried_too(g1_27) -> None:
    """Weights too far apart for the core's first attempt: two bodies ended 15 mm inside another."""
    rng, limits, names = np.random.default_rng(34), Limits(g1_27), g1_27.frame_names
    here = g1_27.snapshot(random_state(g1_27, rng)[0])
    frames_and_targets = [
        (names[rng.integers(len(names))], here.com + 0.3 * rng.normal(size=3)) for _ in range(3)
    ]
    tasks = [
        PositionTask(g1_27, frame, target, weight=weight, gain=1.0, name=f"{weight:g}")
        for weight, (frame, target) in zip((1e7, 1e4, 1.0), frames_and_targets, strict=True)
    ]
    apart = SelfCollision(g1_27, margin=0.0, limits=limits)
    given = {"limits": limits, "constraints": [apart], "solver": "active_set"}
    controller = KinematicController(g1_27, tasks, contacts=(), dt=0.02, damping=1e-8, **given)
    tick = controller.step(here)
    before = apart.distances(here)
    after = apart.distances(g1_27.snapshot(g1_27.integrate(here.q, tick.velocity, 0.02)))
    known = dict(zip(before.keys.tolist(), before.clearance.tolist(), strict=True))
    for key, clearance in zip(after.keys.tolist(), after.clearance.tolist(), strict=True):
        assert clearance > min(known.get(key, 0.0), 0.0) - 1e-4


def test_where_cuts_are_in_vain_a_part_is_commanded(hoap2, here) -> None:
    constraint = Slow(hoap2, 0.5, useful=False)
    control = moving(hoap2, constraint, "left_elbow_pitch")
    constraint.start = here.q
    tick = control.step(here)
    assert tick.ok
    assert 0.0 < tick.step_scale < 1.0
    np.testing.assert_allclose(tick.velocity, tick.step_scale * tick.solution.x)
    assert np.abs(tick.velocity).max() <= 0.5 + 1e-9
    assert len(tick.qp.l) == 1 + ROUNDS


def test_where_nothing_moves_nothing_is_broken(hoap2, here) -> None:
    """Not even a sixteenth is allowed: the command is to stand still."""
    constraint = Slow(hoap2, 1e-6, useful=False)
    control = moving(hoap2, constraint, "left_elbow_pitch")
    constraint.start = here.q
    tick = control.step(here)
    assert tick.step_scale == 0.0
    assert not tick.velocity.any()


def outcome(side: str | None) -> Outcome:
    """An infeasible one with a conflict in which such a row takes part; None: without one."""
    none = np.zeros(0)
    conflict = None if side is None else Conflict((ConflictRow("row", 1.0, 1.0, side),))
    solution = Solution(
        np.zeros(2), none, none, np.zeros(2), Status.INFEASIBLE, KktResiduals(1.0, 0.0, 0.0), 1,
        0.0, "daqp", conflict,
    )  # fmt: skip
    return Outcome(SimpleNamespace(skipped=(), box=(-np.ones(2), np.ones(2))), solution)


@pytest.mark.parametrize(
    ("side", "over", "solves"),
    [
        ("equality", False, 1),
        ("upper bound", False, 1),
        ("lower limit", False, 2),
        ("lower limit", True, 1),
        (None, False, 2),
        (None, True, 1),
    ],
)
def test_margins_are_relaxed_only_where_they_take_part(hoap2, here, side, over, solves) -> None:
    """What cannot hold without any margin cannot hold with them relaxed either.

    Once the deadline is over they are not relaxed, and that is said.
    """
    asked: list[Bounds] = []
    margins = MarginRows.at(here, [Slow(hoap2, 0.5, useful=True)], Slacks({}, [], []), DT)
    held = Rows(np.eye(1, hoap2.nv), np.zeros(1), np.ones(1))
    found = solve_with_look_ahead(
        lambda bounds, box: asked.append(bounds) or outcome(side),
        margins,
        lambda: held,
        lambda: over,
    )
    assert not found.solved
    assert len(asked) == solves
    np.testing.assert_array_equal(asked[0].lower, [-1.0])
    assert found.core_tick.skipped == ((RELAXED,) if over else ())
