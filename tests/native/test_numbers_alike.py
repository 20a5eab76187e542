"""Numbers that the core's sources and Python both have: each says where it is from."""

import importlib
import re

import pytest

from wbc.codegen.recording import _REASONS
from wbc.native import ffi, lib
from wbc.native.sources import SOURCE

GROUP = re.compile(r"/\* As in (wbc/[\w/]+)\.py\. \*/\n((?:static const double [^;]+;\s*?\n)+)")
SAID = re.compile(r"\b(\w+) = ([^,;]+)[,;]")


def said() -> list[tuple[str, str, float]]:
    """Return module, name and value of each."""
    found = []
    for file in sorted(SOURCE.glob("*.[ch]")):
        for path, lines in GROUP.findall(file.read_text(encoding="ascii")):
            found += [
                (path.replace("/", "."), name, float(value)) for name, value in SAID.findall(lines)
            ]
    return found


@pytest.mark.parametrize(("module", "name", "value"), said())
def test_a_number_of_the_core_is_that_of_python(module: str, name: str, value: float) -> None:
    assert getattr(importlib.import_module(module), name) == value


def test_none_is_left_out() -> None:
    """Where a comment says so in other words, nothing would be compared."""
    texts = [file.read_text(encoding="ascii") for file in SOURCE.glob("*.[ch]")]
    mentioned = sum(len(re.findall(r"[Aa]s in wbc/[\w/]+\.py\.", text)) for text in texts)
    groups = sum(len(GROUP.findall(text)) for text in texts)
    assert groups == mentioned >= 7
    assert len(said()) > 10


def test_every_reason_why_the_core_gives_no_command_has_its_words() -> None:
    # Exported C solves all itself: nothing is left to others.
    others = {lib.DONE, lib.REDUCED, lib.OUTLIER}  # the last of filters, which are no ticks
    assert {*_REASONS} == {*ffi.typeof("enum said").elements} - others
