"""Problems as data, and plans: in files, at any time, and against the pendulums."""

import json
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest
from numpy.lib.format import write_array_header_1_0

from benchmarks.planner import EXAMPLES, example
from tests.rmp.plan.conftest import HEIGHT, LIMITS
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.rmp.plan import (
    Plan,
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
