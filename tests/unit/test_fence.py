"""Rooms keep their size and their place in the data flow.

`BUDGETS` has the raw lines that each room may have, in steps of 250, `ARROWS` the rooms that each
room may import from, deferred imports and imports for type checking included. Budgets and arrows
only fall; one that must grow is changed in the same commit, with the reason in its message. No two
files import each other, directly or through others. `python tests/unit/test_fence.py` prints lines,
files, classes and imports by room.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SUFFIXES = {".py", ".cl", ".h", ".js", ".html", ".css"}
LARGEST_FOLDER = 26  # source files
STEP = 250  # lines: a limit, not a line to edit in every commit

BUDGETS: dict[str, int] = {
    "accuracy": 3500,
    "acquisition": 5500,
    "api": 1500,
    "bench": 750,
    "camera": 750,
    "cfd": 9250,
    "cldit": 250,
    "cli": 3000,
    "comparison": 3250,
    "dit": 7000,
    "drivers": 3750,
    "gpu": 1250,
    "io": 2000,
    "kernels": 6250,
    "medium": 2000,
    "optics": 3500,
    "prepare": 1250,
    "radiance": 1000,
    "rig": 2000,
    "run": 2750,
    "scene": 2250,
    "show": 6750,
    "spray": 6250,
    "study": 3500,
    "testing": 1500,
    "transport": 7750,
}
NO_MODULES = {"cldit", "cldit.drivers"}  # as texts: the distribution, and a group of entry points
ARROWS: dict[str, str] = {
    "accuracy": "camera cldit dit gpu medium optics prepare radiance scene spray transport",
    "acquisition": "camera cldit io optics radiance rig scene",
    "api": "acquisition camera cfd cldit cli comparison dit gpu io rig run scene show spray study",
    "bench": "accuracy cldit gpu io run scene show",
    "camera": "cldit optics scene",
    "cfd": "cldit io scene spray",
    "cldit": "api cfd cli comparison gpu io run scene show study",
    "cli": (
        "accuracy acquisition api bench cfd cldit comparison dit gpu io prepare rig run "
        "scene show spray study testing"
    ),
    "comparison": "accuracy acquisition camera cldit dit io optics radiance run scene",
    "dit": "acquisition camera cldit io optics radiance rig scene",
    "drivers": "camera cldit io optics radiance rig run scene ",
    "gpu": "cldit io",
    "io": "cldit",
    "kernels": "",
    "medium": "cldit gpu spray",
    "optics": "cldit io medium scene spray",
    "prepare": "camera cfd cldit gpu io medium optics scene spray transport",
    "radiance": "cldit io optics scene",
    "rig": "camera cldit io radiance scene",
    "run": (
        "accuracy camera cfd cldit dit gpu io medium optics prepare radiance scene spray transport"
    ),
    "scene": "cldit io",
    "show": ("accuracy acquisition camera cldit comparison dit io optics radiance run scene spray"),
    "spray": "cldit gpu io scene",
    "study": ("camera cldit comparison dit gpu io optics prepare radiance run scene show spray"),
    "testing": "cldit io rig",
    "transport": "cldit gpu medium optics radiance scene",
}


@cache
def sources() -> dict[str, list[Path]]:
    """Source files by room; the package's own loose files are the room `cldit`."""
    rooms: dict[str, list[Path]] = defaultdict(list)
    for top in ("cldit", "drivers", "kernels"):
        for path in sorted((ROOT / top).rglob("*")):
            linked = top == "cldit" and path.relative_to(ROOT).parts[1] in ("drivers", "kernels")
            if path.suffix in SUFFIXES and path.is_file() and not linked:
                parts = path.relative_to(ROOT / top).parts
                rooms[parts[0] if top == "cldit" and len(parts) > 1 else top].append(path)
    return dict(rooms)


def lines_of(path: Path) -> int:
    return path.read_text(encoding="utf-8").count("\n")


def lines(room: str) -> int:
    return sum(lines_of(path) for path in sources()[room])


