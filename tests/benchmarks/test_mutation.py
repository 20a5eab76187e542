"""The study of faults that tests do not notice: each is one fault, where it is said to be."""

import ast

import pytest

from benchmarks.mutation import Places, chosen_tests, faults, files, share

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
    (0, "0.5 -> 1.001"), (3, "no USub"), (3, "1 -> 2"), (3, "if not"), (3, "And -> Or"),
    (3, "Lt -> LtE"), (3, "no Not"), (3, "Add -> Sub"), (3, "min -> max"), (3, "Mult -> Div"),
    (3, "2 -> 3"), (3, "left out"), (3, "if not"), (3, "IsNot -> Is"), (3, "False"),
]  # fmt: skip


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
    assert not any(path.name.startswith("native_") for path in files())


def test_tests_that_call_what_is_at_fault_are_run_the_quickest_first() -> None:
    fault = next(one for one in faults() if one.function)
    here = f"{fault.file}:{fault.function}"
    tests = {
        "slow": {"calls": [here], "seconds": 2.0},
        "endless": {"calls": [here], "seconds": 1e3},
        "other": {"calls": [f"{fault.file}:99999"], "seconds": 0.1},
        "quick": {"calls": [here], "seconds": 0.1},
    }
    assert chosen_tests(fault, tests) == (["quick", "slow"], 2.1)


def test_intervals_are_wilsons() -> None:
    """Of 10 in 10: 1 / (1 + z^2 / n) to 1; Brown, Cai and DasGupta (2001)."""
    assert share(10, 10) == "100.0 % (95 %: 72.2 to 100.0)"
    assert share(50, 100) == "50.0 % (95 %: 40.4 to 59.6)"
