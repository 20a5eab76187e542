"""Marks of tests that need what a machine may lack; `wbc doctor` says why it does."""

import pytest

from wbc.native import status
from wbc.qp.daqp_direct import direct_daqp

needs_core = pytest.mark.skipif(status().core is None, reason=status().reason)
# The core, and the Python beside it, call DAQP's own C function.
needs_direct_daqp = pytest.mark.skipif(not direct_daqp().address, reason=direct_daqp().reason)
