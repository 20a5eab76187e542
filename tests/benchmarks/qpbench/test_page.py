"""Sections of a page are replaced in place, and nothing else is touched."""

from pathlib import Path

from qpbench.page import has_section, put_section, with_section

PAGE = "# Results\n\n<!-- ticks -->\n\nold\n\n<!-- /ticks -->\n\n## Campaigns\n\nby hand\n"


def test_a_section_is_replaced_in_place_twice_the_same() -> None:
    once = with_section(PAGE, "ticks", "new\n")
    assert once == PAGE.replace("old", "new")
    assert with_section(once, "ticks", "new") == once


def test_a_section_that_is_not_there_comes_last() -> None:
    assert not has_section(PAGE, "solvers")
    page = with_section(PAGE, "solvers", "table")
    assert page == f"{PAGE}\n<!-- solvers -->\n\ntable\n\n<!-- /solvers -->\n"
    assert has_section(page, "solvers") and with_section(page, "ticks", "old") == page
    # An end without a beginning before it is no place.
    assert not has_section("<!-- /a --> <!-- a -->", "a")


def test_a_page_that_is_not_there_is_begun(tmp_path: Path) -> None:
    path = tmp_path / "new.md"
    put_section(path, "ticks", "one")
    put_section(path, "ticks", "two")
    assert path.read_text() == "<!-- ticks -->\n\ntwo\n\n<!-- /ticks -->\n"
