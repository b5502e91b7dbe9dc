"""The docs as a site: built without a warning, whole, and without anything from a network."""

from __future__ import annotations

import logging
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest

import cldit
from tests.extras import needs
from tests.system.test_accessible import axe, found
from tests.viewed import Viewer

__all__ = ["axe"]  # a fixture

pytestmark = [pytest.mark.slow, needs("mkdocs", "mkdocstrings", extra="docs")]

_DOCS = Path(__file__).parents[2] / "docs"


class _Links(HTMLParser):
    """Addresses that a page loads, and the anchors in it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.loaded: list[str] = []
        self.ids: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.ids.add(given.get("id") or "")
        address = given.get("src") or given.get("href")
        if address is not None and tag != "a":
            self.loaded.append(address)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from mkdocs.commands import build
    from mkdocs.config import load_config

    folder = tmp_path_factory.mktemp("site")
    heard: list[str] = []

    class Ear(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            heard.append(record.getMessage())

    ear = Ear(logging.WARNING)
    logging.getLogger("mkdocs").addHandler(ear)
    try:
        loaded = load_config(str(_DOCS / "site" / "mkdocs.yml"), site_dir=str(folder))
        assert loaded.strict
        loaded.strict = False  # so that the warnings are listed below
        build.build(loaded)
    finally:
        logging.getLogger("mkdocs").removeHandler(ear)
    assert heard == []
    return folder


def test_every_page_is_there(site: Path) -> None:
    for page in _DOCS.rglob("*.md"):
        made = site / page.relative_to(_DOCS).with_suffix(".html")
        assert made.is_file()
        title = page.read_text(encoding="utf-8").partition("\n")[0]
        assert title.startswith("# ")
    assert not list(site.rglob("*.json.html"))


@pytest.mark.parametrize("page", ["index", "gallery", "studies/walls", "api/index", "spray"])
def test_pages_are_accessible(viewer: Viewer, axe: str, site: Path, page: str) -> None:
    """Also on a phone, where code and tables scroll."""
    viewer.page.set_viewport_size({"width": 400, "height": 800})
    viewer.page.goto((site / f"{page}.html").as_uri())
    assert found(viewer, axe) == []
    viewer.complaints.clear()  # mkdocs' search has no Worker in a file, see search.js
    del viewer.asked[1:]  # a page of the site loads its own files


def test_search_has_its_index_as_a_script(site: Path) -> None:
    script = (site / "search" / "search_index.js").read_text(encoding="utf-8")
    assert script.startswith("var searchIndex = {") and "GMRES" in script
    assert (site / "search" / "lunr.js").is_file()
    assert 'site/search.js"' in (site / "search.html").read_text(encoding="utf-8")


def test_nothing_is_loaded_from_outside(site: Path) -> None:
    pages = {path: _Links(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    for path, page in pages.items():
        if path.name in ("404.html", "search.html"):
            continue  # linked from the site's root
        for address in page.loaded:
            assert "//" not in address and (path.parent / unquote(address)).exists(), address


def test_the_api_has_every_public_name(site: Path) -> None:
    ids: set[str] = set()
    for path in (site / "api").glob("*.html"):
        ids |= _Links(path.read_text(encoding="utf-8")).ids
    for name in set(cldit.__all__) - {"__version__"}:
        public = getattr(cldit, name)
        assert f"{public.__module__}.{public.__qualname__}" in ids, name
    assert {"cldit.rig.protocols.Camera.read_frames", "cldit.rig.drivers.RigContext"} <= ids


def test_arguments_that_are_described_together_have_a_row_each(site: Path) -> None:
    page = (site / "api" / "evaluation.html").read_text(encoding="utf-8")
    for name in ("shots", "references"):  # of evaluate_radiance
        assert f"<code>{name}</code>" in page
    assert "shots, references" not in page
