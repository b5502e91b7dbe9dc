"""Names are the field's terms, not pronouns, participles or counts.

`WORDS` do not say what a thing is. In each room no variable, argument or field has such a name but
for those listed, most of which users write. `python tests/unit/test_names.py [ROOM]` prints the
shares of all rooms, or the places in one.
"""

from __future__ import annotations

import ast
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WORDS = frozenset(
    """
    after all_ alone apart around away before both each every far few first found given here how
    known last least left made many mine more most much near now one other others own said says
    second some text their then there told together wanted what which who whole why
    """.split()
)
KEPT: dict[str, str] = {
    "accuracy": "how why",  # of an error by source, as stored with a run
    "acquisition": "first last",  # images and shots by their order
    "api": "one other",  # of `cldit.separate`
    "bench": "text",  # of a part of the page
    "camera": "",
    "cfd": "first second text why",
    "cli": "",
    "comparison": "one other text",  # of differences, and of an unknown
    "dit": "says text",
    "drivers": "",
    "gpu": "others",  # of `Device`
    "io": "what",  # of `Run.plot`
    "medium": "first last",
    "optics": "near",
    "prepare": "made text",
    "radiance": "",
    "rig": "",
    "run": "wanted",  # of `cldit.opencl_device`
    "scene": "",
    "show": "left text what",  # edge of an image; packed arrays; of `Run.plot`
    "spray": "",
    "study": "text",  # of a page
    "testing": "first last text told wanted what",  # of the contract, for authors of drivers
    "transport": "first known",  # of a range; of gradients that precede those from neighbours
}


@cache
def names(room: str) -> list[tuple[str, str]]:
    """Names bound in a room, each with its place."""
    top = ROOT / room if room == "drivers" else ROOT / "cldit" / room
    bound: list[tuple[str, str]] = []
    for path in sorted(top.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            name = ""
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                name = node.id
            elif isinstance(node, ast.arg):
                name = node.arg
            elif isinstance(node, ast.ExceptHandler):
                name = node.name or ""
            if name:
                bound.append((name, f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}"))
    return bound


def share(room: str) -> float:
    """Names of `WORDS` in a room, in percent."""
    bound = names(room)
    return 100.0 * sum(name in WORDS for name, _ in bound) / len(bound)


def rooms() -> list[str]:
    folders = (path.name for path in (ROOT / "cldit").iterdir() if (path / "__init__.py").exists())
    return sorted({*folders, "drivers"} - {"kernels"})


@pytest.mark.parametrize("room", KEPT)
def test_a_room_names_things_by_what_they_are(room: str) -> None:
    kept = set(KEPT[room].split())
    again = [f"{place}: {name}" for name, place in names(room) if name in WORDS - kept]
    assert not again, "\n".join(again)
    assert kept <= {name for name, _ in names(room)}, f"{room}: {kept} are not all there"


def test_every_room_is_listed() -> None:
    assert sorted(KEPT) == rooms()


def report(room: str | None) -> None:
    for name in rooms() if room is None else ():
        print(f"{name:14}{share(name):6.1f} % of {len(names(name)):5} names")
    for name, place in names(room) if room is not None else ():
        if name in WORDS:
            print(f"{place}: {name}")


if __name__ == "__main__":
    report(sys.argv[1] if len(sys.argv) > 1 else None)
