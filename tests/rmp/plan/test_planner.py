"""What the planner finds and how it fails; plans looked at anew, in files, and at any time."""

import json
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest
from numpy.lib.format import write_array_header_1_0
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from benchmarks.planner import EXAMPLES, example
from tests.rmp.plan.conftest import HEIGHT, LIMITS, RADII
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.rmp.plan import (
    Check,
    PathLimits,
    Plan,
    PlanError,
    PlanPhase,
    PlanProblem,
    State,
    Weights,
    at_rest,
    check,
    generalised,
    load_plan,
    problem_from_data,
    problem_to_data,
    rectangle,
    save_plan,
    solve,
)
from wbc.rmp.planar import PlanarRmp
from wbc.rmp.solid import SolidRmp

STILL = (0.0, 0.0, 0.0)
SQUARE = rectangle(0.0, 0.0, 0.22, 0.3)
Planned = Callable[[str], Plan]


def test_linear_inverted_pendulum_in_closed_form() -> None:
    """At constant height, without spin, c'' = omega^2 (c - p): for CoPs linear in time."""
    flat = PathLimits(leg_length=(0.5, 1.0), radius=(0.05, 0.4))
    start = replace(at_rest((0.0, 0.0, HEIGHT), RADII), com_velocity=(0.2, 0.1, 0.0))
    plan = solve(
        PlanProblem(
            SolidRmp(30.0),
            (PlanPhase("stand", 1.0, SQUARE, 20),),
            start=start,
            goal=State(com=(0.0, 0.0, None), com_velocity=STILL),
            nominal=State(com=(None, None, HEIGHT)),
            limits=flat,
            weights=Weights(torque=1e4, momentum=1e4, com=1e5, acceleration=0.01),
        )
    )
    omega = np.sqrt(9.81 / HEIGHT)
    k = plan.knots
    c, v = np.array(k.com[0, :2]), np.array(k.com_velocity[0, :2])
    h = 0.05
    for p0, p1 in zip(k.cop[:-1], k.cop[1:], strict=True):
        slope = (p1 - p0) / h
        cosh, sinh = np.cosh(omega * h), np.sinh(omega * h)
        c, v = (
            p1 + cosh * (c - p0) + sinh * (v - slope) / omega,
            slope + omega * sinh * (c - p0) + cosh * (v - slope),
        )
    # The plan's force is linear in each interval, the pendulum's hyperbolic: 1e-4 of 0.3 m seen.
    assert np.abs(c - k.com[-1, :2]).max() < 5e-4
    assert np.abs(v - k.com_velocity[-1, :2]).max() < 2e-3


def test_radii_are_bounded_by_default() -> None:
    """Only the CoM's start and the end at rest are given, and no cost holds the masses."""
    standing = PlanProblem(
        SolidRmp(30.0),
        (PlanPhase("stand", 2.0, SQUARE, 20),),
        start=State(com=(0.0, 0.0, HEIGHT)),
        goal=State(com=(0.0, 0.0, HEIGHT), com_velocity=STILL, rotation=STILL, momentum=STILL),
        weights=Weights(radii=0.0, radius_acceleration=0.0),
    )
    plan = solve(standing)
    assert plan.knots.radii.max() <= 1.0 + 1e-8  # 30 km without bounds
    seen = check(plan)
    assert seen.ok
    assert "radius (greatest)" in [each.quantity for each in seen.limits]
    with pytest.raises(InvalidInputError, match="radii: 2 is not within"):
        replace(standing, start=State(radii=(2.0, 2.0, 2.0)))
    replace(standing, start=State(radii=(2.0, 2.0, 2.0)), limits=PathLimits(radius=(0.1, np.inf)))


def test_walk_repeats_itself(planned: Planned) -> None:
    k = planned("walk").knots
    np.testing.assert_allclose(k.com[-1] - k.com[0], (0.5, 0.0, 0.0), atol=1e-8)
    np.testing.assert_allclose(k.com_velocity[-1], k.com_velocity[0], atol=1e-7)
    np.testing.assert_allclose(k.force[-1], k.force[0], atol=1e-5)
    assert np.abs(k.momentum).max() <= 3.0 + 1e-9


def test_duration_is_chosen_within_its_bounds(planned: Planned) -> None:
    swift = replace(example("hop"), weights=Weights(time=100.0))
    plan, calm = solve(swift), planned("hop")
    assert plan.duration < calm.duration - 0.1
    for T, phase in zip(plan.durations, swift.schedule, strict=True):
        assert phase.durations[0] - 1e-7 <= T <= phase.durations[1] + 1e-7


