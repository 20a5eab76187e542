"""Comparing two revisions: the same one agrees with itself, and what differs is found and named."""

import numpy as np
import pytest

from benchmarks.compare import HERE, Outcome, compare, compare_results, files_of, gap_of, leaves


def outcome(code: int = 0, **entries: object) -> Outcome:
    return Outcome(code, {name: np.atleast_1d(value) for name, value in entries.items()}, "")


@pytest.mark.slow
@pytest.mark.skipif(not (HERE / ".git").exists(), reason="needs the repository's history")
def test_a_revision_agrees_with_itself(capsys) -> None:
    with files_of("HEAD") as tree:
        assert compare_results(tree, tree, "rmp_spin", repeat=1)
    assert not tree.exists()
    written = capsys.readouterr().out
    assert "| rmp_spin | 0e+00 |  |  | completed (0) | completed (0) |" in written
    assert "1 of 1 problems agree" in written


def test_a_pattern_that_matches_nothing_is_no_agreement() -> None:
    with pytest.raises(SystemExit, match=r"is called 'plan_\*\.yaml'"):
        compare_results(HERE, HERE, "plan_*.yaml", repeat=0)


def test_two_runs_that_wrote_nothing_do_not_agree() -> None:
    found = compare(Outcome(1, {}, "no core"), Outcome(1, {}, "no core"))
    assert not found.agrees
    assert found.words == ["no result of either: no core"]


def test_rounding_and_new_entries_agree() -> None:
    assert compare(outcome(q=[1.0, 1000.0]), outcome(q=[1.0, 1000.0005], v=[0.0])).agrees


@pytest.mark.parametrize(
    ("after", "words"),
    [
        (outcome(3, q=[1.0], status="solved"), "exit code 0 -> 3"),
        (outcome(q=[1.0], status="failed"), "status[0]: solved -> failed"),
        (outcome(q=[1.0, 1.0], status="solved"), "q: shape (1,) -> (2,)"),
        (outcome(v=[1.0], status="solved"), "only before: q"),
    ],
)
def test_what_differs_is_named(after: Outcome, words: str) -> None:
    found = compare(outcome(q=[1.0], status="solved"), after)
    assert not found.agrees
    assert any(line.startswith(words) for line in found.words)


def test_the_largest_difference_is_found_with_its_first_row() -> None:
    before, after = np.zeros((4, 2)), np.zeros((4, 2))
    after[1, 0], after[2, 1] = 2e-6, 0.5
    assert gap_of("q", before, after) == (0.5, "q[2, 1] 0 -> 0.5, differs from row 1 on")
    assert not compare(outcome(q=before), outcome(q=after)).agrees


def test_a_number_on_one_side_only_is_a_difference() -> None:
    nan = np.array([np.nan, 1.0])
    assert gap_of("cop", nan, nan) == (0.0, "")
    assert gap_of("cop", nan, np.array([0.0, 1.0]))[0] == np.inf


def test_plain_data_by_dotted_names() -> None:
    found = leaves("summary", np.array('{"a": {"b": [1, null]}, "c": [{"d": "x"}]}'))
    assert list(found) == ["summary.a.b", "summary.c.0.d"]
    np.testing.assert_array_equal(found["summary.a.b"], [1.0, np.nan])
    assert found["summary.c.0.d"].tolist() == ["x"]
