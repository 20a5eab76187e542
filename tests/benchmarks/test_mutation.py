"""The study of faults that tests do not notice: each is one fault, where it is said to be."""

import ast

import pytest

from benchmarks.mutation import EQUIVALENT, report
from benchmarks.mutation_places import ROOT, Places, faults, files
from benchmarks.mutation_trials import TESTS, Trials, chosen_tests, forked

SOURCE = '''
LEAST: float = 0.5
def law(x, y=-1):
    """Words 1 + 1."""
    if x < y and not x:
        raise ValueError(f"{x + 1} is too small")
    x += min(x, 2 * y)
    x.sort()
    return x if x is not None else True
'''
PLACES = [
    ("", "0.5 -> 1.001"), *(("law", what) for what in (
        "no USub", "1 -> 2", "if not", "And -> Or", "Lt -> LtE", "no Not", "Add -> Sub",
        "min -> max", "Mult -> Div", "2 -> 3", "left out", "if not", "IsNot -> Is", "False",
    )),
]  # fmt: skip


@pytest.mark.parametrize("path", TESTS)
def test_tests_that_faults_are_tried_on_are_there(path: str) -> None:
    assert (ROOT / path.removeprefix("--ignore=")).exists()


def test_every_place_is_found_with_its_function() -> None:
    places = Places()
    tree = places.visit(ast.parse(SOURCE))
    assert ast.dump(tree) == ast.dump(ast.parse(SOURCE))  # nothing is changed unless it is wanted
    assert sorted((function, what) for function, _, what in places.found) == sorted(PLACES)


@pytest.mark.parametrize("place", range(len(PLACES)))
def test_one_fault_is_one_line(place: int) -> None:
    places = Places(place)
    faulty = ast.unparse(ast.fix_missing_locations(places.visit(ast.parse(SOURCE))))
    sound = ast.unparse(ast.parse(SOURCE))
    lines = zip(sound.splitlines(), faulty.splitlines(), strict=True)
    assert sum(one != other for one, other in lines) == 1


def test_faults_of_this_package_are_in_its_files() -> None:
    every = list(faults())
    assert {fault.file.split("/")[1] for fault in every} == {
        "tasks", "constraints", "controllers", "qp", "robot",
    }  # fmt: skip
    assert len({fault.key for fault in every}) == len(every) > 4000
    assert set(EQUIVALENT) <= {(fault.file, fault.text, fault.what) for fault in every}
    assert not any(path.name.startswith("native_") for path in files())


def test_tests_that_call_what_is_at_fault_are_run_the_quickest_first() -> None:
    fault = next(one for one in faults() if one.function)
    here = f"{fault.file}:{fault.function}"
    tests = {
        "slow": {"calls": [here], "seconds": 2.0},
        "other": {"calls": [f"{fault.file}:nothing"], "seconds": 0.1},
        "quick": {"calls": [here], "seconds": 0.1},
    }
    assert chosen_tests(fault, tests, set()) == (["quick", "slow"], 2.1)
    assert chosen_tests(fault, tests, {"slow"}) == (["slow", "quick"], 2.1)


@pytest.mark.slow
def test_a_sample_is_tried_kept_and_told(tmp_path, monkeypatch) -> None:
    """A whole run on few faults and the tests of one file, in processes of their own."""
    monkeypatch.setattr("benchmarks.mutation_trials.TESTS", ("tests/tasks/test_task_inputs.py",))
    monkeypatch.setattr("benchmarks.mutation_trials.WARM", ())
    monkeypatch.setenv("WBC_CACHE", str(tmp_path))
    sample = [one for one in faults() if one.function == "checked_weight"][-4:]
    trials = Trials(sample, tmp_path / "found.json", tmp_path / "tests.json")
    assert forked(trials.run, 0) == 0
    found = trials.found()
    verdicts = {(one["what"], one["text"]): one["verdict"] for one in found.values()}
    assert verdicts["if not", "if (vector < 0.0).any():"] == "killed"
    assert found.keys() == {one.key for one in sample}
    before = (tmp_path / "found.json").read_text()
    forked(trials.run, 0)  # nothing is left to do
    assert (tmp_path / "found.json").read_text() == before
    told = report(sample, found)
    assert "wbc/tasks/weights.py:" in told and "faults noticed" in told