def test_a_plan_that_cannot_be_names_what_is_in_the_way() -> None:
    # In 0.1 s gravity alone brings the CoM down by 5 cm, not 20.
    sunk = PlanProblem(
        SolidRmp(30.0),
        (PlanPhase("stand", 0.1, SQUARE, 8),),
        start=at_rest((0.0, 0.0, HEIGHT), RADII),
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


@pytest.mark.slow
def test_warm_start_takes_fewer_iterations_also_for_other_numbers() -> None:
    pushed = example("push")
    less = replace(pushed, start=replace(pushed.start, com_velocity=(0.27, 0.0, 0.0)))
    cold = solve(pushed)
    again = solve(pushed, warm=cold)
    other, other_cold = solve(less, warm=cold), solve(less)
    assert again.stats.iterations <= 2 and again.stats.warm
    assert other.stats.iterations < other_cold.stats.iterations
    np.testing.assert_allclose(other.knots.com, other_cold.knots.com, atol=1e-5)
    with pytest.raises(InvalidInputError, match="warm start"):
        solve(example("lean"), warm=cold)


def test_verbose_prints_size_and_verdict(capfd: pytest.CaptureFixture[str]) -> None:
    plan = solve(example("lean"), verbose=True)
    shown = capfd.readouterr().out
    assert f"{plan.stats.variables} variables" in shown and "Solve_Succeeded" in shown


def test_what_is_no_problem_plan_or_count_is_refused() -> None:
    problem = example("lean")
    for build, message in (
        (lambda: solve(None), "problem: expected a PlanProblem"),
        (lambda: solve(problem, problem), "warm: expected a Plan or None"),
        (lambda: solve(problem, iterations=20.5), "iterations: expected a whole number"),
        (lambda: check(problem), "plan: expected a Plan"),
    ):
        with pytest.raises(InvalidInputError, match=message):
            build()


FLIGHTS = [name for name in EXAMPLES if name.startswith("hop")]


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_are_in_order_between_knots(name: str, planned: Planned) -> None:
    # Finer than any point the programme looks at: four times, not at halves alone.
    seen = check(planned(name), factor=4)
    assert seen.defect < 1e-6
    assert seen.excess < 1e-6
    assert seen.drift < 1e-8
    assert seen.ok, seen.report()


@pytest.mark.slow
@pytest.mark.parametrize("name", FLIGHTS)
def test_flight_is_a_parabola_with_constant_momentum_and_energy(name: str, planned) -> None:
    plan = planned(name)
    start, end = plan.starts[1:3]
    m = plan.at(np.linspace(start, end - 1e-9, 50))
    t = (m.time - start)[:, None]
    g = np.array((0.0, 0.0, -9.81))
    parabola = m.com[0] + m.com_velocity[0] * t + g * t**2 / 2
    # Rounding, and rows met to 1e-9 in scaled units, over ten intervals.
    np.testing.assert_allclose(m.com, parabola, atol=1e-7)
    energy = 30.0 * ((m.com_velocity**2).sum(axis=1) / 2 + 9.81 * m.com[:, 2])
    np.testing.assert_allclose(energy, energy[0], atol=1e-5)
    np.testing.assert_allclose(m.momentum, m.momentum[:1].repeat(50, axis=0), atol=1e-8)
    assert not m.force.any() and np.isnan(m.cop).all()


@pytest.mark.slow
def test_a_whole_plan_follows_from_its_forces(planned: Planned) -> None:
    """From the first knot to the last of a somersault; integrated anew where forces bend."""
    plan = planned("hop with somersault")
    k0 = plan.knots
    x = np.concatenate((k0.com[0], k0.com_velocity[0], k0.momentum[0], k0.orientation[0]))
    for first, last in zip(k0.time[:-1], k0.time[1:], strict=True):
        if first == last:
            continue  # a phase ends and the next one begins

        def rate(t: float, x: np.ndarray, last: float = last) -> np.ndarray:
            m = plan.at(min(t, last - 1e-12))
            lever = np.append(np.nan_to_num(m.cop[0]), 0.0) - x[:3]
            k_rate = np.cross(lever, m.force[0]) + (0.0, 0.0, m.moment[0])
            R = Rotation.from_quat(x[9:])
            inertia = 10.0 * ((m.radii[0] ** 2).sum() - m.radii[0] ** 2)
            w = R.inv().apply(x[6:9]) / inertia
            vector = (x[12] * w + np.cross(x[9:12], w)) / 2
            c_rate = m.force[0] / 30.0 - (0.0, 0.0, 9.81)
            return np.concatenate((x[3:6], c_rate, k_rate, vector, [-x[9:12] @ w / 2]))

        x = solve_ivp(rate, (first, last), x, rtol=1e-8, atol=1e-10).y[:, -1]
    assert np.abs(x[:3] - k0.com[-1]).max() < 1e-9
    assert np.abs(x[6:9] - k0.momentum[-1]).max() < 1e-9
    away = Rotation.from_quat(x[9:]).inv() * Rotation.from_quat(k0.orientation[-1])
    assert away.magnitude() < 1e-6


@pytest.mark.slow
def test_turns_in_flight_are_as_wanted(planned: Planned) -> None:
    for name, turn, axis in (
        ("hop with half turn", np.pi, 2),
        ("hop with whole turn", 2 * np.pi, 2),
        ("hop with somersault", 2 * np.pi, 1),
    ):
        plan = planned(name)
        times = np.linspace(plan.starts[1], plan.starts[2] - 1e-9, 2001)
        m = plan.at(times)
        turned = np.trapezoid(m.angular_velocity[:, axis], times)
        assert abs(turned - turn) < 1e-4  # trapezia
        # With the masses drawn in, from where they are at rest.
        assert m.inertia[:, axis].min() < 0.6 * plan.knots.inertia[0, axis]


def test_check_sees_what_was_tampered_with(planned: Planned) -> None:
    plan = planned("lean")
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


def test_a_goal_whose_turn_is_free_about_every_axis_is_reached_with_any() -> None:
    lean = example("lean")
    plan = solve(replace(lean, goal=replace(lean.goal, rotation=(None, None, None))))
    assert check(plan).ok


@pytest.mark.parametrize("name", EXAMPLES)
def test_problems_are_data(name: str) -> None:
    built = example(name)
    text = json.dumps(problem_to_data(built), allow_nan=False)
    back = problem_from_data(json.loads(text))
    assert problem_to_data(back) == problem_to_data(built)


def test_data_with_unknown_or_missing_keys_are_refused() -> None:
    data = problem_to_data(example("lean"))
    with pytest.raises(UnknownNameError, match="goal"):
        problem_from_data(data | {"gaol": {}})
    with pytest.raises(InvalidInputError, match="schedule is missing"):
        problem_from_data({k: v for k, v in data.items() if k != "schedule"})
    with pytest.raises(UnknownNameError, match="friction"):
        problem_from_data(data | {"limits": {"fricton": 0.5}})


def test_plans_are_kept_in_files(tmp_path: Path) -> None:
    plan = solve(example("lean"))
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


def test_a_file_that_unpacks_to_much_more_is_refused_unread(tmp_path: Path) -> None:
    """A thousandth of its size packed: what it declares is looked at first."""
    path = tmp_path / "bomb.npz"
    chunk = bytes(1 << 24)
    with (
        ZipFile(path, "w", ZIP_DEFLATED) as file,
        file.open("meta.npy", "w", force_zip64=True) as to,
    ):
        for _ in range(1 << 4):
            to.write(chunk)
    assert path.stat().st_size < 300_000
    with pytest.raises(InvalidInputError, match="268435456 bytes unpacked; at most"):
        load_plan(path)


def test_a_file_that_declares_another_shape_is_refused(tmp_path: Path) -> None:
    header = BytesIO()
    write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**13,)})
    with ZipFile(tmp_path / "p.npz", "w") as file:
        file.writestr("solution.npy", header.getvalue() + bytes(80))
    with pytest.raises(InvalidInputError, match=r"'solution': its header says shape \(10000000"):
        load_plan(tmp_path / "p.npz")


