"""A page of Markdown on which several commands each keep a section of their own, between marks."""

from __future__ import annotations

from pathlib import Path

from wbc.files import write_text


def marks(name: str) -> tuple[str, str]:
    """Return what a section begins and ends with: comments, which are not shown."""
    return f"<!-- {name} -->", f"<!-- /{name} -->"


def has_section(page: str, name: str) -> bool:
    """Whether a page has a place for a section."""
    begin, end = marks(name)
    return end in page.partition(begin)[2]


def with_section(page: str, name: str, text: str) -> str:
    """Return a page with the text of a section replaced, or put at the end if it is not there."""
    begin, end = marks(name)
    if not has_section(page, name):
        page = f"{page.rstrip()}\n\n{begin}{end}\n".lstrip()
    head, _, rest = page.partition(begin)
    return f"{head}{begin}\n\n{text.strip()}\n\n{end}{rest.partition(end)[2]}"


def put_section(path: Path, name: str, text: str) -> None:
    """Write a section into a page, which need not be there.

    Raises
    ------
    OSError
        The page cannot be read or written.
    """
    page = path.read_text(encoding="utf-8") if path.exists() else ""
    write_text(path, with_section(page, name, text))
