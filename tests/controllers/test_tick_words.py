"""What a tick tells: its names, what holds it back, and why there is no command."""

from dataclasses import replace

import numpy as np
import pytest

from wbc.constraints import Limits, PositionBox, support
from wbc.controllers import KinematicController, TorqueController
from wbc.errors import ControllerFailure
from wbc.qp import Labels, Status
from wbc.qp.active_set import ActiveSet
from wbc.robot import Robot
from wbc.tasks import ComTask, PositionTask, PostureTask


@pytest.mark.parametrize(
    ("count", "told"),
    [(1, "t0"), (3, "t0, t1, t2"), (4, "t0, t1, t2 and 1 more"), (6, "t0, t1, t2 and 3 more")],
)
def test_three_errors_are_named(hoap2, count: int, told: str) -> None:
    here = hoap2.snapshot(hoap2.posture())
    tasks = [ComTask(hoap2, here.com, name=f"t{k}") for k in range(count)]
    tick = KinematicController(hoap2, tasks, contacts=()).step(here)
    assert repr(tick) == f"Tick(solved, nv={hoap2.nv}, errors: {told})"
    assert tick.report() == "solved" and tick.ok


@pytest.mark.parametrize("level", [KinematicController, TorqueController])
def test_ticks_are_told_apart_and_looked_up(hoap2, level) -> None:
    """By which they are, as robots and contacts: comparing their arrays was a ValueError."""
    here = hoap2.snapshot(hoap2.posture())
    controller = level(hoap2, [ComTask(hoap2, here.com)], contacts=())
    first, second = controller.step(here), controller.step(here)
    assert first != second and [first, second].index(second) == 1
    assert len({first, second, first}) == 2


def test_rows_that_hold_back_are_told_the_strongest_first(hoap2) -> None:
    """Of scripted multipliers: names once, on levels above as well, noise and zeros left out."""
    here = hoap2.snapshot(hoap2.posture())
    box = PositionBox(hoap2, "base", here.position("base") - 1.0, here.position("base") + 1.0)
    tick = KinematicController(hoap2, [ComTask(hoap2, here.com)], contacts=support(here, "left"),
                               constraints=[box]).step(here)  # fmt: skip
    names = tick.qp.labels.inequality
    assert len(names) == 6 and tick.active == ()

    def active(z: list[float], y: list[float] = (), labels: Labels | None = None) -> tuple:
        solution = tick.solution._replace(z=np.array(z), y=np.array([*y]))
        given = labels or Labels((), names, tick.qp.labels.variables)
        return replace(tick, solution=solution, qp=tick.qp._replace(labels=given)).active

    assert active([0.0, -3.0, 0.0, 5.0, 0.0, 0.0]) == (names[3], names[1])
    twice = Labels((names[2], "com x"), (names[0], names[0], *names[2:]), ())
    assert active([1.0, -2.0, 0.0, 0.0, 0.0, 0.0], [7.0, 9.0], twice) == (names[2], names[0])
    # What is a millionth of the strongest, or 1e-9 of nothing much, is what solvers leave.
    assert active([2e-4, 1e2, -5e-5, 0.0, 0.0, 0.0]) == (names[1], names[0])
    assert active([5e-10, 0.0, 0.0, -2e-9, 0.0, 0.0]) == (names[3],)
    failed = tick.solution._replace(status=Status.FAILED, z=np.ones(6))
    assert replace(tick, solution=failed, status=Status.FAILED).active == ()


