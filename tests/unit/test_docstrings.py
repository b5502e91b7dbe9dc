"""Docstrings of the names on the API pages; ruff sees that every public name has one.

What must be there:

- a function of several parameters, or of an array, has `Args` that name each of them. One of two
  parameters, or of a single statement, may name them in its summary, which then says what is
  returned; a function that a page lists by its own name may not;
- a function with `Args` that returns arrays or several things describes them under `Returns`, or in
  a summary that begins with the shape of the array;
- a shape is given where arrays are taken, returned or held by a class: `(N,)`, or in words;
- a `raise` of one of the package's errors is under `Raises`.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

import cldit

ROOT = Path(cldit.__file__).parent
DOCS = Path(__file__).resolve().parents[2] / "docs"
FILES = sorted(ROOT.rglob("*.py"))
ARRAY = re.compile(r"NDArray|ArrayLike|\b(Floats|Ints|Mask|Reals|Array)\b")
SEVERAL = re.compile(r"\b(tuple|list|dict|set|Mapping|Sequence|Iterator|Generator)\b")
SHAPE = re.compile(
    r"\((\.\.\.|[A-Z0-9hn]\w{0,2}|rows|cells|intervals)([ *+-]+\w+)*,[^()]*\)|\bshaped?\b"
)


@cache  # not when collected, which every worker does
def _errors() -> set[str]:
    """Names of `ClditError` and of what is derived from it, anywhere in the package."""
    bases: dict[str, set[str]] = {}
    for path in ROOT.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                bases[node.name] = {ast.unparse(base) for base in node.bases}
    found: set[str] = {"ClditError"}
    while more := {name for name, of in bases.items() if of & found} - found:
        found |= more
    return found


class Function(NamedTuple):
    name: str
    node: ast.FunctionDef | ast.AsyncFunctionDef
    parameters: list[str]


def _public(body: list[ast.stmt], prefix: str = "") -> Iterator[Function | ast.ClassDef]:
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield node
            yield from _public(node.body, f"{node.name}.")
        elif isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            marks = [ast.unparse(mark) for mark in node.decorator_list]
            if any(mark == "overload" or mark.endswith(".setter") for mark in marks):
                continue
            every = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
            every += [one for one in (node.args.vararg, node.args.kwarg) if one]
            names = [one.arg for one in every]
            bound = bool(prefix) and "staticmethod" not in marks
            yield Function(prefix + node.name, node, names[1:] if bound else names)


def _is_command(node: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    marks = [ast.unparse(mark) for mark in node.decorator_list]
    return any(re.search(r"\b(command|group|option|argument)\(", mark) for mark in marks)


def _raised(node: ast.AST) -> set[str]:
    names = set()
    for one in ast.walk(node):
        if isinstance(one, ast.Raise) and isinstance(one.exc, ast.Call):
            names.add(ast.unparse(one.exc.func).split(".")[-1])
    return names & _errors()


def faults_of(function: Function, *, listed: bool = False) -> list[str]:
    """Faults of a function; `listed` by its own name on a page."""
    name, node, parameters = function
    text = ast.get_docstring(node)
    if text is None or _is_command(node):
        return [] if text else [f"{name}: no docstring"]
    faults = []
    every = node.args.posonlyargs + node.args.args + node.args.kwonlyargs
    annotations = [ast.unparse(one.annotation) for one in every if one.annotation]
    takes_array = any(map(ARRAY.search, annotations))
    result = ast.unparse(node.returns) if node.returns else "None"
    result = result.replace("Iterator[None]", "None")  # of a context manager
    if len(parameters) > 1 or takes_array or listed:
        part = text.partition("Args:")[2]
        brief = len(parameters) <= 2 or len(node.body) == 2  # 2: with the docstring
        if not part and brief and not listed:
            part = text
        named = parameters if len(parameters) > 1 or part is not text else []
        missing = [one for one in named if not re.search(rf"\b{re.escape(one)}\b", part)]
        if missing:
            faults.append(f"{name}: Args lack {', '.join(missing)}")
        if listed:
            returned = result != "None" and bool(parameters)
            says = "Returns:" in text or "returns" in text.partition("\n")[0]
        else:
            returned = bool(ARRAY.search(result) or SEVERAL.search(result))
            says = "Returns" in text or bool(SHAPE.match(text)) or part is text
        if returned and not says:
            faults.append(f"{name}: Returns is missing for {result}")
        if (takes_array or ARRAY.search(result)) and not SHAPE.search(text):
            faults.append(f"{name}: no shape of an array")
    unsaid = [one for one in _raised(node) if one not in text.partition("Raises")[2]]
    if unsaid:
        faults.append(f"{name}: Raises lacks {', '.join(sorted(unsaid))}")
    return faults


def class_faults(node: ast.ClassDef) -> list[str]:
    text = ast.get_docstring(node)
    if text is None:
        return [f"class {node.name}: no docstring"]
    arrays = [
        one
        for one in node.body
        if isinstance(one, ast.AnnAssign)
        and not ast.unparse(one.target).startswith("_")
        and ARRAY.search(ast.unparse(one.annotation))
        and "Callable" not in ast.unparse(one.annotation)
    ]
    if arrays and not SHAPE.search(text):
        return [f"class {node.name}: no shape of {ast.unparse(arrays[0].target)}"]
    return []


def faults_in(source: str, module: str, shown: frozenset[str]) -> list[str]:
    """Faults of the names of a module that are `shown`, themselves, their class or their module."""
    faults = []
    for one in _public(ast.parse(source).body):
        name = f"{module}.{one.name}"
        if {module, name, f"{module}.{one.name.partition('.')[0]}"} & shown:
            if isinstance(one, Function):
                faults += faults_of(one, listed=name in shown)
            else:
                faults += class_faults(one)
    return faults


@cache
def api_names() -> frozenset[str]:
    """Names on the pages of docs/api, `cldit.scene.load.load_scene`."""
    pages = sorted((DOCS / "api").glob("*.md"))
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    return frozenset(re.findall(r"^::: ([\w.]+)$", text, re.MULTILINE))


def test_names_of_the_pages_are_documented() -> None:
    faults = []
    for path in FILES:
        parts = path.relative_to(ROOT).with_suffix("").parts
        module = ".".join(("cldit", *(part for part in parts if part != "__init__")))
        found = faults_in(path.read_text(encoding="utf-8"), module, api_names())
        faults += [f"{path.relative_to(ROOT)}: {fault}" for fault in found]
    assert not faults, "\n".join(faults)


def test_the_pages_name_what_is_there() -> None:
    for name in api_names():
        module, _, last = name.rpartition(".")
        assert importlib.util.find_spec(module) is not None, name
        assert hasattr(importlib.import_module(module), last) or importlib.util.find_spec(name)


@pytest.mark.parametrize(
    ("source", "fault"),
    [
        ("class A:\n    'An array.'\n    x: Floats", "class A: no shape of x"),
        ("class A:\n    'A class.'\n    def f(self): ...", "A.f: no docstring"),
        ("def f(a, b):\n    'Args: a'\n    return b", "f: Args lack b"),
        ("def f(a) -> int:\n    'Args: a'\n    return a", "f: Returns is missing for int"),
        ("def f():\n    'Fails.'\n    raise SceneError('no')", "f: Raises lacks SceneError"),
        ("def f(x: Floats) -> Floats:\n    'Any shape. Args: x Returns: y'", None),
    ],
)
def test_what_is_missing_is_noticed(source: str, fault: str | None) -> None:
    found = faults_in(source, "m", frozenset({"m.A", "m.f"}))
    assert found == ([] if fault is None else [fault])
