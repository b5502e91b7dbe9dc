"""Files and names of the code that the docs point to are there."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

from tests.bench.scene_reference import reference

_ROOT = Path(__file__).parents[2]
_PAGES = ["README.md", "CONTRIBUTING.md"]
_PAGES += [str(page.relative_to(_ROOT)) for page in sorted((_ROOT / "docs").rglob("*.md"))]
_FILE = re.compile(r"`((?:cldit|kernels|drivers|tests|docs)/[\w./-]+)`")
_PLACE = re.compile(r"`([\w./-]+\.(?:py|cl|h))`(?:: ((?:`[\w.]+`(?:, )?)+))?")
_C_NAME = r"^(?:(?:INLINE|__kernel) [\w \*]*?\*?{0}\(|#define {0}\b)"


def places(text: str) -> list[tuple[str, list[str]]]:
    """Files in backticks, and the names that follow each after a colon."""
    return [(file, re.findall(r"`([\w.]+)`", names)) for file, names in _PLACE.findall(text)]


def is_defined(file: str, name: str) -> bool:
    """True if a file defines a function, class, constant or field, or `Class.name` of them."""
    text, last = (_ROOT / file).read_text(encoding="utf-8"), re.escape(name.rpartition(".")[2])
    owner = re.escape(name.rpartition(".")[0])
    if not file.endswith(".py"):
        return re.search(_C_NAME.format(last), text, re.MULTILINE) is not None
    if owner:  # up to the next line that is not indented
        body = re.search(rf"^class {owner}\b.*\n((?:[ )].*\n|\n)*)", text, re.MULTILINE)
        text = "" if body is None else body[1]
    return (
        re.search(rf"^\s*((def|class) {last}\b|{last}(:.*)? = |{last}: )", text, re.M) is not None
    )


def test_files_named_in_the_docs_exist() -> None:
    named = {page: _FILE.findall((_ROOT / page).read_text(encoding="utf-8")) for page in _PAGES}
    assert sum(map(len, named.values())) > 100
    missing = [
        (page, file) for page in named for file in named[page] if not (_ROOT / file).exists()
    ]
    assert missing == []


@cache
def anchors(path: Path) -> frozenset[str]:
    """Places in a page, as GitHub and mkdocs name them, and objects of API pages."""
    text = re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.M | re.S)
    text += f"\n{reference()}" if path.name == "scene-reference.md" else ""  # made with the site
    heads = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    slugs = [re.sub(r"[^\w\s-]", "", head).strip().lower() for head in heads]
    objects = re.findall(r"^::: (\S+)$", text, re.MULTILINE)
    return frozenset([*(re.sub(r"\s+", "-", slug) for slug in slugs), *objects])


def dead_links(path: Path) -> list[str]:
    """Relative links of a page to no file, or to no heading of a page."""
    dead = []
    text = re.sub(r"^```.*?^```|`[^`\n]*`", "", path.read_text(encoding="utf-8"), flags=re.M | re.S)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        target, _, place = link.partition("#")
        other = (path.parent / target).resolve() if target else path
        if "//" in link:
            continue
        names = {place, place.rpartition(".")[0]}  # also a member of a module
        if not other.exists() or (place and other.suffix == ".md" and not names & anchors(other)):
            dead.append(link)
    return dead


@pytest.mark.parametrize("page", [*_PAGES, "CHANGELOG.md"])  # as a site: test_site.py
def test_no_link_is_dead(page: str) -> None:
    assert dead_links(_ROOT / page) == []


@pytest.mark.parametrize("page", ["docs/glossary.md", "CONTRIBUTING.md"])
def test_names_are_defined_where_the_page_says(page: str) -> None:
    found = places((_ROOT / page).read_text(encoding="utf-8"))
    wrong = [(f, name) for f, names in found for name in names if not is_defined(f, name)]
    assert wrong == []
