"""Marks of tests that need what a machine may lack."""

import os
import shutil

import pytest

from wbc.qp.backend import qpsolvers_names

# A Chromium, and how it draws without a graphics card.
BROWSER = os.environ.get("WBC_BROWSER", "")
SOFTWARE = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")  # fmt: skip
needs_browser = pytest.mark.skipif(not BROWSER, reason="WBC_BROWSER names no Chromium")

needs_bench = pytest.mark.skipif(
    not {"clarabel", "daqp", "osqp", "piqp"} <= set(qpsolvers_names()), reason="needs wbc[bench]"
)
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler here")
