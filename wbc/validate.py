"""Checks on numbers given by the caller; all inputs of the package are checked here once."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeGuard, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wbc.errors import InvalidInputError, shown

Array = NDArray[np.float64]
Floats = NDArray[np.floating[Any]]  # what users compute: numpy says no more of norms and solutions
Bools = NDArray[np.bool_]
Index = NDArray[np.int64]  # numbers of things
Part = TypeVar("Part")
# Numbers beyond this are refused: they are implausible, and products of a few would overflow.
LARGEST = 1e30
LONG_STEP = 0.5  # s
WIDE_MARGIN = 0.5  # m
FLOAT = np.dtype(np.float64)
_FEW_NUMBERS = 9
_NO_REAL = str, bytes, complex, bool, np.bool_
_NO_NUMBER = str, bytes, bool, np.bool_, np.ma.MaskedArray


def is_plain(value: Any, shape: tuple[int, ...]) -> TypeGuard[Array]:
    """Return whether ``value`` is a float array of that shape: the fast path of ticks."""
    return type(value) is np.ndarray and value.dtype is FLOAT and value.shape == shape


def plain_copy(value: Any, shape: tuple[int, ...], largest: float = LARGEST) -> Array | None:
    """Return a fresh copy of a float array of that shape, every entry finite; else None.

    A quick look for what is given in every tick; at what it does not pass, :func:`finite_array`
    looks closely.
    """
    # As is_plain, without its call.
    if not (type(value) is np.ndarray and value.dtype is FLOAT and value.shape == shape):
        return None
    array: Array = value.copy()
    # NaN fails the comparison. Of few numbers Python finds the norm in a third of the time; of many
    # the sum of squares, which costs a third of np.isfinite(array).all(), and unlike dot it does
    # not warn where it overflows.
    if array.size <= _FEW_NUMBERS:
        numbers = array if array.ndim == 1 else array.ravel()
        return array if math.hypot(*numbers.tolist()) <= largest else None
    return array if np.vdot(array, array) <= largest * largest else None


def real_array(what: str, value: Any) -> Array:
    """Return ``value`` as a fresh float array of whatever shape; NaN and infinity pass.

    For input of several shapes: look at the shape of this, np.shape raises ValueError at ragged
    lists.

    Raises InvalidInputError: not real numbers: ragged lists, words (numerals too), dates, objects,
    complex numbers.
    """
    check_unmasked(what, value)
    try:
        given = np.asarray(value)
        kind = given.dtype.kind
        # NumPy would drop imaginary parts, read numerals, count days, and take True for 1.
        if kind not in "iufO" or (kind == "O" and _contains_kind(given.flat, _NO_REAL)):
            raise TypeError("no real numbers")
        if isinstance(value, list | tuple) and _contains_kind(value, _NO_REAL):  # NumPy made it 1.0
            raise TypeError("no real numbers")
        return np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidInputError(f"{what}: expected numbers, got {shown(value)}") from error


def _kind(value: Any) -> str:
    """Return NumPy's ``dtype.kind`` of an array; ``f`` for other libraries' arrays and lists."""
    return getattr(getattr(value, "dtype", FLOAT), "kind", FLOAT.kind)


def _contains_kind(values: Iterable[Any], kinds: tuple[type, ...]) -> bool:
    """Return whether nested lists contain a value of some types."""
    return any(
        _contains_kind(one, kinds) if isinstance(one, list | tuple) else isinstance(one, kinds)
        for one in values
    )


def check_unmasked(what: str, value: Any) -> None:
    """Raise InvalidInputError for an array with masked entries, whose values would be used."""
    if isinstance(value, np.ma.MaskedArray) or (
        isinstance(value, list | tuple) and _contains_kind(value, (np.ma.MaskedArray,))
    ):
        raise InvalidInputError(
            f"{what}: a masked array, of which the values behind the mask would be taken; give a"
            " plain one (array.filled(...), or array.compressed())"
        )


def answer_of(asked: object, method: str, call: Callable[..., Any], *given: Any) -> Any:
    """Return what a user's method returns; what it raises gets a note that names it."""
    try:
        return call(*given)
    except Exception as raised:
        raised.add_note(f"raised by {method}() of {asked}, a {type(asked).__name__}")
        raise


