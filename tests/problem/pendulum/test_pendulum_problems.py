"""The pendulum's problems that ship do what they are for; mistakes are answered with their line."""

from pathlib import Path

import numpy as np
import pytest

from tests.problem.loading import problem_of
from wbc.errors import ProblemFileError, WbcError
from wbc.problem import load_problem
from wbc.problem.pendulum.plan import Planning
from wbc.problem.pendulum.problem import PendulumProblem
from wbc.problem.pendulum.result import PendulumStatus
from wbc.rmp.plan import Plan, PlanError, Stats, check, load_plan
from wbc.rmp.plan.planner import first_guess
from wbc.rmp.plan.transcription import transcribe
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
def test_a_run_that_ends_before_its_first_step_has_its_start(overrides, status, tmp_path) -> None:
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


LAW = """# A lean.
model: rmp_planar
mass: 35.0
start: {leg_length: 0.7, radii: 0.25, theta: 1.5}
bounds: {wheel_torque: 60.0}
law: {type: static_lean, angle: 1.5}
stop: {duration: 0.1}
"""
PLAN = """# A hop.
model: rmp_solid
mass: 30.0
plan:
  start: {com: [0, 0, 0.75], com_velocity: [0, 0, 0], rotation: [0, 0, 0], momentum: [0, 0, 0],
          radii: [0.2, 0.2, 0.2], radii_rates: [0, 0, 0]}
  goal: {com: [0, 0, 0.75], com_velocity: [0, 0, 0]}
  schedule:
    push: {duration: 0.5, support: {at: [0, 0], size: [0.2, 0.2]}, intervals: 4}
    fly: {duration: 0.3, support: flight, intervals: 4}
    land: {duration: 0.5, support: {at: [0, 0], size: [0.2, 0.2]}, intervals: 4}
  limits: {leg_length: [0.4, 0.9], normal_force: [10.0, 2000.0], friction: 0.7}
"""

