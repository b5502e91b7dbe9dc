"""The path of CONTRIBUTING.md for a new reader: each function refers to the next one."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
MOST_FILES = 8
STEP = re.compile(r"^\d+\. `([\w./]+)`: ((?:`[\w.]+`(?:, )?)+)", re.MULTILINE)


class Function(NamedTuple):
    """Function of the path: file, name, and `Class.method` as one name."""

    file: str
    name: str


def section() -> str:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    return text.partition("## A new reader's path\n")[2].partition("\n## ")[0]


def path(text: str) -> list[Function]:
    return [
        Function(file, name)
        for file, names in STEP.findall(text)
        for name in re.findall(r"`([\w.]+)`", names)
    ]


def node_of(source: str, name: str) -> ast.FunctionDef:
    """Function or method of a module; KeyError if there is none."""
    body: list[ast.stmt] = ast.parse(source).body
    *classes, last = name.split(".")
    for one in classes:
        (owner,) = (n for n in body if isinstance(n, ast.ClassDef) and n.name == one)
        body = owner.body
    for node in body:
        if isinstance(node, ast.FunctionDef) and node.name == last:
            return node
    raise KeyError(name)


def names_in(node: ast.AST) -> set[str]:
    """Names and attributes that the statements of a function contain."""
    inner = list(ast.walk(node))
    return {n.id for n in inner if isinstance(n, ast.Name)} | {
        n.attr for n in inner if isinstance(n, ast.Attribute)
    }


def texts_in(node: ast.AST) -> set[str]:
    constants = (n.value for n in ast.walk(node) if isinstance(n, ast.Constant))
    return {value for value in constants if isinstance(value, str)}


def body_of(source: str, name: str) -> str:
    """Body of a function of OpenCL C; KeyError if there is none."""
    found = re.search(rf"^(?:INLINE|__kernel) [^;{{]*\b{name}\([^;{{]*\)\s*\{{", source, re.M)
    if found is None:
        raise KeyError(name)
    return source[found.end() :].partition("\n}")[0]


def broken_links(steps: list[Function], read: Callable[[str], str]) -> list[str]:
    """Pairs of functions of which the first does not refer to the second."""
    broken = []
    for one, other in pairwise(steps):
        called = other.name.split(".")[-1]
        if one.file.endswith(".cl"):
            linked = re.search(rf"\b{called}\(", body_of(read(one.file), one.name)) is not None
        elif other.file.endswith(".cl"):  # a launch: by the name of the kernel and of its file
            before = [step for step in steps[: steps.index(other)] if step.file.endswith(".py")]
            linked = any(
                called in texts_in(node_of(read(step.file), step.name))
                and Path(other.file).name in texts_in(ast.parse(read(step.file)))
                for step in before
            )
        else:
            linked = called in names_in(node_of(read(one.file), one.name))
        if not linked:
            broken.append(f"{one.file}: {one.name} does not refer to {other.name}")
    return broken


def read(file: str) -> str:
    return (ROOT / file).read_text(encoding="utf-8")


def test_path_is_short_and_complete() -> None:
    steps = path(section())
    files = list(dict.fromkeys(step.file for step in steps))
    assert len(files) <= MOST_FILES
    assert len(files) == len(re.findall(r"^\d+\. ", section(), re.MULTILINE))
    assert files[0] == "cldit/api/experiment.py"
    assert "cldit/gpu/program.py" in files
    assert files[-1] == "kernels/image.cl"
    assert [file for file in files if not (ROOT / file).is_file()] == []


def test_each_function_refers_to_the_next() -> None:
    steps = path(section())
    for step in steps:
        (body_of if step.file.endswith(".cl") else node_of)(read(step.file), step.name)
    assert broken_links(steps, read) == []


def test_path_goes_from_the_command_to_the_line() -> None:
    first, *_, last = path(section())
    assert first.name in names_in(node_of(read("cldit/cli/run.py"), "run"))
    line = re.findall(r"`([^`]+)`\.", section())[-1]
    assert "source" in line and line in body_of(read(last.file), last.name)
