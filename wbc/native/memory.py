"""Where arrays lie, as the core is told."""

from __future__ import annotations

import ctypes
from typing import Any

from numpy.typing import NDArray

_from_buffer: Any = ctypes.c_char.from_buffer


def address(array: NDArray[Any]) -> int:
    """Return where the first entry of a contiguous array lies; who keeps it keeps the array.

    What may be written to is asked in a fifth of the time that ``array.ctypes.data`` takes.
    """
    try:
        return ctypes.addressof(_from_buffer(array))
    except (TypeError, ValueError):  # read-only, or empty
        return array.ctypes.data
