"""The documentation's site, built: it has every public name, and takes nothing from elsewhere."""

import os
import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

import pytest

import wbc
from tests.needs import BROWSER, SOFTWARE

SITE = Path(__file__).parents[2] / "docs" / "site" / "mkdocs.yml"
QUIET = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
LOADED = re.compile(r'<(?:script|link|img)\b[^>]*?\b(?:src|href)="?([^"\s>]+)')
LINKED = re.compile(r'<a\b[^>]*?\bhref="?([^"\s>]+)')
FOLDER = Path(__file__).parents[2] / "docs" / "reference"
# Rooms, and what is on the page of errors as a whole.
ELSEWHERE = {"__version__", "WbcError", "gait", "simulation", "view"}


@pytest.mark.slow
def test_site_opens_without_a_server(tmp_path: Path) -> None:
    pytest.importorskip("mkdocs")
    command = [sys.executable, "-m", "mkdocs", "build", "-q", "--strict", "-f", str(SITE)]
    subprocess.run([*command, "-d", str(tmp_path)], check=True, timeout=600, env=QUIET)
    pages = [page for page in tmp_path.rglob("*.html") if page.name != "404.html"]
    assert len(pages) > 30
    for page in pages:
        text = page.read_text(encoding="utf-8")
        for address in LOADED.findall(text):
            assert not address.startswith(("http:", "https:", "//")), f"{page}: loads {address}"
        for address in LINKED.findall(text):
            if not re.match(r"[a-z]+:", address):
                file = unquote(address.partition("#")[0])
                assert not file or (page.parent / file).is_file(), f"{page}: leads to {address}"
    # Pages that are opened as files may not fetch JSON: the index is a script, which theirs loads.
    assert (tmp_path / "search" / "search_index.js").read_text().startswith("var __index = {")
    (bundle,) = (tmp_path / "assets" / "javascripts").glob("bundle.*.js")
    assert "search/search_index.js" in bundle.read_text(encoding="utf-8")
    assert "IFrameWorker" in (tmp_path / "assets" / "iframe-worker.js").read_text()
    if BROWSER:
        search_in_a_browser(tmp_path)


def search_in_a_browser(site: Path) -> None:
    """Open a page as a file, without a network, search for a word, and follow what is found."""
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as running:
        browser = running.chromium.launch(executable_path=BROWSER, args=list(SOFTWARE))
        tab = browser.new_context(offline=True, viewport={"width": 1300, "height": 800}).new_page()
        tab.set_default_timeout(120_000.0)
        tab.goto((site / "howto" / "failed-tick.html").as_uri())
        tab.click("input.md-search__input")
        tab.keyboard.type("replay")
        tab.wait_for_selector("a.md-search-result__link")
        found = tab.locator("a.md-search-result__link").first
        address = found.get_attribute("href")
        browser.close()
    assert address is not None and address.startswith("file:") and ".html" in address


def test_every_public_name_is_there() -> None:
    pages = "".join(path.read_text(encoding="utf-8") for path in FOLDER.glob("*.md"))
    shown = re.findall(r"^::: ([\w.]+)$", pages, flags=re.MULTILINE)
    assert len(shown) == len(set(shown))
    missing = set(wbc.__all__) - ELSEWHERE - {name.rpartition(".")[2] for name in shown}
    assert not missing, f"add '::: wbc.NAME' to a page of docs/reference for {sorted(missing)}"
