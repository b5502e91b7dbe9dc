"""Docstrings: one of every public name, and a full one of every name on the API pages.

What must be there:

- every public class and function has a docstring;
- on the pages of docs/api, a function of several parameters, or of an array, has `Args` that name
  each of them. One of two parameters, or of a single statement, may name them in its summary, which
  then says what is returned; a single parameter needs no name there;
- there, a function with `Args` that returns arrays or several things describes them under
  `Returns`, or in a summary that begins with the shape of the array;
- there, a shape is given where arrays are taken, returned or held by a class: `(N,)`, or in words;
- there, a `raise` of one of the package's errors is under `Raises`;
- a function that such a page lists by its own name has `Args` for each parameter, and `Returns`
  unless its summary says what it returns.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import inspect
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

import cldit

ROOT = Path(cldit.__file__).parent
DOCS = Path(__file__).resolve().parents[2] / "docs"
FILES = [
    path
    for path in sorted(ROOT.rglob("*.py"))
    if path.name == "__init__.py" or not path.name.startswith("_")
]
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


def faults_of(function: Function) -> list[str]:
    name, node, parameters = function
    text = ast.get_docstring(node)
    if text is None:
        return [f"{name}: no docstring"]
    faults = []
    takes_array = any(
        ARRAY.search(ast.unparse(one.annotation))
        for one in node.args.posonlyargs + node.args.args + node.args.kwonlyargs
        if one.annotation
    )
    if _is_command(node):
        return []
    if len(parameters) > 1 or takes_array:
        part = text.partition("Args:")[2]
        if not part and (len(parameters) <= 2 or len(node.body) == 2):  # 2: with the docstring
            part = text
        named = parameters if len(parameters) > 1 or part is not text else []
        missing = [one for one in named if not re.search(rf"\b{re.escape(one)}\b", part)]
        if missing:
            faults.append(f"{name}: Args lack {', '.join(missing)}")
        result = ast.unparse(node.returns) if node.returns else "None"
        result = result.replace("Iterator[None]", "None")  # of a context manager
        says = "Returns" in text or SHAPE.match(text) or part is text
        if (ARRAY.search(result) or SEVERAL.search(result)) and not says:
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


def faults_in(source: str, shown: Callable[[str], bool] = lambda name: True) -> list[str]:
    """Faults of a module; names that no API page shows need a docstring only."""
    faults = []
    for one in _public(ast.parse(source).body):
        node = one.node if isinstance(one, Function) else one
        if shown(one.name):
            faults += faults_of(one) if isinstance(one, Function) else class_faults(one)
        elif ast.get_docstring(node) is None:
            faults.append(f"{one.name}: no docstring")
    return faults


@cache
def api_names() -> frozenset[str]:
    """Names on the pages of docs/api, `cldit.scene.load.load_scene`."""
    pages = sorted((DOCS / "api").glob("*.md"))
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    return frozenset(re.findall(r"^::: ([\w.]+)$", text, re.MULTILINE))


def test_public_names_are_documented() -> None:
    faults = []
    for path in FILES:
        parts = path.relative_to(ROOT).with_suffix("").parts
        module = ".".join(("cldit", *(part for part in parts if part != "__init__")))

        def shown(name: str, module: str = module) -> bool:
            names = {module, f"{module}.{name}", f"{module}.{name.partition('.')[0]}"}
            return bool(names & api_names())

        found = faults_in(path.read_text(encoding="utf-8"), shown)
        faults += [f"{path.relative_to(ROOT)}: {fault}" for fault in found]
    assert not faults, "\n".join(faults)


def listed_faults(name: str, function: Callable[..., object]) -> list[str]:
    """Sections that a function of an API page lacks."""
    text, signature = inspect.getdoc(function) or "", inspect.signature(function)
    given = text.partition("Args:")[2]
    missing = [one for one in signature.parameters if not re.search(rf"\b{one}\b", given)]
    faults = [f"{name}: Args lack {', '.join(missing)}"] if missing else []
    returns = signature.return_annotation not in (None, "None") and signature.parameters
    if returns and "Returns:" not in text and "returns" not in text.partition("\n")[0]:
        faults.append(f"{name}: no Returns")
    return faults


def test_functions_of_the_pages_have_all_sections() -> None:
    faults = []
    for name in sorted(api_names()):
        module, _, last = name.rpartition(".")
        one = getattr(importlib.import_module(module), last, None)
        faults += listed_faults(name, one) if inspect.isfunction(one) else []
    assert not faults, "\n".join(faults)


def test_a_missing_section_is_noticed() -> None:
    def half(scene: str, pixels: int) -> int:
        """Traces.

        Args:
            scene: a name.
        """
        return pixels

    assert listed_faults("half", half) == ["half: Args lack pixels", "half: no Returns"]


def test_the_pages_name_what_is_there() -> None:
    for name in api_names():
        module, _, last = name.rpartition(".")
        assert importlib.util.find_spec(module) is not None, name
        assert hasattr(importlib.import_module(module), last) or importlib.util.find_spec(name)


@pytest.mark.parametrize(
    ("source", "fault"),
    [
        ("def f(x: int) -> int: ...", "f: no docstring"),
        ("class A:\n    x: int", "class A: no docstring"),
        ("class A:\n    'An array.'\n    x: Floats", "class A: no shape of x"),
        ("def f(x: Floats) -> None:\n    'Takes x.'", "f: no shape of an array"),
        ("def f(a, b, c):\n    'Takes a.'\n    print(a)\n    print(b)", "f: Args lack a, b, c"),
        (
            "def f(a, b, c) -> list[int]:\n    'Args: a, b, c'\n    print(a)\n    return b",
            "f: Returns is missing for list[int]",
        ),
        ("def f():\n    'Fails.'\n    raise SceneError('no')", "f: Raises lacks SceneError"),
        ("class A:\n    'A class.'\n    def f(self): ...", "A.f: no docstring"),
        ("def f(x: Floats) -> Floats:\n    'Any shape.'", None),
        ("def _f(a, b, c): ...", None),
    ],
)
def test_what_is_missing_is_noticed(source: str, fault: str | None) -> None:
    assert faults_in(source) == ([] if fault is None else [fault])