def module_of(path: Path) -> str:
    """Name under which a file is imported."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    parts = parts if parts[0] == "cldit" else ("cldit", *parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def modules() -> dict[str, Path]:
    """Files of the package by the name of the module."""
    return {module_of(path): path for paths in sources().values() for path in paths
            if path.suffix == ".py"}  # fmt: skip


@cache
def imports(path: Path) -> frozenset[str]:
    """Modules of the package that a file imports: in functions, for type checking, and those whose
    names are texts in a file that calls `import_module`."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    by_name = any(isinstance(node, ast.Name) and node.id == "import_module" for node in nodes)
    names: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            members = (f"{node.module}.{alias.name}" for alias in node.names)
            names |= {name if name in modules() else node.module for name in members}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif by_name and isinstance(node, ast.Constant) and isinstance(node.value, str):
            names |= {node.value.partition(":")[0]} - NO_MODULES
    return frozenset(names & modules().keys() - {module_of(path)})


@cache
def arrows(room: str) -> frozenset[str]:
    """Rooms that a room imports from."""
    rooms = {module_of(path): name for name, paths in sources().items() for path in paths}
    files = (path for path in sources()[room] if path.suffix == ".py")
    return frozenset({rooms[name] for path in files for name in imports(path)} - {room})


def circles() -> list[list[str]]:
    """Groups of files that import each other, directly or through others (Tarjan 1972)."""
    graph = {name: sorted(imports(path)) for name, path in modules().items()}
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    groups: list[list[str]] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for imported in graph[name]:
            if imported not in index:
                visit(imported)
            if imported in stack:
                low[name] = min(low[name], low[imported])
        if low[name] == index[name]:
            group = stack[stack.index(name) :]
            del stack[stack.index(name) :]
            groups.extend([sorted(group)] if len(group) > 1 else [])

    for name in graph:
        if name not in index:
            visit(name)
    return groups


def test_no_files_import_each_other() -> None:
    assert not circles()


@pytest.mark.parametrize("room", sorted(sources()))
def test_a_room_keeps_its_budget(room: str) -> None:
    assert room in BUDGETS, f"{room}: a new room needs a budget"
    assert lines(room) <= BUDGETS[room], f"{room}: {lines(room)} lines of {BUDGETS[room]}"


@pytest.mark.parametrize("room", sorted(sources()))
def test_a_room_imports_only_from_its_arrows(room: str) -> None:
    new = arrows(room) - set(ARROWS[room].split())
    assert not new, f"{room} imports from {', '.join(sorted(new))}"


def test_budgets_and_arrows_follow_the_code() -> None:
    """A budget is the next whole step above its room, and every arrow is used."""
    loose = {room: (lines(room), most) for room, most in BUDGETS.items()
             if most != -(-lines(room) // STEP) * STEP}  # fmt: skip
    assert not loose
    unused = {room: sorted(set(names.split()) - arrows(room)) for room, names in ARROWS.items()}
    assert not any(unused.values()), unused


def test_no_folder_is_crowded() -> None:
    counts: dict[Path, int] = defaultdict(int)
    for paths in sources().values():
        for path in paths:
            counts[path.parent] += 1
    crowded = {str(folder.relative_to(ROOT)): count for folder, count in counts.items()
               if count > CROWDED.get(str(folder.relative_to(ROOT)), LARGEST_FOLDER)}  # fmt: skip
    assert not crowded


CROWDED: dict[str, int] = {
    "kernels": 30
}  # folders that still hold more files, as many as they hold


def report() -> None:
    print(f"{'room':14}{'lines':>8}{'budget':>8}{'files':>7}{'classes':>9}{'imports':>9}")
    total = [0, 0, 0, 0]
    for room in sorted(sources()):
        trees = [ast.parse(path.read_text(encoding="utf-8")) for path in sources()[room]
                 if path.suffix == ".py"]  # fmt: skip
        nodes = [node for tree in trees for node in ast.walk(tree)]
        row = [
            lines(room),
            len(sources()[room]),
            sum(isinstance(node, ast.ClassDef) for node in nodes),
            sum((node.end_lineno or 0) - node.lineno + 1 for node in nodes
                if isinstance(node, (ast.Import, ast.ImportFrom))),
        ]  # fmt: skip
        total = [old + new for old, new in zip(total, row, strict=True)]
        print(f"{room:14}{row[0]:8}{BUDGETS.get(room, 0):8}{row[1]:7}{row[2]:9}{row[3]:9}")
    print(f"{'all':14}{total[0]:8}{sum(BUDGETS.values()):8}{total[1]:7}{total[2]:9}{total[3]:9}")


if __name__ == "__main__":
    report()
