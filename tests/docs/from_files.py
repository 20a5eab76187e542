"""Figures as they stand in the files that commands wrote."""

import json
from collections.abc import Callable, Iterable

from tests.docs.page_figures import ROOT

Figures = Callable[[], Iterable[object]]


def from_json(name: str, form: str, *paths: str) -> Figures:
    """Return numbers of a file by their places, keys with ``/`` between them, as text."""

    def figures() -> list[str]:
        found = []
        for path in paths:
            value = json.loads((ROOT / "benchmarks" / name).read_text("utf-8"))
            for key in path.split("/"):
                value = value[int(key)] if isinstance(value, list) else value[key]
            found.append(form.format(value))
        return found

    return figures


def both(*parts: Figures) -> Figures:
    return lambda: [figure for part in parts for figure in part()]
