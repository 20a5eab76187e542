"""The native core as an optional part of the wheel; all else is in pyproject.toml.

Where there is no C compiler the wheel is made without it: it is then compiled at first use, or
ticks run in Python.
"""

from pathlib import Path
from runpy import run_path

from setuptools import Extension, setup

core = run_path("wbc/native/fingerprint.py")
source = Path("wbc/native/source")  # relative: setuptools wants it so
setup(
    ext_modules=[
        Extension(
            "wbc.native._core",
            sources=[str(file) for file in sorted(source.glob("*.c"))],
            depends=[str(file) for file in sorted(source.glob("*.h"))],
            define_macros=[("WBC_SOURCE", f'"{core["fingerprint"]()}"')],
            extra_compile_args=list(core["FLAGS"]),
            libraries=["m"],
            optional=True,
        )
    ]
)
