"""Marks of tests that need what a machine may lack; `wbc doctor` says why it does."""

import pytest

from wbc.native import status
from wbc.qp.backend import qpsolvers_names

needs_core = pytest.mark.skipif(status().core is None, reason=status().reason)
needs_bench = pytest.mark.skipif(
    not {"clarabel", "daqp", "osqp", "piqp"} <= set(qpsolvers_names()), reason="needs wbc[bench]"
)
