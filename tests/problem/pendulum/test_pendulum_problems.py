"""The pendulum's problems that ship: each does what it is there for."""

from pathlib import Path

import numpy as np
import pytest

from wbc.problem import load_problem
from wbc.problem.pendulum.problem import PendulumProblem
from wbc.problem.pendulum.result import PendulumStatus
from wbc.rmp.plan import load_plan
from wbc.view import plot_pendulum

FOLDER = Path(__file__).parents[3] / "problems"


def load(name: str, **overrides: object) -> PendulumProblem:
    problem = load_problem(FOLDER / f"{name}.yaml", overrides)
    assert isinstance(problem, PendulumProblem)
    return problem


def test_history_obeys_newton_and_the_definition_of_the_cop() -> None:
    history = load("rmp_push_qp").run().history
    # Differences of the CoM: an oracle that knows nothing of the law. Error of second order in
    # time; the push itself is a jump, so only later moments count.
    later = history.time > 0.3
    dt = history.time[1] - history.time[0]
    slope = np.gradient(history.com, dt, axis=0)
    np.testing.assert_allclose(slope[later][:-1], history.com_velocity[later][:-1], atol=2e-3)
    # The line from the CMP through the CoM is that of the ground's force: M (c'' - g).
    acceleration = np.gradient(history.com_velocity, dt, axis=0)
    force = acceleration + (0.0, 0.0, 9.81)
    meets = history.com - force * (history.com[:, 2:] / force[:, 2:])
    # Commands are held over a step, so the force jumps: compare where it hardly changes.
    calm = later & (np.abs(np.gradient(history.cmp[:, 0], dt)) < 0.05)
    assert calm.sum() > 1000
    np.testing.assert_allclose(meets[calm], history.cmp[calm], atol=2e-3)
    # CoP and CMP differ by the rate of the angular momentum about the CoM.
    rate = np.gradient(history.momentum, dt, axis=0)
    lever = np.column_stack((rate[:, 1], -rate[:, 0])) / (35.0 * force[:, 2:])
    apart = history.cmp[:, :2] - history.cop[:, :2]
    np.testing.assert_allclose(apart[calm], lever[calm], atol=2e-3)


def test_spin_law_keeps_its_momentum() -> None:
    result = load("rmp_spin").run()
    spin = result.history.momentum
    np.testing.assert_allclose(spin, np.broadcast_to(spin[0], spin.shape), rtol=1e-9, atol=1e-12)
    # I w with the inertia halved thrice as fast: M r^2 6 rad/s at the end is M r^2 2 rad/s before.
    r = result.history.radii[:, 0]
    assert r[-1] ** 2 * 6.0 == pytest.approx(r[0] ** 2 * 2.0, rel=1e-6)


def test_an_overridden_push_that_is_too_hard_ends_in_a_fall() -> None:
    result = load("rmp_push_qp", pushes=[{"time": 0.0, "impulse": [60.0, 0.0, 0.0]}]).run()
    assert not result.status.good
    assert result.reason


def test_results_are_saved_whole(tmp_path: Path) -> None:
    result = load("plan_hop").run()
    result.save(tmp_path / "hop.json")
    result.save(tmp_path / "hop.npz")
    with np.load(tmp_path / "hop.npz") as file:
        np.testing.assert_array_equal(file["com"], result.history.com)
        assert file["support_times"].shape == (2, 2)
    # The same file is the plan's own: nothing needs to be solved again.
    np.testing.assert_allclose(load_plan(tmp_path / "hop.npz").at(0.0).com[0], (0.0, 0.0, 0.75))
    assert '"status": "planned"' in (tmp_path / "hop.json").read_text()


