"""Numbers that the core's sources and Python both have: each says where it is from."""

import importlib
import re

import pytest

from wbc.codegen.recording import _REASONS
from wbc.controllers import native_memory
from wbc.native.fingerprint import SOURCE

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
    assert groups == mentioned >= 9
    assert len(said()) > 15


def test_what_the_core_says_is_known_by_its_number() -> None:
    text = (SOURCE / "core.h").read_text(encoding="ascii")
    every = re.search(r"enum handed_over \{([^}]+)\}", text)
    assert every is not None
    numbers = {name: int(k) for name, k in re.findall(r"(\w+) = (-?\d+)", every[1])}
    assert numbers["DONE"] == 0
    assert numbers["REDUCED"] == native_memory.REDUCED
    # Exported C solves all itself: nothing is left to others.
    assert {*_REASONS} == {*numbers.values()} - {0, numbers["REDUCED"]}