def test_a_command_that_misses_rows_says_which(hoap2) -> None:
    """A foot held a metre away: half the velocity, none, or the nearest; each policy by name."""
    here = hoap2.snapshot(hoap2.posture(), 0.1 * np.ones(hoap2.nv))
    left, right = support(here, "double")
    far = type(left)(hoap2, left.frame, left.position + [1.0, 0.0, 0.0], left.rotation)
    limits = Limits(hoap2)
    expected = {"hold": np.zeros(hoap2.nv), "damp": 0.5 * here.v}
    controllers = {
        policy: KinematicController(
            hoap2, [PostureTask(hoap2, here.q)], contacts=[far, right], limits=limits,
            on_failure=policy,
        )
        for policy in ("hold", "damp", "closest", "raise")
    }  # fmt: skip
    for policy, controller in controllers.items():
        if policy == "raise":
            with pytest.raises(ControllerFailure, match="left_sole") as caught:
                controller.step(here)
            assert caught.value.tick.status is Status.INFEASIBLE
            continue
        tick = controller.step(here)
        assert tick.status is Status.INFEASIBLE and not tick.ok and tick.policy == policy
        assert f"command by {policy!r}" in tick.report() and "left_sole" in tick.report()
        assert any(row.label.startswith("left_sole") for row in tick.conflict.rows)
        lower, upper = limits.box(here, controller.dt)
        assert (tick.velocity >= lower - 1e-9).all() and (tick.velocity <= upper + 1e-9).all()
        if policy in expected:
            np.testing.assert_allclose(tick.velocity, np.clip(expected[policy], lower, upper))
            assert not tick.slack
            continue
        assert ", which misses " in tick.report()
        J, target = tick.qp.A, tick.qp.b
        missed = J @ tick.velocity - target
        for name, by in tick.slack.items():
            assert missed[tick.qp.labels.equality.index(name)] == pytest.approx(by, rel=1e-6)
        assert max(map(abs, tick.slack.values())) > 1.0
        assert np.linalg.norm(missed) < np.linalg.norm(target), "nearer than standing still is"
    fast = hoap2.snapshot(here.q, 10.0 * here.v)
    box = limits.emergency_braking_box(fast, controller.dt)
    found = controllers["damp"].step(fast).velocity
    np.testing.assert_array_equal(found, np.clip(0.5 * fast.v, *box))


def test_a_failed_torque_tick_brings_joints_to_rest(hoap2, monkeypatch) -> None:
    """Where no solver answers: joints slow down by dt / 50 ms, within the torque bounds."""

    for name in ("solve", "solve_soft"):
        honest = getattr(ActiveSet, name)

        def silent(self, qp, *given, honest=honest, **named):
            found = honest(self, qp, *given, **named)
            return found._replace(status=Status.FAILED, x=found.x * np.nan)

        monkeypatch.setattr(ActiveSet, name, silent)

    class Lazy:
        name = "lazy"

        def solve(self, qp, workspace=None, quick=False):
            return ActiveSet().solve(qp)

    rng = np.random.default_rng(1)
    here = hoap2.snapshot(hoap2.posture(), 0.1 * rng.normal(size=hoap2.nv))
    for dt, share in ((0.002, 0.96), (0.1, 0.0)):
        controller = TorqueController(
            hoap2, [PositionTask(hoap2, "left_hand", here.com)], contacts=support(here, "double"),
            solver=Lazy(), dt=dt,
        )  # fmt: skip
        tick = controller.step(here)
        assert not tick.ok and tick.policy == "damp"
        expected = np.r_[here.v[:6], share * here.v[6:]]
        np.testing.assert_allclose(tick.velocity, expected, atol=1e-12)
        np.testing.assert_allclose(tick.acceleration, (expected - here.v) / dt, atol=1e-9)
        bounds = controller.torque_bounds
        raw = here.mass_matrix @ tick.acceleration + here.bias + robot_damping(hoap2, expected)
        np.testing.assert_allclose(tick.torque, np.clip(raw[6:], -bounds, bounds), atol=1e-6)
        controller.on_failure = "raise"
        with pytest.raises(ControllerFailure):
            controller.step(here)


def robot_damping(robot: Robot, v: np.ndarray) -> np.ndarray:
    return np.r_[np.zeros(6), robot.damping * v[6:]]
