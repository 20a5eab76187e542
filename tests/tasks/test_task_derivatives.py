"""One finite-difference check for every task: Jacobian and drift, robots x frames x random states.

The oracle is the task's own error at displaced states: it shares no code with the derivatives.
Central differences with h = 1e-5 are good to about h^2 = 1e-10 times the third derivative, plus
rounding of 1e-16 / h = 1e-11: 1e-6 relative leaves room for both and for nothing else.
"""

from collections.abc import Callable

import numpy as np
import pytest

from tests.tasks.frames import some_frame
from wbc.robot import Robot, Snapshot
from wbc.rotations import exp_rotation
from wbc.tasks import (
    AxisTask,
    ComTask,
    DistanceTask,
    InertiaTask,
    MomentumTask,
    OrientationTask,
    PoseTask,
    PositionTask,
    PostureTask,
    PrincipalInertiaTask,
    RelativePoseTask,
    Task,
)

H = 1e-5
RELATIVE = 1e-6


def near(R: np.ndarray) -> np.ndarray:
    return R @ exp_rotation(np.array([0.4, -0.7, 0.5]))


def spread(moments: np.ndarray) -> np.ndarray:
    """Targets closer together than the moments: there the derivative is not limited."""
    return moments.mean() + 0.5 * (moments - moments.mean())


MAKERS: dict[str, Callable[[Robot, Snapshot, str], Task]] = {
    "inertia world": lambda r, s, f: InertiaTask(r, 1.3 * s.inertia),
    "inertia base": lambda r, s, f: InertiaTask(r, 0.8 * s.inertia, frame="base"),
    "inertia frame": lambda r, s, f: InertiaTask(r, 0.8 * s.inertia, frame=f, per_mass=True),
    "inertia diagonal": lambda r, s, f: InertiaTask(
        r, [1.0, 2.0, 3.0], components=("xx", "yy", "zz"), frame="base"
    ),
    "inertia mask": lambda r, s, f: InertiaTask(r, s.inertia, components=("xz", "yy"), frame=f),
    "inertia trace": lambda r, s, f: InertiaTask(r, 4.0, components=("trace",)),
    "inertia about world": lambda r, s, f: InertiaTask(r, 1.3 * s.inertia, about="world"),
    "inertia about a point": lambda r, s, f: InertiaTask(
        r, s.inertia, frame="base", about=[0.3, -0.8, 0.1], per_mass=True
    ),
    "inertia about base": lambda r, s, f: InertiaTask(r, s.inertia, frame="base", about="base"),
    "inertia about a frame": lambda r, s, f: InertiaTask(
        r, s.inertia, components=("xz", "yy", "zz"), about=f
    ),
    "inertia about a frame, in its axes": lambda r, s, f: InertiaTask(
        r, s.inertia, frame=f, about=f
    ),
    "inertia trace about a frame": lambda r, s, f: InertiaTask(
        r, 4.0, components=("trace",), about=f
    ),
    "principal inertia": lambda r, s, f: PrincipalInertiaTask(
        r, spread(np.linalg.eigvalsh(s.inertia))
    ),
    "com": lambda r, s, f: ComTask(r, [0.1, 0.2, 0.3]),
    "com mask": lambda r, s, f: ComTask(r, [0.1, 0.2, 0.3], axes=("z", "x")),
    "position": lambda r, s, f: PositionTask(r, f, [0.5, -0.2, 0.3]),
    "orientation": lambda r, s, f: OrientationTask(r, f, near(s.rotation(f))),
    "orientation at target": lambda r, s, f: OrientationTask(r, f, s.rotation(f)),
    "pose": lambda r, s, f: PoseTask(r, f, [0.5, -0.2, 0.3], near(s.rotation(f))),
    "axis": lambda r, s, f: AxisTask(r, f, [0.3, -0.5, 1.0], axis=[1, 1, 0]),
    "relative pose": lambda r, s, f: RelativePoseTask(
        r, f, "base", [0.2, 0.1, -0.3], near(s.rotation("base").T @ s.rotation(f))
    ),
    "relative pose of a frame": lambda r, s, f: RelativePoseTask(
        r, "base", f, [0.2, 0.1, -0.3], np.eye(3), components=("z", "x")
    ),
    "distance": lambda r, s, f: DistanceTask(r, f, "base", 0.3),
    "posture": lambda r, s, f: PostureTask(r, r.postures["neutral"], joints={"*": 2.0}),
}


