"""What tests of the native core share: tasks of all kinds, and what it is compared with."""

import numpy as np

from tests.conftest import random_state
from wbc.controllers.controller import Controller
from wbc.qp.problem import QP
from wbc.robot import Robot, Snapshot
from wbc.rotations import exp_rotation
from wbc.tasks import (
    ComTask,
    DampingTask,
    ForceTask,
    InertiaTask,
    MomentumTask,
    OrientationTask,
    PoseTask,
    PositionTask,
    PostureTask,
)

FIELDS = ("P", "g", "A", "b", "C", "l", "u", "lower", "upper")


def every_task(robot: Robot, rng: np.random.Generator, here: Snapshot) -> list:
    """One of each kind that the core knows, with targets anywhere and moving."""
    there = robot.snapshot(*random_state(robot, rng))
    frame, other = (robot.frame_names[k] for k in rng.integers(len(robot.frame_names), size=2))
    turn = rng.normal(size=3)
    R = here.rotation(frame) @ exp_rotation(2.5 * rng.random() * turn / np.linalg.norm(turn))
    Q = here.rotation(other) @ exp_rotation(turn / np.linalg.norm(turn))
    tasks = [
        InertiaTask(robot, there.inertia, per_mass=True, weight=10.0, gain=0.2),
        InertiaTask(
            robot,
            here.inertia_in("base"),
            frame="base",
            components=("xx", "yz"),
            name="shape",
            lm_damping=0.1,
        ),
        InertiaTask(robot, 1.0, components=("trace",), name="trace"),
        ComTask(robot, there.com, weight=10.0, gain_per_second=20.0, lm_damping=0.01),
        ComTask(robot, there.com, axes=("z", "x"), name="zx", curvature_damping=False),
        OrientationTask(robot, frame, R, name="turn", gain=0.5, lm_damping=0.2),
        PositionTask(robot, frame, here.com, axes=("y",), name="place", weight=3.0),
        PoseTask(robot, other, here.com, Q, weight=(1, 2, 3, 4, 5, 6), name="pose"),
        MomentumTask(robot, rng.normal(size=6), components=("kz", "lx"), weight=0.3),
        PostureTask(robot, there.q, weight=0.1, gain=0.1),
        PostureTask(robot, here.q, joints={robot.joint_names[1]: 0.0}, name="few", lm_damping=1.0),
    ]
    moving = rng.normal(size=(2, 6))
    pushed = rng.normal(size=(2, 6))
    tasks[0].set_target(there.inertia, here.inertia, there.inertia)
    tasks[1].set_target([1.0, 0.1, 0.0, 0.9, 0.2, 0.3], *rng.normal(size=(2, 6)))
    tasks[3].set_target(there.com, moving[0, :3], pushed[0, :3])
    tasks[5].set_target(R, moving[0, 3:], pushed[0, 3:])
    tasks[7].set_target(here.com, Q, moving[1], pushed[1])
    tasks[8].set_target(tasks[8].target, rng.normal(size=6))
    tasks[9].set_target(there.q, *rng.normal(size=(2, robot.nv)))
    return tasks


def assert_same_entries(found: QP, plain: QP) -> None:
    """Every array of two QPs is the same, to 1e-10 of its largest entry."""
    for field in FIELDS:
        ours, theirs = getattr(found, field), getattr(plain, field)
        assert ours.shape == theirs.shape
        finite = np.isfinite(theirs)
        np.testing.assert_array_equal(ours[~finite], theirs[~finite], err_msg=field)
        scale = max(1.0, np.abs(theirs[finite]).max(initial=0.0))
        np.testing.assert_allclose(
            ours[finite], theirs[finite], rtol=0.0, atol=1e-10 * scale, err_msg=field
        )


def assert_same_qp(controller: Controller, snapshot: Snapshot) -> None:
    """The core's QP and errors are the Python tick's, to 1e-10 of the largest entry."""
    found = controller._native_problem(controller._native, snapshot)
    assert found is not None
    tick = Controller._step(controller, snapshot)
    assert tick.qp.g.size == controller.plan.decision.size  # not the QP of a relaxed tick
    assert_same_entries(found.qp, tick.qp)
    assert found.qp.labels == tick.qp.labels
    for task in controller.tasks:
        # The deviation of a rate is not its error, and forces are those of the answer.
        if not isinstance(task, DampingTask | MomentumTask | ForceTask):
            np.testing.assert_allclose(found.errors[task.name], tick.errors[task.name], atol=1e-10)
