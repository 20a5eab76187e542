"""What enters the package is real, finite, of the size asked for and not absurdly large."""

import numpy as np
import pytest

from wbc.errors import InvalidInputError, listed
from wbc.validate import by_name, finite_array, finite_number, finite_vector, names_of, plain_copy


def test_a_pose_for_a_part_of_it_is_said() -> None:
    with pytest.raises(InvalidInputError, match=r"\(4, 4\); of a pose T give T\.translation$"):
        finite_array("target", np.eye(4), (3,))
    with pytest.raises(InvalidInputError, match=r"give T\.rotation$"):
        finite_array("target", np.eye(4), (3, 3))


@pytest.mark.parametrize("value", [2, np.float32(2.0), np.array(2.0)])
def test_whatever_is_one_number_is_accepted(value: object) -> None:
    assert finite_number("dt", value) == 2.0


@pytest.mark.parametrize("size", [1e31, -1e60, 1e200])
def test_absurdly_large_numbers_are_refused(size: float) -> None:
    with pytest.raises(InvalidInputError, match=r"x: beyond 1e\+30 at \(1, 0\)"):
        finite_array("x", [[1.0, 2.0], [size, 4.0]], (2, 2))
    with pytest.raises(InvalidInputError, match=r"dt: .* is beyond 1e\+30"):
        finite_number("dt", size)


def test_many_large_numbers_are_accepted_each_by_itself() -> None:
    x = np.full(100, 1e30)
    np.testing.assert_array_equal(finite_vector("x", x, 100), x)


def test_what_is_not_finite_is_named_first() -> None:
    with pytest.raises(InvalidInputError, match=r"x: NaN or infinite at \(0,\), \(2,\);"):
        finite_vector("x", [np.nan, 1e60, np.inf], 3)


def test_a_quick_look_passes_plain_arrays_alone() -> None:
    x = np.arange(6.0).reshape(3, 2).T
    copied = plain_copy(x, (2, 3))
    assert copied is not None
    assert not np.shares_memory(copied, x)
    assert copied.flags.c_contiguous
    np.testing.assert_array_equal(copied, x)
    bad = np.array([1.0, np.nan]), np.array([np.inf, 0.0]), np.array([1e200, 0.0])
    others = [1.0, 2.0], np.arange(2), np.ones(2, dtype=np.float32), np.ones(3), np.ones(2) + 0j
    for value in (*bad, *others):
        assert plain_copy(value, (2,)) is None


@pytest.mark.parametrize(
    ("names", "told"),
    [((), ""), (["a"], "a"), (("a", "b"), "a, b"), (["a", "b", "c", "d"], "a, b and 2 more")],
)
def test_lists_in_messages_say_how_much_is_left_out(names: list[str], told: str) -> None:
    assert listed(names, 2) == told


@pytest.mark.parametrize("check", [finite_number, by_name, names_of])
def test_what_was_given_is_told_in_one_short_line(check) -> None:
    """Not all numbers of an array where one was asked for."""
    with pytest.raises(InvalidInputError) as told:
        check("dt", np.arange(200.0).reshape(20, 10) if check is not names_of else [[0.1] * 200])
    assert len(str(told.value)) < 120 and "\n" not in str(told.value)
    assert "got " in str(told.value) and str(told.value).endswith("...")


@pytest.mark.parametrize(
    "value",
    [
        np.ma.array([1.0, 2.0], mask=[True, False]),
        np.ma.array([1.0, 2.0]),
        [np.ma.masked, 1.0],
        [np.ma.array([1.0], mask=[True])[0], 1.0],
    ],
)
def test_masked_arrays_are_refused(value: object) -> None:
    """Their data hold what the mask hides."""
    with pytest.raises(InvalidInputError, match="q: a masked array"):
        finite_vector("q", value, 2)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [np.ma.masked, np.ma.array(2.0), np.ma.array(2.0, mask=True)])
def test_masked_number_is_refused(value: object) -> None:
    with pytest.raises(InvalidInputError, match="dt: expected a number"):
        finite_number("dt", value)
