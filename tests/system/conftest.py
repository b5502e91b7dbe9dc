"""A Chromium for the tests of `cldit view`'s page; they are skipped without one, or playwright."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.viewed import Viewer, chromium


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    path = chromium()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        opened = play.chromium.launch(executable_path=path)
        yield opened
        opened.close()


@pytest.fixture
def viewer(browser: Any) -> Iterator[Viewer]:
    context = browser.new_context(viewport={"width": 1280, "height": 900}, accept_downloads=True)
    viewer = Viewer(context.new_page())
    yield viewer
    assert viewer.complaints == []
    own = {"file", "data", "blob"}
    assert {address.partition(":")[0] for address in viewer.asked} <= own
    assert len([one for one in viewer.asked if one.startswith("file")]) == 1  # the page itself
    context.close()
