"""Tasks whose rows are worked out in Python, in QPs of the native core."""

import itertools
from time import sleep

import numpy as np
import pytest

from tests.conftest import random_state
from tests.controllers.native_ticks import assert_same_qp, every_task
from tests.needs import needs_core
from wbc.constraints import Limits, SelfCollision, support
from wbc.controllers import KinematicController, TorqueController
from wbc.controllers.controller import Controller
from wbc.errors import InvalidInputError
from wbc.laws import Residual
from wbc.robot import Robot
from wbc.tasks import (
    ComTask,
    ContactForceTask,
    CopTask,
    DampingTask,
    DistanceTask,
    ForceRateTask,
    InertiaTask,
    LoadShareTask,
    PoseTask,
    PostureTask,
    Task,
    TorqueTask,
)

pytestmark = needs_core


class Half(ComTask):
    """Inherits a description that is not its own: its error is another."""

    def residual(self, snapshot):
        found = super().residual(snapshot)
        return found._replace(error=0.5 * found.error)


class Wide(Task):
    """One's own: joints 0 and 1 together, their sum at ``target``; ``spoilt`` is added."""

    def __init__(self, robot: Robot, target: float, **law) -> None:
        super().__init__(robot, "sum", ("sum",), **law)
        self.wanted, self.spoilt = target, 0.0

    def residual(self, snapshot):
        J = np.zeros((1, self.robot.nv))
        J[0, 6:8] = 1.0
        error = snapshot.joint_positions[:2].sum(keepdims=True) - self.wanted + self.spoilt
        return Residual(error, J, np.zeros(1), curvature_bound=0.3)

    def drift(self, snapshot):
        return np.zeros(1)


class Pair(Task):
    """Two rows, of whose error and bias one entry is missing if ``shortened``."""

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot, "pair", ("a", "b"))
        self.shortened, self.asked, self.wait = False, 0, 0.0

    def residual(self, snapshot):
        self.asked += 1
        sleep(self.wait)
        J = np.eye(self.robot.nv)[6:8]
        short = np.zeros(1 if self.shortened else 2)
        return Residual(short + 0.1, J, short)

    def drift(self, snapshot):
        return np.zeros(2)


def own_tasks(robot: Robot, rng: np.random.Generator, here) -> list:
    """Tasks of all kinds that the core does not know: one's own, patched, in other axes."""
    frames = [frame for frame in robot.frame_names[10:] if frame != "base"]  # which the core knows
    left, right = rng.choice(frames, 2).tolist()
    patched = ComTask(robot, here.com + 0.1, name="patched", weight=0.5)
    patched.__dict__["residual"] = ComTask(robot, here.com).residual
    return [
        Half(robot, here.com + rng.normal(size=3), name="half", weight=3.0, lm_damping=0.1),
        Wide(robot, 0.3, weight=2.0, gain=0.3),
        DampingTask(robot, weight=0.2),
        InertiaTask(robot, here.inertia, frame=left, name="turned", gain=0.2, weight=2.0),
        InertiaTask(robot, here.inertia, about=left, name="about a frame", gain=0.2),
        InertiaTask(robot, here.inertia, frame="base", about=[0, 1, 0], name="about a point"),
        DistanceTask(robot, left, right, 0.4, name="apart"),
        PoseTask(robot, left, here.com, np.eye(3), name="damped", lm_damping=1.0),
        patched,
    ]


@pytest.mark.parametrize("name", ["hoap2_like", "g1_27", "talos"])
@pytest.mark.parametrize("level", [KinematicController, TorqueController])
def test_the_same_qp_and_errors(name: str, level, rng, native) -> None:
    robot = native(name)
    compared = 0
    for _ in range(8):
        snapshot = robot.snapshot(*random_state(robot, rng))
        tasks = [*own_tasks(robot, rng, snapshot), *every_task(robot, rng, snapshot)]
        tasks = [tasks[k] for k in rng.permutation(len(tasks))]
        contacts = support(robot.snapshot(robot.posture("standing")), "left")
        controller = level(robot, tasks, contacts=contacts, limits=None, solver="active_set")
        # Damping by the error of a pose is of the velocity level.
        assert len(controller.native.given) == (9 if level is KinematicController else 8)
        if Controller._step(controller, snapshot).policy is None:
            assert_same_qp(controller, snapshot)
            compared += 1
    assert compared > 3