@pytest.mark.parametrize(
    ("overrides", "status"),
    [
        ({"gravity": 0.0}, PendulumStatus.CONTACT_LOST),
        ({"start.theta": 1e8}, PendulumStatus.DIVERGED),
        ({"start.radii": 1e-9}, PendulumStatus.DIVERGED),
        ({"plant.mass": 1e9}, PendulumStatus.CONTACT_LOST),
    ],
)
def test_a_run_that_ends_before_its_first_step_has_its_start(
    overrides: dict[str, object], status: PendulumStatus, tmp_path: Path
) -> None:
    result = load("rmp_static_lean", **overrides).run()
    assert result.status is status
    assert "at 0 s" in result.reason or "after 0 s" in result.reason
    assert len(result.history.time) == len(result.history.phase) == len(result.history.com) == 1
    assert all(np.isfinite(list(result.measures.values())))
    result.save(tmp_path / "none.npz")
    plot_pendulum(result.history, tmp_path / "none.png")


def test_measures_are_of_the_end_and_history_reaches_it() -> None:
    result = load("rmp_static_lean").run()
    history, q = result.history, result.arrays["q"]
    assert history.time[-1] == pytest.approx(1.9)
    # A leg of length r_l at the angle theta.
    place = q[-1, 2] * np.array((np.cos(q[-1, 1]), 0.0, np.sin(q[-1, 1])))
    np.testing.assert_allclose(history.com[-1], place, atol=1e-12)
    assert result.measures["leg"] == pytest.approx(abs(q[-1, 1] - 1.43), abs=1e-12)
    assert result.measures["worst_leg"] == pytest.approx(np.abs(q[:, 1] - 1.43).max(), abs=1e-12)


@pytest.mark.slow
def test_a_broken_bound_is_no_success() -> None:
    result = load("rmp_lqr_solid", **{"bounds.wheel_angle": 0.5}).run()
    assert result.status is PendulumStatus.NOT_REACHED
    assert result.measures["margin to wheel_angle"] < -0.1
    assert "out of bounds: wheel_angle by" in result.reason


SPINNING = {
    "model": "rmp_solid",
    "start": {"leg_length": 0.5, "radii": [0.3, 0.25, 0.2], "rates": {"spin": [0.0, 2.0, 0.0]}},
    "bounds": {"polygon": [[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]]},
    "stop.accept.spin": 0.1,
}


@pytest.mark.slow
def test_a_body_that_tumbles_has_not_the_spin_that_was_wanted() -> None:
    """About the middle axis, with an error of a millionth: it turns over after a while."""
    calm = load("rmp_spin", **SPINNING, **{"law.spin": 2.2}).run()
    assert calm.status is PendulumStatus.COMPLETED, calm.reason
    start = SPINNING["start"] | {"rates": {"spin": [1.9e-6, 2.0, 0.0]}}  # type: ignore[operator]
    turned = load(
        "rmp_spin",
        **SPINNING | {"start": start, "stop.duration": 40.0, "stop.dt": 0.005},
        **{"law.spin": 2.2},
    ).run()
    assert turned.status is PendulumStatus.NOT_REACHED
    # All of the rate counts, not that of the axis about which it happens to spin most.
    rate = turned.arrays["v"][-1, 5:8]
    assert turned.measures["spin"] == pytest.approx(np.linalg.norm(rate - (0.0, 2.2, 0.0)))
    assert turned.measures["spin"] > 0.5


@pytest.mark.slow
def test_goal_is_where_the_law_wants_the_leg() -> None:
    lean = {"start": {"leg_length": 0.5, "radii": 0.3, "theta": 1.5, "rates": {"spin": 2.0}}}
    spun = load("rmp_spin", **lean, bounds={"polygon": [-0.2, 0.2], "radius": [0.05, 0.4]}).run()
    assert spun.measures["worst_leg"] < 1e-6
    law = {"type": "momentum_qp", "com": [0.03, 0.02, 0.7]}
    moved = load("rmp_push_qp", law=law, pushes=[]).run()
    assert moved.status is PendulumStatus.COMPLETED, moved.reason
    # It starts upright, and ends with the CoM where it should rest.
    assert moved.measures["worst_leg"] == pytest.approx(np.arctan(np.hypot(0.03, 0.02) / 0.7), 1e-3)
    np.testing.assert_allclose(moved.history.com[-1], (0.03, 0.02, 0.7), atol=1e-3)
