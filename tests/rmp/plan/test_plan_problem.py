"""What planning refuses, how it fails, how it starts warm, and how it is kept in files."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.plan_examples import EXAMPLES, HEIGHT, LIMITS, RADII, push_recovery
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.rmp.plan import (
    Check,
    Limits,
    Phase,
    PlanError,
    PlanProblem,
    State,
    at_rest,
    check,
    hull,
    load_plan,
    problem_from_data,
    problem_to_data,
    radii_for,
    rectangle,
    save_plan,
    solve,
)
from wbc.rmp.plan.schedule import overlap, support_bounds
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp

SQUARE = rectangle(0.0, 0.0, 0.2, 0.2)
STAND = Phase("stand", 1.0, SQUARE, 8)
FLY = Phase("fly", 0.3, None, 8)
REST = at_rest((0.0, 0.0, HEIGHT), RADII)
BODY = SolidRmp(30.0)


def problem(**changed: object) -> PlanProblem:
    return PlanProblem(**{"pendulum": BODY, "schedule": (STAND,), "start": REST} | changed)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"schedule": ()}, "at least one phase"),
        ({"schedule": (STAND, STAND)}, "different names"),
        ({"schedule": (STAND, FLY)}, "ends in the flight 'fly'"),
        ({"schedule": (FLY, STAND), "start": State(radii=RADII)}, "begins in the flight"),
        ({"schedule": (FLY, replace(FLY, name="on"), STAND)}, "one flight"),
        ({"pendulum": SolidRmp(30.0, 0.0)}, "gravity"),
        ({"start": at_rest((3.0, 0.0, HEIGHT), RADII), "limits": LIMITS}, "no CoP is possible"),
        ({"start": at_rest((0.0, 0.0, 0.0), RADII)}, "above the ground"),
        ({"start": at_rest((0.0, 0.0, HEIGHT), (0.9, 0.2, 0.2)), "limits": LIMITS}, "0.9"),
        ({"goal": at_rest((0.0, 0.0, 1.6), RADII), "limits": LIMITS}, "goal"),
        ({"reference": (0.0, 0.0, 0.0, 2.0)}, "unit quaternion"),
        ({"degree": 1}, "degree"),
        ({"periodic": (np.nan, 0.0)}, "periodic"),
        ({"pendulum": PlanarRmp(30.0)}, "r_1 = r_3"),
    ],
)
def test_contradictions_are_refused(changed: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        problem(**changed)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Phase("a", -1.0, SQUARE), "duration"),
        (lambda: Phase("a", (1.0, 0.5), SQUARE), "crossed"),
        (lambda: Phase("a", 1.0, ((0, 0), (1, 0), (0.2, 0.2), (0, 1))), "convex"),
        (lambda: Phase("a", 1.0, SQUARE, 0), "intervals"),
        (lambda: Phase("", 1.0, SQUARE), "name"),
        (lambda: Limits(leg_length=(0.0, 1.0)), "leg_length"),
        (lambda: Limits(radius=(0.3, 0.1)), "radius"),
        (lambda: Limits(friction=-1.0), "friction"),
        (lambda: State(radii=(0.1, -0.1, 0.1)), "radii"),
        (lambda: State(rotation=(0.0, 0.0, 7.0)), "full turn"),
        (lambda: State(inertia=(1.0, 0.4, 0.5)), "triangle"),
        (lambda: State(inertia=(1.0, -0.4, 0.9)), "positive"),
        (lambda: State(inertia=(1.0, 1.0, 1.0), radii=RADII), "not both"),
        (lambda: radii_for(-1.0, (1.0, 1.0, 1.0)), "mass"),
    ],
)
def test_impossible_data_are_refused(build: object, message: str) -> None:
    with pytest.raises(InvalidInputError, match=message):
        build()


def test_radii_for_is_the_inverse_of_the_inertia() -> None:
    r = np.array(RADII)
    np.testing.assert_allclose(radii_for(30.0, 10.0 * ((r**2).sum() - r**2)), r, rtol=1e-13)


def test_supports() -> None:
    left, right = rectangle(0.0, 0.1, 0.2, 0.1), rectangle(0.3, -0.1, 0.2, 0.1)
    both = hull(left, right)
    assert len(both) == 6 and overlap(left, both) and not overlap(left, right)
    for corners in (both, ((0.1, 0.2),), ((0.0, 0.0), (1.0, 2.0))):
        A, low, high = support_bounds(corners)
        inside = A @ np.mean(corners, axis=0)
        assert (inside >= low - 1e-12).all() and (inside <= high + 1e-12).all()
        outside = A @ (np.mean(corners, axis=0) + (3.0, 0.0))
        assert ((outside < low - 1e-3) | (outside > high + 1e-3)).any()


def test_a_plan_that_cannot_be_names_what_is_in_the_way() -> None:
    # In 0.1 s gravity alone brings the CoM down by 5 cm, not 20.
    sunk = problem(
        schedule=(replace(STAND, duration=0.1),),
        goal=at_rest((0.0, 0.0, HEIGHT - 0.2), RADII),
        limits=LIMITS,
    )
    with pytest.raises(PlanError) as caught:
        solve(sunk)
    error = caught.value
    worst = error.violations[0]
    assert (worst.phase, worst.quantity, worst.unit) == ("goal", "com", "m")
    assert 0.1 < worst.amount < 0.2
    assert "goal: com" in str(error) and "0.100 s" in str(error)
    assert check(error.attempt).defect < 1e-6  # it is a motion


def test_check_sees_what_was_tampered_with() -> None:
    plan = solve(EXAMPLES["lean"]())
    assert check(plan).ok
    places = plan.layout.phases[0]

    def tampered(where: object, value: float) -> Check:
        solution = plan.solution.copy()
        solution[where] = value
        return check(replace(plan, solution=solution))

    lost = tampered(places.named["force"][10, 2], 0.0)
    assert lost.lost_contact == ("lean",) and not lost.ok
    assert "hardly pushed" in lost.report()
    # The force was 294 N, for half of two intervals of 50 ms: M g h / 2 / M a time.
    assert lost.defects["com_velocity"] == pytest.approx(9.81 * 0.05 / 2, rel=0.02)
    away = tampered(places.named["cop"][10, 0], 2.0)
    assert away.violations[0].quantity == "cop" or away.violations[1].quantity == "cop"
    assert away.defects["momentum"] > 1.0
    turned = tampered(places.named["orientation"][10, 0], 0.1)
    # sigma of 0.1 is 4 atan(0.1) rad; the plan's own lean is small.
    assert turned.defects["orientation"] == pytest.approx(4 * np.arctan(0.1), rel=0.05)


def test_warm_start_takes_fewer_iterations_also_for_other_numbers() -> None:
    cold = solve(push_recovery(9.0))
    again = solve(push_recovery(9.0), warm=cold)
    other, other_cold = solve(push_recovery(8.0), warm=cold), solve(push_recovery(8.0))
    assert again.stats.iterations <= 2 and again.stats.warm
    assert other.stats.iterations < other_cold.stats.iterations
    np.testing.assert_allclose(other.knots.com, other_cold.knots.com, atol=1e-5)
    with pytest.raises(InvalidInputError, match="warm start"):
        solve(EXAMPLES["lean"](), warm=cold)


def test_verbose_prints_size_and_verdict(capfd: pytest.CaptureFixture[str]) -> None:
    plan = solve(EXAMPLES["lean"](), verbose=True)
    shown = capfd.readouterr().out
    assert f"{plan.stats.variables} variables" in shown and "Solve_Succeeded" in shown


@pytest.mark.parametrize("name", EXAMPLES)
def test_problems_are_data(name: str) -> None:
    built = EXAMPLES[name]()
    text = json.dumps(problem_to_data(built), allow_nan=False)
    back = problem_from_data(json.loads(text))
    assert problem_to_data(back) == problem_to_data(built)


def test_data_with_unknown_or_missing_keys_are_refused() -> None:
    data = problem_to_data(EXAMPLES["lean"]())
    with pytest.raises(UnknownNameError, match="goal"):
        problem_from_data(data | {"gaol": {}})
    with pytest.raises(InvalidInputError, match="schedule is missing"):
        problem_from_data({k: v for k, v in data.items() if k != "schedule"})
    with pytest.raises(UnknownNameError, match="friction"):
        problem_from_data(data | {"limits": {"fricton": 0.5}})


def test_plans_are_kept_in_files(tmp_path: Path) -> None:
    plan = solve(EXAMPLES["lean"]())
    path = save_plan(plan, tmp_path / "lean.npz")
    back = load_plan(path)
    np.testing.assert_array_equal(back.solution, plan.solution)
    times = np.linspace(0.0, plan.duration, 17)
    np.testing.assert_array_equal(back.at(times).com, plan.at(times).com)
    assert back.stats == plan.stats and [p.name for p in tmp_path.iterdir()] == ["lean.npz"]
    assert solve(back.problem, warm=back).stats.iterations <= 2
    with np.load(path) as file:
        np.testing.assert_array_equal(file["knots_com"], plan.knots.com)
    with pytest.raises(InvalidInputError, match="npz"):
        save_plan(plan, tmp_path / "lean.json")
    (tmp_path / "cut.npz").write_bytes(path.read_bytes()[:500])
    for other in (tmp_path / "cut.npz", tmp_path / "none.npz"):
        with pytest.raises(InvalidInputError, match="cannot be read"):
            load_plan(other)
