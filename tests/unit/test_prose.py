"""Plain technical English, as far as it can be measured.

Docstrings begin with a verb or a noun, and the words below occur neither in docstrings, comments,
messages nor pages. `python tests/unit/test_prose.py [ROOM]` lists what is left.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FIRST = re.compile(
    r"(What|How|Whether|That|Which|Who|Where|When|Why|Of|As|By|In|On|At|From|To|With|Without|For"
    r"|If|And|Or|But|So|It|They|This|These|Those|There|Not|Nothing|None)\b"
)
WORDS = re.compile(
    r"\b((?<!cannot be )told|tells|errs?|erred|allowed (is|are)|stands|stood|pictures?"
    r"|left out|leaves? out"
    r"|speaks against|said of|of the same kind as|foretold|foretells?|foreseen"
    r"|(is|are) known by|goes? on)\b",
    re.IGNORECASE,
)
CODE = re.compile(r"`[^`]*`|\"[^\" ]*\"|\{[^}]*\}|\S*[/_.]\S+|<[^>]*>|\w+\(")
PAGES = [
    *(ROOT / "docs").rglob("*.md"),
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
]


def prose(text: str) -> str:
    """Text without code, names and paths."""
    return CODE.sub(" ", text)


def of_python(path: Path) -> Iterator[tuple[int, str]]:
    """Faults of one file: line and what is wrong."""
    source = path.read_text(encoding="utf-8")
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
            text = ast.get_docstring(node)
            if text and (found := FIRST.match(text)):
                yield node.body[0].lineno, f"docstring begins with {found[0]}"
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value:
            for found in WORDS.finditer(prose(node.value)):
                yield node.lineno, found[0]
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            for found in WORDS.finditer(prose(token.string)):
                yield token.start[0], found[0]


def of_text(path: Path) -> Iterator[tuple[int, str]]:
    """Faults of a page, a template or a kernel."""
    fenced = False
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        fenced ^= line.startswith("```")
        for found in () if fenced else WORDS.finditer(prose(line)):
            yield number, found[0]


def faults(path: Path) -> list[str]:
    found = of_python(path) if path.suffix == ".py" else of_text(path)
    return [f"{path.relative_to(ROOT)}:{line}: {what}" for line, what in found]


@cache
def files() -> dict[str, list[Path]]:
    rooms: dict[str, list[Path]] = {"docs": sorted(path for path in PAGES if path.is_file())}
    for top in ("cldit", "drivers", "kernels"):
        for path in sorted((ROOT / top).rglob("*")):
            parts = path.relative_to(ROOT / top).parts
            linked = top == "cldit" and parts[0] in ("drivers", "kernels")
            if path.suffix in (".py", ".cl", ".h", ".html", ".js") and not linked:
                rooms.setdefault(parts[0] if top == "cldit" and len(parts) > 1 else top, [])
                rooms[parts[0] if top == "cldit" and len(parts) > 1 else top].append(path)
    return rooms


def test_plain_english() -> None:
    found = [fault for paths in files().values() for path in paths for fault in faults(path)]
    assert not found, "\n".join(found)


def test_faults_are_found(tmp_path: Path) -> None:
    path = tmp_path / "module.py"
    path.write_text(
        '"""Whether a thing is so."""\na = "pictures/maps.png is"  # the picture errs\n'
    )
    assert [line for line, _ in of_python(path)] == [1, 2, 2]


if __name__ == "__main__":
    for name in sys.argv[1:] or sorted(files()):
        listed = [fault for path in files()[name] for fault in faults(path)]
        if len(sys.argv) > 1:
            print("\n".join(listed))
        print(f"{name}: {len(listed)}")