# What is written, what replaces it, and what the message says.
MISTAKES = {
    "unknown model": (LAW, "rmp_planar", "rmp_flat", "p.yaml:2: model"),
    "unknown law": (LAW, "static_lean", "static_learn",
                    "p.yaml:6: law.type: 'static_learn' does not exist; did you mean"),
    "unknown key": (LAW, "wheel_torque", "wheel_torqe", "did you mean 'wheel_torque'"),
    "negative mass": (LAW, "mass: 35.0", "mass: -1.0", "p.yaml:3: mass"),
    "no leg": (LAW, "leg_length: 0.7", "leg_length: 0.0", "p.yaml:4: start.leg_length"),
    "not a number": (LAW, "radii: 0.25", "radii: .nan", "p.yaml:4: start.radii"),
    "three radii in a plane": (LAW, "radii: 0.25", "radii: [1, 1, 1]", "start.radii: a planar"),
    "both sizes": (LAW, "radii: 0.25", "radii: 0.25, inertia: 2.0", "inertia or radii"),
    "leans too far": (LAW, "angle: 1.5", "angle: 1.0", "p.yaml:6: law: angle: to lean at"),
    "solid law": (LAW, "static_lean, angle: 1.5", "stabiliser", "needs a solid pendulum"),
    "law and plan": (LAW, "stop: {duration: 0.1}", "plan: {start: {}, schedule: {a: {duration: 1,"
                     " support: flight}}}", "law (to simulate) or plan"),
    "broken triangle": (
        LAW.replace("rmp_planar", "rmp_solid").replace("static_lean, angle: 1.5", "stabiliser"),
        "radii: 0.25", "inertia: [5.0, 1.0, 1.0]", "start.inertia: moments"),
    "spin out of reach": (
        LAW.replace("radii: 0.25", "radii: 0.25, rates: {spin: 1.0}"),
        "static_lean, angle: 1.5", "spin, spin: 1e6", "out of reach"),
    "no spin wanted": (
        LAW.replace("radii: 0.25", "radii: 0.25, rates: {spin: 1.0}"),
        "static_lean, angle: 1.5", "spin, spin: 0.0", "p.yaml:6: law: spin: 0 rad/s"),
    "no inertia": (LAW, "radii: 0.25", "radii: 0.0", "p.yaml:4: start: q: at r = 0"),
    "hardly any": (LAW, "radii: 0.25", "radii: 1e-300", "p.yaml:4: start: q: at r = 1e-300"),
    "solid key": (LAW, "theta: 1.5", "phi: 0.0", "p.yaml:4: start.phi: only a solid"),
    "solid rate": (LAW, "theta: 1.5", "rates: {phi: 0.0}", "start.rates.phi: only a solid"),
    "solid foot": (LAW, "wheel_torque: 60.0", "polygon: [[0, 0], [1, 0], [0, 1]]",
                   "p.yaml:5: bounds: bounds: polygon of a PlanarRmp must be"),
    "solid push": (LAW, "stop:", "pushes: [{time: 0.0, impulse: [1, 0, 0]}]\nstop:",
                   "p.yaml:7: pushes[0]: the impulse at 0 s: expected shape (2,)"),
    "late push": (LAW, "stop:", "pushes: [{time: 0.1, impulse: [1, 0]}]\nstop:",
                  "p.yaml:7: pushes[0]: the push at 0.1 s is not before the end"),
    "no step": (LAW, "duration: 0.1", "duration: 1e-4", "p.yaml:7: stop: duration"),
    "endless": (LAW, "duration: 0.1", "duration: 1e9", "p.yaml:7: stop: duration"),
    "friction of a pivot": (
        LAW.replace("static_lean, angle: 1.5", "swing_up"), "wheel_torque: 60.0",
        "wheel_torque: 60.0, friction: 0.5", "p.yaml:5: bounds.friction: a swing_up has its foot"),
    "another law's tolerance": (LAW, "duration: 0.1", "duration: 0.1, accept: {spin: 1.0}",
                                "p.yaml:7: stop.accept.spin: only a law of type spin"),
    "two flights": (PLAN, "fly: {", "up: {duration: 0.1, support: flight}\n    fly: {",
                    "'up' and 'fly' are one flight"),
    "negative duration": (PLAN, "push: {duration: 0.5", "push: {duration: -0.5",
                          "p.yaml:9: plan.schedule.push.duration"),
    "crossed durations": (PLAN, "fly: {duration: 0.3", "fly: {duration: [0.4, 0.3]", "crossed"),
    "not convex": (PLAN, "land: {duration: 0.5, support: {at: [0, 0], size: [0.2, 0.2]}",
                   "land: {duration: 0.5, support: [[0, 0], [1, 0], [0.1, 0.1], [0, 1]]",
                   "p.yaml:11: plan.schedule.land"),
    "negative radius": (PLAN, "radii: [0.2, 0.2, 0.2]", "radii: [0.2, -0.2, 0.2]",
                        "plan.start: state: radii must be positive"),
    "impossible inertia": (PLAN, "radii: [0.2, 0.2, 0.2]", "inertia: [5.0, 1.0, 1.0]",
                           "triangle inequality"),
    "start out of reach": (PLAN, "start: {com: [0", "start: {com: [2", "no CoP is possible"),
    "limits crossed": (PLAN, "leg_length: [0.4, 0.9]", "leg_length: [0.9, 0.4]",
                       "p.yaml:12: plan.limits"),
    "sole without a width": (PLAN, "land: {duration: 0.5, support: {at: [0, 0], size: [0.2, 0.2]}",
                             "land: {duration: 0.5, support: {at: [0, 0], size: [0.2, 0]}",
                             "p.yaml:11: plan.schedule.land.support.size[1]: must be at least"),
    "misspelt sole": (PLAN, "land: {duration: 0.5, support: {at: [0, 0], size:",
                      "land: {duration: 0.5, support: {at: [0, 0], siez:",
                      "p.yaml:11: plan.schedule.land.support.siez: unknown key; did you mean"),
    # absurd numbers: once a ZeroDivisionError, OverflowError or RuntimeError of the planner
    "no mass": (PLAN, "mass: 30.0", "mass: 1e-300", "p.yaml:3: mass: must be at least 1e-09"),
    "no gravity": (PLAN, "mass: 30.0", "mass: 30.0\ngravity: 5e-324",
                   "gravity: 4.94066e-324 is out of all proportion; use SI units, 1e-09 to 1e+09"),
    "no time": (PLAN, "fly: {duration: 0.3", "fly: {duration: 5e-324",
                "p.yaml:10: plan.schedule.fly.duration: must be at least 1e-09"),
    "limit without size": (PLAN, "friction: 0.7", "friction: 1e-320",
                           "limits: friction: 9.99989e-321 is out of all proportion"),
    "limit beyond all": (PLAN, "normal_force: [10.0, 2000.0]", "normal_force: [1e300, 1e308]",
                         "limits: normal_force: 1e+300 is out of all proportion"),
    "support without size": (PLAN, "land: {duration: 0.5, support: {at: [0, 0], size: [0.2, 0.2]}",
                             "land: {duration: 0.5, support: [[0, 0], [1e-300, 0]]",
                             "p.yaml:11: plan.schedule.land: phase 'land': support: corners"),
    "law's key with a plan": (PLAN, "plan:", "bounds: {}\nplan:", "belongs to a law"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_one_typed_error_that_says_where(name: str, tmp_path: Path) -> None:
    text, old, new, said = MISTAKES[name]
    assert old in text
    with pytest.raises(ProblemFileError) as caught:
        problem_of(tmp_path, text.replace(old, new, 1))
    assert said in str(caught.value)


def test_the_examples_themselves_are_valid(tmp_path: Path) -> None:
    for text in (LAW, PLAN):
        assert problem_of(tmp_path, text).run().status.good


@pytest.mark.slow
def test_an_infeasible_plan_names_what_is_in_the_way(tmp_path: Path) -> None:
    with pytest.raises(PlanError, match="exceeds its limit by") as caught:
        problem_of(tmp_path, PLAN.replace("fly: {duration: 0.3", "fly: {duration: 2.0")).run()
    assert isinstance(caught.value, WbcError)
    # Two seconds of flight take a take-off at 10 m/s within half a second and half a metre of leg.
    assert any(each.quantity.startswith("leg_length") for each in caught.value.violations)


@pytest.mark.slow
def test_checking_a_plan_with_absurd_numbers_ends(tmp_path: Path) -> None:
    """At 10^6 turns a second no integration gets from one knot to the next."""
    problem = problem_of(tmp_path, PLAN.replace("momentum: [0, 0, 0]", "momentum: [1.0e+7, 0, 0]"))
    assert isinstance(problem, PendulumProblem) and isinstance(problem.parts, Planning)
    guess = first_guess(transcribe(problem.parts.problem))
    duals = np.zeros(len(guess)), np.zeros(1)
    plan = Plan(problem.parts.problem, guess, duals, Stats(1, 1, 1, 0.0, 0.0, "", False))
    checked = check(plan)
    assert checked.defect == np.inf
    assert not checked.ok