def force_tasks(robot: Robot, here) -> list:
    left = robot.feet["left"].frame
    return [
        CopTask(robot, (*here.com[:2], 0.0), weight=5.0),
        CopTask(robot, (0.01, 0.0), frame=left, weight=0.5),
        LoadShareTask(robot, {left: 3, robot.feet["right"].frame: 2}),
        ContactForceTask(robot, left, [0.0, 0.0, 50.0, 0.0, 0.0, 0.0], weight=0.2),
        ForceRateTask(robot, weight=0.1),
        TorqueTask(robot, weight=0.01),
    ]


@pytest.mark.parametrize("name", ["hoap2_like", "g1_27"])
def test_forces_are_decided_by_the_core_as_by_python(name: str, rng, native) -> None:
    """Same QPs, commands and errors over a loop in which feet come and go, and rows with them."""
    robot = native(name)
    q = robot.posture("standing")
    here = robot.snapshot(q, np.zeros(robot.nv))
    posture = PostureTask(robot, q, weight=0.3)
    tasks = [ComTask(robot, here.com, weight=3.0), posture, *force_tasks(robot, here)]
    both = support(here, "double")
    fast, plain = (
        TorqueController(
            robot, tasks, contacts=both, limits=Limits(robot), dt=0.002, solver="active_set"
        )
        for _ in range(2)
    )
    plain._native, plain._native_plan = None, lambda backend, margin: None  # also after changes
    solvers, v = set(), np.zeros(robot.nv)
    for k in range(40):
        if k in (15, 30):
            for controller in (fast, plain):
                controller.set_contacts(both[: 1 + (k == 30)], ramp=0.01)
        tasks[2].set_target((here.com[0] + 0.01 * np.sin(k), here.com[1], 0.0))
        snapshot = robot.snapshot(q, v)
        found, wanted = fast.step(snapshot), plain.step(snapshot)
        assert found.status.value == wanted.status.value == "solved"
        assert found.policy == wanted.policy
        scale = np.abs(wanted.torque).max()
        np.testing.assert_allclose(found.torque, wanted.torque, rtol=0.0, atol=1e-8 * scale)
        np.testing.assert_allclose(found.velocity, wanted.velocity, rtol=0.0, atol=1e-9)
        assert list(found.errors) == list(wanted.errors)
        for one, error in wanted.errors.items():
            size = max(1.0, np.abs(error).max())
            np.testing.assert_allclose(found.errors[one], error, rtol=0.0, atol=1e-6 * size)
        solvers.add(found.solution.solver)
        q, v = robot.integrate(q, found.velocity, 0.002), found.velocity
    assert solvers <= {"cholesky", "active_set"}
    assert fast.native is not None and not fast.native.given


def test_margins_of_the_core_go_with_rows_of_python(native) -> None:
    robot = native("g1_27")
    q = robot.posture("standing")
    here = robot.snapshot(q)
    tasks = [Half(robot, here.com, weight=10.0), PostureTask(robot, q, weight=0.1)]
    apart = SelfCollision(robot, margin=0.01, pairs=10)
    contacts = support(here, "double")
    fast, plain = (
        KinematicController(
            robot,
            tasks,
            contacts=contacts,
            limits=Limits(robot),
            constraints=[apart],
            solver="active_set",
        )
        for _ in range(2)
    )
    assert fast.native.margin is not None
    for k in range(10):
        tasks[0].set_target(here.com + [0.0, 0.02 * np.sin(k), -0.01])
        snapshot = robot.snapshot(q)
        found, wanted = fast.step(snapshot), Controller._step(plain, snapshot)
        np.testing.assert_allclose(found.velocity, wanted.velocity, rtol=0.0, atol=1e-8)
        q = robot.integrate(q, found.velocity, fast.dt)


