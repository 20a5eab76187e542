"""``wbc doctor`` says what runs here."""

import re

import pytest

from tests.command import wbc_command
from wbc.robot import kernel


def test_versions_the_core_and_its_distance_from_pinocchio_are_said() -> None:
    answer = wbc_command("doctor")
    assert answer.exit_code == 0, answer.output
    assert "cffi " in answer.output and "pin 4" in answer.output
    assert re.search(r"core: \S*_core\S*\.so", answer.output)
    apart = re.search(r"against Pinocchio on hoap2_like: (\S+)", answer.output)
    assert apart is not None and 0.0 < float(apart[1]) < 1e-11  # rounding, of sums in another order


def test_a_core_that_is_wrong_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    right = kernel._body
    monkeypatch.setattr(kernel, "_body", lambda inertia: right(inertia) * (1 + 1e-3))
    answer = wbc_command("doctor")
    assert answer.exit_code == 1
    assert "'hoap2_like': the compiled core and Pinocchio" in " ".join(answer.stderr.split())
