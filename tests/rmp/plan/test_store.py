"""Problems as data, and plans in files."""

import json
from io import BytesIO
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest
from numpy.lib.format import write_array_header_1_0

from benchmarks.planner import EXAMPLES, example
from wbc.errors import InvalidInputError, UnknownNameError
from wbc.rmp.plan import load_plan, problem_from_data, problem_to_data, save_plan, solve


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