def returned_array(what: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Return the result of a user's function as a fresh float array of the given shape.

    Raises InvalidInputError: as :func:`finite_array`, and for arrays of objects and ``np.matrix``,
    whose products and rows are others than arrays'.
    """
    if isinstance(value, np.matrix) or _kind(value) not in "iuf":
        kind = type(value).__name__
        of = f" of {value.dtype}" if hasattr(value, "dtype") else ""
        raise InvalidInputError(f"{what}: expected an array of real numbers, got {kind}{of}")
    return finite_array(what, value, shape)


def finite_vector(what: str, value: ArrayLike, size: int) -> Array:
    """Return ``value`` as a fresh (size,) float array, as :func:`finite_array` does."""
    return finite_array(what, value, (size,))


def finite_array(
    what: str, value: ArrayLike, shape: tuple[int, ...], largest: float = LARGEST
) -> Array:
    """Return ``value`` as a fresh float array of the given shape, every entry finite.

    Raises InvalidInputError: not real numbers, of another size, or holding NaN, infinity or an
    entry beyond ``largest``; the message names the entries.
    """
    plain = plain_copy(value, shape, largest)
    if plain is not None:
        return plain
    array = real_array(what, value)
    if array.shape != shape:
        part = {(3,): "translation", (3, 3): "rotation"}.get(shape, "")
        hint = f"; of a pose T give T.{part}" if part and array.shape == (4, 4) else ""
        if part == "rotation" and array.shape == (4,):
            hint = "; of a quaternion give wbc.rotations.rotation_from((x, y, z, w))"
        raise InvalidInputError(f"{what}: expected shape {shape}, got {array.shape}{hint}")
    for fault, found in (
        ("NaN or infinite", ~np.isfinite(array)),
        (f"beyond {largest:g}", np.abs(array) > largest),
    ):
        if found.any():
            where = ", ".join(str(tuple(index.tolist())) for index in np.argwhere(found)[:5])
            wanted = "finite" if fault.startswith("NaN") else f"at most {largest:g}"
            raise InvalidInputError(f"{what}: {fault} at {where}; every entry must be {wanted}")
    return np.asarray(array, dtype=FLOAT)  # an unpickled array's equal type is another object


def finite_number(
    what: str, value: Any, *, above: float = -math.inf, least: float = -math.inf
) -> float:
    """Return ``value`` as a finite float, strictly above ``above`` and at least ``least``."""
    if type(value) is float and above < value >= least and -LARGEST <= value <= LARGEST:
        return value  # the fast path of ticks
    try:
        # Lists first: NumPy warns of masked values in them.
        odd = isinstance(value, (list, tuple, *_NO_NUMBER)) or bool(np.ndim(value))
        if odd or np.iscomplexobj(value) or _kind(value) == "b":
            raise TypeError("no real scalar")
        number = float(value)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidInputError(f"{what}: expected a number, got {shown(value)}") from error
    if not math.isfinite(number):
        raise InvalidInputError(f"{what}: must be finite, got {number}")
    if abs(number) > LARGEST:
        raise InvalidInputError(f"{what}: {number:g} is beyond {LARGEST:g}")
    if number <= above:
        raise InvalidInputError(f"{what}: must be greater than {above:g}, got {number:g}")
    if number < least:
        raise InvalidInputError(f"{what}: must be at least {least:g}, got {number:g}")
    return number


def time_step(what: str, dt: Any) -> float:
    """Return ``dt`` as a positive time step [s]; warn if it seems to be in ms."""
    step = finite_number(f"{what}, dt", dt, above=0.0)
    if step >= LONG_STEP:
        _warn_unit(what, "dt", step, "is in seconds, and %g is long for a tick; %g ms")
    return step


def clearance(what: str, margin: Any) -> float:
    """Return ``margin`` [m], at least 0; warn if it seems to be in mm or cm."""
    wide = finite_number(f"{what}, margin", margin, least=0.0)
    if wide >= WIDE_MARGIN:
        _warn_unit(what, "margin", wide, "is in metres, and %g is wide for a robot; %g mm")
    return wide


def _warn_unit(what: str, name: str, value: float, doubt: str) -> None:
    """Warn of a number that seems to be in thousandths of its unit; ``doubt`` ends the text."""
    told = what, name, value, value, name, value / 1000.0
    logging.getLogger(__name__).warning(f"%s: %s {doubt} are %s=%g", *told)


def names_of(what: str, value: Any) -> tuple[str, ...]:
    """Return a list of distinct names, or one name, as a tuple; otherwise InvalidInputError."""
    names = (value,) if isinstance(value, str) else value
    if not isinstance(names, Iterable):
        raise InvalidInputError(f"{what}: expected a list of names, got {shown(value)}")
    names = tuple(names)
    for name in names:
        if not isinstance(name, str) or not name:
            raise InvalidInputError(f"{what}: expected names, got {shown(name)}")
        if names.count(name) > 1:
            raise InvalidInputError(f"{what}: {name!r} is named twice")
    return names


def list_of(what: str, value: Any, kind: type[Part], example: str) -> tuple[Part, ...]:
    """Return a list of parts of one kind, as a tuple.

    ``example``: one of them in Python, for the message.

    Raises InvalidInputError: something else: one part, names, settings that are not made a part
    yet.
    """
    wanted = f"{what}: expected a list of {kind.__name__} objects, such as [{example}]"
    if not isinstance(value, Iterable) or isinstance(value, str | Mapping):
        raise InvalidInputError(f"{wanted}, got {shown(value)}")
    parts = tuple(value)
    for part in parts:
        if not isinstance(part, kind):
            raise InvalidInputError(f"{wanted}; in the list is {shown(part)}")
    return parts


def by_name(what: str, value: Any) -> Mapping[str, Any]:
    """Return ``value`` if it is a mapping from names; otherwise raise InvalidInputError."""
    if not isinstance(value, Mapping):
        raise InvalidInputError(f"{what}: expected {{name: value}}, got {shown(value)}")
    for name in value:
        if not isinstance(name, str):
            raise InvalidInputError(f"{what}: expected names as keys, got {shown(name)}")
    return value


def check_fields(
    instance: Any,
    what: str,
    *names: str,
    above: float = -math.inf,
    least: float = -math.inf,
    unlimited: bool = False,
) -> None:
    """Make fields of a dataclass, frozen or not, the :func:`finite_number` that each holds.

    ``what`` begins the messages, before the field's name. With ``unlimited`` infinity passes too.
    """
    for name in names:
        value = getattr(instance, name)
        if not (unlimited and isinstance(value, float) and value == math.inf):
            number = finite_number(f"{what}{name}", value, above=above, least=least)
            object.__setattr__(instance, name, number)


def set_fields(instance: Any, **values: Any) -> None:
    """Set fields of a frozen dataclass while it is being made."""
    for name, value in values.items():
        object.__setattr__(instance, name, value)


def interval(what: str, value: Any, *, positive: bool = False) -> tuple[float, float]:
    """Return ``value`` as (least, greatest), 0 <= least < greatest; infinity is no upper limit.

    ``positive`` asks for a least above zero.
    """
    pair = real_array(what, value)
    if pair.shape != (2,):
        raise InvalidInputError(f"{what} must be a pair (least, greatest), got {shown(value)}")
    low, high = pair.tolist()
    if not 0.0 <= low < high:
        raise InvalidInputError(f"{what} must be 0 <= least < greatest, got ({low:g}, {high:g})")
    if positive and low == 0.0:
        group, _, name = what.rpartition(" ")
        raise InvalidInputError(f"{group} the least {name} must be positive")
    return low, high


def read_only(array: NDArray[Any]) -> Array:
    """Mark ``array`` as read-only and return it."""
    array.setflags(False)  # type: ignore[call-arg]  # "write", which by name takes twice as long
    return array
