"""What the core is compiled from, and how; the build (setup.py) runs this file.

Imports nothing of the package.
"""

from pathlib import Path
from typing import Any

SOURCE = Path(__file__).parent / "source"
# No -ffast-math and no contraction into fused operations: the same bits on every machine. No
# -march=native: it gains 6 %, and a wheel is for all machines.
FLAGS = ("-std=c99", "-O3", "-ffp-contract=off", "-fno-math-errno")


def declarations() -> str:
    """Return core.h as cffi reads it.

    The preprocessor's lines are left out: with them go macros with arguments, which stay in C.
    """
    lines = (SOURCE / "core.h").read_text(encoding="ascii").splitlines()
    return "\n".join(line for line in lines if not line.startswith("#"))


def builder() -> Any:
    """Return cffi's builder of ``wbc.native._core``."""
    from cffi import FFI

    ffi = FFI()
    ffi.cdef(declarations())
    ffi.set_source(
        "wbc.native._core",
        '#include "core.h"',
        sources=[file.as_posix() for file in sorted(SOURCE.glob("*.c"))],
        depends=[file.as_posix() for file in sorted(SOURCE.glob("*.h"))],
        include_dirs=[SOURCE.as_posix()],
        extra_compile_args=list(FLAGS),
        libraries=["m"],
    )
    return ffi
