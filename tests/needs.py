"""Marks of tests that need what a machine may lack."""

import shutil

import pytest

from wbc.qp.backend import qpsolvers_names

needs_bench = pytest.mark.skipif(
    not {"clarabel", "daqp", "osqp", "piqp"} <= set(qpsolvers_names()), reason="needs wbc[bench]"
)
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler here")