@pytest.mark.parametrize("level", [KinematicController, TorqueController])
def test_what_one_s_own_task_returns_is_judged_as_in_python(level, native) -> None:
    """NaN, and rows of another size, in the middle of a loop: the errors of the Python tick."""
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"), np.zeros(robot.nv))
    own = Wide(robot, 0.1)
    controller = level(
        robot, [own, PostureTask(robot, here.q, weight=0.1)], contacts=support(here, "double")
    )
    assert controller.native is not None and controller.step(here).ok
    own.spoilt = np.nan
    with pytest.raises(InvalidInputError, match="NaN"):
        controller.step(here)
    own.spoilt = 0.0
    assert controller.step(here).ok
    own.spoilt = np.zeros(2)
    with pytest.raises(InvalidInputError, match="sum"):
        controller.step(here)
    # What would be one error for two rows is refused as well.
    pair = Pair(robot)
    controller = level(
        robot, [pair, PostureTask(robot, here.q, weight=0.1)], contacts=support(here, "double")
    )
    assert controller.step(here).ok
    pair.shortened = True
    with pytest.raises(InvalidInputError, match="pair"):
        controller.step(here)


def test_what_is_no_plain_cost_is_left_to_python(native) -> None:
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"))
    posture = PostureTask(robot, here.q, weight=0.1)
    for task in (
        Half(robot, here.com, singular_threshold=0.1),
        InertiaTask(robot, here.inertia, second_order=True),
    ):
        controller = KinematicController(robot, [task, posture], contacts=())
        assert controller.native is None and controller.step(here).ok
    # Later changes are noticed too.
    half = Half(robot, here.com)
    controller = KinematicController(robot, [half, posture], contacts=(), solver="active_set")
    used = [controller.step(here).solution.solver]
    half.singular_threshold = 10.0
    tick = controller.step(here)
    assert used == ["cholesky"] and "com" in tick.singular


def test_a_tick_keeps_what_python_worked_out(native) -> None:
    """Errors that are asked for later are those of the tick, whatever came after it."""
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"), np.zeros(robot.nv))
    half = Half(robot, here.com)
    posture = PostureTask(robot, here.q, weight=0.1)
    for level in (KinematicController, TorqueController):
        controller = level(robot, [half, posture], contacts=support(here, "double"))
        ticks = []
        for shift in (0.1, 0.2):
            half.set_target(here.com - shift)
            ticks.append(controller.step(here))
        for tick, shift in zip(ticks, (0.1, 0.2), strict=True):
            np.testing.assert_allclose(tick.errors["com"], 0.5 * shift * np.ones(3), atol=1e-12)
        for one, other in itertools.pairwise(ticks):
            assert not np.array_equal(one.qp.g, other.qp.g)


@pytest.mark.parametrize("level", [KinematicController, TorqueController])
def test_times_of_a_tick_count_what_python_works_out(level, native) -> None:
    robot = native("hoap2_like")
    here = robot.snapshot(robot.posture("standing"), np.zeros(robot.nv))
    pair = Pair(robot)
    controller = level(robot, [pair], contacts=support(here, "double"))
    controller.step(here)
    pair.wait, pair.asked = 0.01, 0
    tick = controller.step(here)
    assert pair.asked == 1 and tick.times.tasks >= 0.01


def test_one_s_own_task_is_not_asked_again_for_the_plan_without_margins(native) -> None:
    """Where an answer would lead inside a margin: once for the core, once for the Python tick."""
    robot = native("g1_27")
    q = robot.posture("standing")
    here = robot.snapshot(q)
    pair = Pair(robot)
    apart = SelfCollision(robot, margin=0.01, pairs=10)
    beyond = np.array(q)
    beyond[10] = robot.limits.upper[3] + 0.01  # is done in Python
    controller = KinematicController(
        robot, [pair], contacts=support(here, "double"), constraints=[apart], solver="active_set"
    )
    controller.step(here)
    pair.asked = 0
    controller.step(robot.snapshot(beyond))
    assert pair.asked <= 2