def _with_meta(path: Path, meta: object, **arrays: np.ndarray) -> Path:
    """Write a plan's file again with other parts."""
    with np.load(path) as file:
        parts = dict(file)
    np.savez(path.with_name("changed.npz"), **(parts | {"meta": np.array(meta)} | arrays))
    return path.with_name("changed.npz")


def test_plan_whose_parts_were_changed_is_refused_by_what_is_wrong(tmp_path: Path) -> None:
    plan = solve(example("lean"))
    path = save_plan(plan, tmp_path / "lean.npz")
    with np.load(path) as file:
        text = str(file["meta"])
    meta = json.loads(text)
    pendulum = meta["problem"] | {"pendulum": meta["problem"]["pendulum"] | {"kind": "cubic"}}
    for changed, said in (
        ("no json", "cannot be read as a plan"),
        (json.dumps([1]), "is not a plan"),
        (json.dumps(meta | {"format": "other"}), "is not a plan"),
        (json.dumps(meta | {"version": 99}), "format version 99; this package reads"),
        (json.dumps(meta | {"stats": 3}), "stats"),
        (json.dumps(meta | {"problem": meta["problem"] | {"schedule": 3}}), "list of phases"),
        (json.dumps(meta | {"problem": pendulum}), "unknown pendulum kind 'cubic'"),
    ):
        with pytest.raises(InvalidInputError, match=f"changed.npz: .*{said}"):
            load_plan(_with_meta(path, changed))
    with pytest.raises(InvalidInputError, match="is not one of its problem"):
        load_plan(_with_meta(path, text, solution=plan.solution[:-1]))
    with pytest.raises(InvalidInputError, match="NaN"):
        load_plan(_with_meta(path, text, solution=np.full_like(plan.solution, np.nan)))


