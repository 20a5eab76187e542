"""What the core says, and what Python has words for."""

import re

from wbc.codegen.recording import _REASONS
from wbc.native import ffi, lib
from wbc.native.sources import SOURCE


def test_no_number_of_python_stands_again_in_the_core() -> None:
    """Python reads those that both need from the core: ``extern const`` of core.h."""
    texts = [file.read_text(encoding="ascii") for file in SOURCE.glob("*.[ch]")]
    assert not [found for text in texts for found in re.findall(r"[Aa]s in wbc/\S+\.py", text)]


def test_every_reason_why_the_core_gives_no_command_has_its_words() -> None:
    # Exported C solves all itself: nothing is left to others.
    others = {lib.DONE, lib.REDUCED, lib.OUTLIER}  # the last of filters, which are no ticks
    assert {*_REASONS} == {*ffi.typeof("enum status").elements} - others