def assert_close(actual: np.ndarray, expected: np.ndarray, scale: float) -> None:
    np.testing.assert_allclose(actual, expected, rtol=0, atol=RELATIVE * scale)


@pytest.mark.parametrize("maker", MAKERS.values(), ids=MAKERS)
def test_jacobian_and_drift(
    maker: Callable[[Robot, Snapshot, str], Task],
    robot: Robot,
    rng: np.random.Generator,
    random_snapshot: Callable[[Robot, np.random.Generator], Snapshot],
) -> None:
    """Along random directions: one that is wrong in any column is wrong along all of them."""
    for _ in range(3):
        here = random_snapshot(robot, rng)
        task = maker(robot, here, some_frame(robot))
        residual, drift = task.residual(here), task.drift(here)
        ways = rng.normal(size=(2, robot.nv))

        def error_at(step: np.ndarray, here: Snapshot = here, task: Task = task) -> np.ndarray:
            return task.residual(robot.snapshot(robot.integrate(here.q, step, 1.0), here.v)).error

        differences = [(error_at(H * way) - error_at(-H * way)) / (2 * H) for way in ways]
        size = np.abs(differences).max()
        assert_close(residual.jacobian @ ways.T, np.transpose(differences), max(1e-3, size))

        def rate_at(t: float, here: Snapshot = here, task: Task = task) -> np.ndarray:
            there = robot.snapshot(robot.integrate(here.q, here.v, t), here.v)
            return task.residual(there).rate(here.v)

        second = (rate_at(H) - rate_at(-H)) / (2 * H)
        assert_close(drift, second, max(1.0, np.abs(second).max()))


def test_momentum(
    robot: Robot,
    rng: np.random.Generator,
    random_snapshot: Callable[[Robot, np.random.Generator], Snapshot],
) -> None:
    here = random_snapshot(robot, rng)
    target = np.arange(6.0)
    task = MomentumTask(robot, target)
    residual = task.residual(here)
    # Oracle of the momentum itself: linear from the CoM's motion by differences of the position.
    ahead = robot.snapshot(robot.integrate(here.q, here.v, H)).com
    behind = robot.snapshot(robot.integrate(here.q, here.v, -H)).com
    linear = robot.mass * (ahead - behind) / (2 * H)
    assert_close(residual.rate(here.v)[:3] + target[:3], linear, max(1.0, np.abs(linear).max()))
    np.testing.assert_allclose(task.deviation(here, residual), here.momentum - target)

    def momentum_at(t: float) -> np.ndarray:
        return robot.snapshot(robot.integrate(here.q, here.v, t), here.v).momentum

    second = (momentum_at(H) - momentum_at(-H)) / (2 * H)
    assert_close(task.drift(here), second, max(1.0, np.abs(second).max()))


def test_target_rates_enter_both_levels(robot: Robot, rng, random_snapshot) -> None:
    """A target moving at r and accelerating at a: rate = J v - r, second derivative = ... - a."""
    here = random_snapshot(robot, rng)
    frame = some_frame(robot)
    rate, acceleration = np.array([1.0, -2.0, 0.5]), np.array([0.3, 0.1, -0.7])
    for task in (ComTask(robot, [0, 0, 0]), PositionTask(robot, frame, [0, 0, 0])):
        still, drift = task.residual(here).rate(here.v), task.drift(here)
        task.set_target([0, 0, 0], rate, acceleration)
        np.testing.assert_allclose(task.residual(here).rate(here.v), still - rate)
        np.testing.assert_allclose(task.drift(here), drift - acceleration)
    shape = InertiaTask(robot, np.eye(3))
    still = shape.residual(here).rate(here.v)
    shape.set_target(np.eye(3), rate=np.diag(rate))
    expected = still - np.array([rate[0], 0, 0, rate[1], 0, rate[2]])
    np.testing.assert_allclose(shape.residual(here).rate(here.v), expected)