@pytest.mark.parametrize("name", ["push", "push and step", "hop", "walk"])
def test_solid_pendulum_confirms_the_forces(name: str, planned: Planned) -> None:
    plan = planned(name)
    pendulum = plan.problem.pendulum
    m = plan.at(np.linspace(0.0, plan.starts[1] - 1e-6, 25))
    moved = generalised(plan, m)
    for q, v, a, f, i in zip(moved.q, moved.v, moved.a, moved.forces, range(25), strict=True):
        # Forces reach 500 N: a relative 1e-11.
        np.testing.assert_allclose(pendulum.inverse_dynamics(q, v, a), f, atol=1e-8)
        np.testing.assert_allclose(pendulum.ground_reaction(q, v, a), m.force[i], atol=1e-8)
        c, rate = pendulum.com(q, v)
        np.testing.assert_allclose((c, rate), (m.com[i], m.com_velocity[i]), atol=1e-12)
        np.testing.assert_allclose(pendulum.momenta(q, v)[0], m.momentum[i], atol=1e-11)
        np.testing.assert_allclose(pendulum.momentum_rate(q, f), m.momentum_rate[i], atol=1e-10)


def _flat(pendulum: PlanarRmp | SolidRmp) -> PlanProblem:
    radii = (0.2, 0.2, 0.2)
    start = replace(at_rest((0.0, 0.0, HEIGHT), radii), com_velocity=(0.3, 0.0, 0.0))
    return PlanProblem(
        pendulum,
        (PlanPhase("stand", 1.5, SQUARE, 20),),
        start=start,
        goal=at_rest((0.0, 0.0, HEIGHT), radii),
        nominal=State(com=(None, None, HEIGHT), rotation=STILL, radii=radii),
        limits=LIMITS,
        # r_2 has no part in the plane: without cost, r_1 and r_3 are alike in the solid too.
        weights=Weights(),
    )


def test_planar_plan_is_the_solid_one_in_its_plane() -> None:
    solid, planar = solve(_flat(SolidRmp(30.0))), solve(_flat(PlanarRmp(30.0)))
    assert planar.stats.variables < solid.stats.variables
    for name, within in (("com", 1e-9), ("momentum", 1e-7), ("force", 1e-6), ("radii", 1e-6)):
        one, other = getattr(solid.knots, name), getattr(planar.knots, name)
        np.testing.assert_allclose(one, other, atol=within)  # IPOPT's tolerance
    pendulum, moved = planar.problem.pendulum, generalised(planar, planar.knots)
    for q, v, a, f in zip(moved.q, moved.v, moved.a, moved.forces, strict=True):
        np.testing.assert_allclose(pendulum.inverse_dynamics(q, v, a), f, atol=1e-9)
        assert f[0] == 0.0
    assert check(planar, 4).ok


def test_at_meets_the_knots_and_refuses_what_lies_outside(planned: Planned) -> None:
    plan = planned("hop")
    k = plan.knots
    inside = np.flatnonzero(np.append(np.diff(k.phase) == 0, True))  # the later of two at a time
    inside = inside[k.time[inside] < plan.duration]
    m = plan.at(k.time[inside])
    np.testing.assert_allclose(m.com, k.com[inside], atol=1e-8)
    np.testing.assert_allclose(m.force, k.force[inside], atol=1e-6)
    with pytest.raises(InvalidInputError, match="within the plan"):
        plan.at(plan.duration + 0.1)
    with pytest.raises(InvalidInputError, match="in flight"):
        generalised(plan, plan.at(plan.starts[1] + 0.01))
