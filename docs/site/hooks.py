"""The search index as a script too: a page that is opened as a file cannot fetch JSON. Pages that
a keyboard and a screen reader can use. The list of all keys of scenes, from their schema."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.pages import Page

_MENDED = (
    (r"(<pre[^>]*>(?:<span></span>)?<code)", r'\1 tabindex="0"'),  # wide ones scroll
    (r"<table>", '<table tabindex="0">'),
    (r"<th([^>]*)>\s*</th>", r"<td\1></td>"),  # heads nothing
    (r'<div role="contentinfo">', "<div>"),  # is one part of the footer
    (r"<footer>", '<footer role="contentinfo">'),
    (r'(class="rst-versions" role=)"note"', r'\1"navigation"'),
)


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    if page.file.src_uri != "scene-reference.md":
        return markdown
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    from tests.bench.scene_reference import reference

    return f"{markdown}\n\n{reference()}\n"


def on_post_page(output: str, **_: Any) -> str:
    for found, mended in _MENDED:
        output = re.sub(found, mended, output)
    return output


on_post_template = on_post_page  # of 404.html and search.html


def on_post_build(config: MkDocsConfig) -> None:
    folder = Path(config.site_dir, "search")
    index = (folder / "search_index.json").read_text(encoding="utf-8")
    (folder / "search_index.js").write_text(f"var searchIndex = {index};\n", encoding="utf-8")
