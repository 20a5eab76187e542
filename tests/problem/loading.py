"""Problems from texts, and what is said of texts that are none."""

from pathlib import Path
from typing import Any

import pytest

from wbc.errors import ProblemFileError
from wbc.problem import Problem, load_problem


def problem_of(folder: Path, text: str, overrides: dict[str, Any] | None = None) -> Problem:
    file = folder / "p.yaml"
    file.write_text(text)
    return load_problem(file, overrides)


def complaint_of(folder: Path, text: str, overrides: dict[str, Any] | None = None) -> str:
    """Return the message, without the folder, with which a text is refused."""
    with pytest.raises(ProblemFileError) as caught:
        problem_of(folder, text, overrides)
    return str(caught.value).replace(str(folder / "p.yaml"), "p.yaml")
