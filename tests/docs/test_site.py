"""The documentation's site, built: it opens as files, and takes nothing from elsewhere."""

import os
import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

import pytest

SITE = Path(__file__).parents[2] / "docs" / "site" / "mkdocs.yml"
QUIET = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
LOADED = re.compile(r'<(?:script|link|img)\b[^>]*?\b(?:src|href)="?([^"\s>]+)')
LINKED = re.compile(r'<a\b[^>]*?\bhref="?([^"\s>]+)')


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
