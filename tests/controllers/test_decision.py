"""A level with further unknowns needs a decision, a law and its physics: no second pipeline.

The level here is a small inverse dynamics: unknowns (v+, f), a force and a moment for each foot,
six rows of floating-base dynamics, tasks by their second-order laws.
"""

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from wbc.constraints import Limits, SelfCollision, support
from wbc.controllers import Controller
from wbc.controllers.levels import Outcome
from wbc.controllers.plan import Decision, Physics
from wbc.laws import Residual, Rows
from wbc.robot import Robot, Snapshot
from wbc.tasks import ComTask, PostureTask
from wbc.tasks.task import Task

Load = Callable[[str], Robot]


class WrenchController(Controller):
    """Accelerations and contact wrenches that agree with the dynamics of the floating base."""

    def _decision(self) -> Decision:
        names = [f"{contact.name} {row}" for contact in self.contacts for row in contact.rows]
        free = np.full(len(names), np.inf)
        velocity = Decision.velocity(self.robot, self.damping * self.joint_weights)
        return velocity.extended(names, -free, free, np.full(len(names), 1e-8))

    def _physics_names(self) -> tuple[str, ...]:
        return tuple(f"dynamics {k}" for k in range(6))

    def _law(self, task: Task, residual: Residual, snapshot: Snapshot) -> Rows:
        drift = task.drift(snapshot)
        return task.acceleration_law.rows(residual, drift, snapshot.v, task.weight, self.dt)

    def _physics(self, snapshot: Snapshot) -> Physics:
        M, J = snapshot.mass_matrix[:6] / self.dt, self.jacobian(snapshot)
        matrix = np.concatenate((M, -J.T[:6]), axis=1)
        return Physics([Rows(matrix, M @ snapshot.v - snapshot.bias[:6], np.ones(6))])

    def _fallback(self, snapshot: Snapshot, outcome: Outcome) -> tuple[np.ndarray, dict]:
        return np.zeros(self.robot.nv), {}

    def jacobian(self, snapshot: Snapshot) -> np.ndarray:
        return np.concatenate([contact.residual(snapshot).jacobian for contact in self.contacts])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hoap2_like", "g1_27"])
@pytest.mark.parametrize("levels", [1, 2])
@pytest.mark.parametrize("margins", [False, True])
def test_forces_carry_the_robot(name: str, levels: int, margins: bool, robot_named: Load) -> None:
    """Oracle: Pinocchio's recursive Newton-Euler with the forces leaves nothing for the base."""
    robot = robot_named(name)
    q, dt = robot.posture("standing"), 0.002
    here = robot.snapshot(q, np.zeros(robot.nv))
    contacts = support(here, "double")
    controller = WrenchController(
        robot,
        [
            ComTask(robot, here.com + [0.01, 0.0, -0.01], weight=10.0),
            PostureTask(robot, q, weight=0.1, priority=levels - 1),
        ],
        contacts=contacts,
        limits=Limits(robot),
        constraints=[SelfCollision(robot, margin=0.003)] if margins else [],
        dt=dt,
    )
    for _ in range(20):
        tick = controller.step(here)
        assert tick.ok, tick.report()
        v = tick.velocity
        acceleration, wrenches = (v - here.v) / dt, tick.solution.x[robot.nv :]
        torque = pin.rnea(robot.model, robot.model.createData(), here.q, here.v, acceleration)
        unbalanced = (torque - controller.jacobian(here).T @ wrenches)[:6]
        weight = 9.81 * robot.mass
        # The rows hold to 1e-8 of their numbers, which are M / dt v: thousands here.
        np.testing.assert_allclose(unbalanced, 0.0, atol=1e-5 * weight)
        for contact in contacts:  # held to second order: the rows are met exactly
            row = controller._law(contact, contact.residual(here), here)
            np.testing.assert_allclose(row.matrix @ v, row.target, atol=1e-6)
        here = robot.snapshot(robot.integrate(here.q, v, dt), v)
    assert len(tick.qp.labels.equality) == (18 if levels == 1 else len(tick.qp.b))
    assert abs(wrenches[2] + wrenches[8] - weight) < 0.5 * weight  # both feet carry it
    assert here.com[0] > 1e-5 + controller.tasks[0].target[0] - 0.01


def test_contacts_may_be_changed_and_keep_their_warm_starts(robot_named: Load) -> None:
    robot = robot_named("hoap2_like")
    here = robot.snapshot(robot.posture("standing"), np.zeros(robot.nv))
    controller = WrenchController(robot, [ComTask(robot, here.com)], dt=0.002)
    sizes = []
    for mode in ("double", "left", "double"):
        controller.set_contacts(support(here, mode))
        tick = controller.step(here)
        sizes.append((tick.qp.g.size - robot.nv, tick.solution.attempts))
        assert tick.ok, tick.report()
    assert [size for size, _ in sizes] == [12, 6, 12]


def test_unknowns_may_be_added_twice(robot_named: Load) -> None:
    robot = robot_named("hoap2_like")
    first = Decision.velocity(robot, np.ones(robot.nv)).extended(
        ["a", "b"], np.array([-1.0, -2.0]), np.array([3.0, 4.0]), np.array([0.1, 0.2])
    )
    both = first.extended(["c"], np.array([-5.0]), np.array([6.0]), np.array([0.3]))
    assert both.names[robot.nv :] == ("a", "b", "c") and both.nv == robot.nv
    assert both.size == robot.nv + 3
    assert both.lower.tolist() == [-1.0, -2.0, -5.0] and both.upper.tolist() == [3.0, 4.0, 6.0]
    assert both.damping[robot.nv - 1 :].tolist() == [1.0, 0.1, 0.2, 0.3]
    assert both.no_rows.matrix.shape == (0, both.size)
