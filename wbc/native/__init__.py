"""The compiled core: the arithmetic of a tick in C99, built and installed with the package.

``lib`` holds its functions and constants, ``ffi`` makes its structures: ``ffi.new("wbc_plan *")``;
both are cffi's, from ``source/core.h``. A structure's field that points at an array does not keep
it: who fills the field keeps the array. Calls release the interpreter's lock; what one writes to
belongs to its caller.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from numpy.typing import NDArray

try:
    from wbc.native._core import ffi, lib
except ImportError as error:
    raise ImportError(
        f"wbc's compiled core cannot be loaded ({error}); build it where the sources are:"
        " pip install --editable ."
    ) from error

__all__ = ["doubles", "ffi", "integers", "lib", "pointer"]

# Of a contiguous array, or of bytes that are only read: a fifth of what array.ctypes.data takes.
doubles: Any = partial(ffi.from_buffer, ffi.typeof("double[]"))
integers: Any = partial(ffi.from_buffer, ffi.typeof("int64_t[]"))


def pointer(array: NDArray[Any]) -> Any:
    """Return a pointer to the first entry of an array of either kind; NULL if it has none.

    It keeps the array; a structure's field that is set to it does not.
    """
    if not array.size:
        return ffi.NULL
    return integers(array) if array.dtype.kind == "i" else doubles(array)
