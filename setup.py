"""The compiled core, which every wheel has in it; all else is in pyproject.toml."""

from setuptools import setup

setup(
    cffi_modules=["wbc/native/sources.py:builder"],
    options={"bdist_wheel": {"py_limited_api": "cp311"}},
)
