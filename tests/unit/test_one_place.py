"""Files are written, YAML is loaded, caches are found, text is printed and constants of nature and
units are written in one place each."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import cldit
from cldit import constants

ROOT = Path(cldit.__file__).parent
FILES = sorted([*ROOT.rglob("*.py"), *(ROOT / "drivers").resolve().rglob("*.py")])

CONSTANTS = {value for value in vars(constants).values() if isinstance(value, float)}

# What may be done where; all else is forbidden everywhere.
PLACES: dict[str, set[str]] = {
    "yaml": {"plain_data.py"},
    "platformdirs": {"caches.py"},
    "print": set(),
    "stdout": {"terminal.py", "program.py"},
    # made to be read by its own program only, or plain data that never was a file
    "json": {"plain_data.py", "tables.py", "images.py", "spray_file.py", "preflight.py"}
    | {"compilation.py"},
    "write": {"files.py"},
    # the journal's own appends, syncs, and a measurement of syncs
    # and members of an archive that files.py writes
    "open to write": {"files.py", "disk.py", "spray_file.py"},
    "os.open": {"files.py", "journal.py", "terminal.py", "pocl.py", "locks.py"},
    "imwrite": {"images.py"},
    "savefig": {"style.py"},  # into memory
    # resources of the package, pages that the same command wrote, /proc
    "read_text": {"program.py", "kernel_source.py", "shipped.py", "load.py"} | {"free_memory.py"},
    "constant": {"constants.py"},
}


def _name(node: ast.expr) -> str:
    """`a.b` as written, where it is names only."""
    if isinstance(node, ast.Attribute):
        return f"{_name(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def _writes(call: ast.Call) -> bool:
    given = [*call.args, *(key.value for key in call.keywords if key.arg == "mode")]
    modes = [each.value for each in given if isinstance(each, ast.Constant)]
    return any(isinstance(mode, str) and set(mode) & set("wax+") and len(mode) < 4
               for mode in modes)  # fmt: skip


def found(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """What a module does of all this, and in which line."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            of = getattr(node, "module", None)
            for name in [of] if of else [each.name for each in node.names]:
                if name.partition(".")[0] in ("yaml", "platformdirs"):
                    yield name.partition(".")[0], node.lineno
        if isinstance(node, ast.Attribute) and _name(node) in ("sys.stdout", "sys.stderr"):
            yield "stdout", node.lineno
        if isinstance(node, ast.Constant) and node.value in CONSTANTS:
            yield "constant", node.lineno
        if not isinstance(node, ast.Call):
            continue
        name = _name(node.func)
        last = node.func.attr if isinstance(node.func, ast.Attribute) else name
        if name in ("print", "click.echo"):
            yield "print", node.lineno
        elif name in ("json.load", "json.loads"):
            yield "json", node.lineno
        elif isinstance(node.func, ast.Attribute) and last in ("write_text", "write_bytes"):
            yield "write", node.lineno
        elif isinstance(node.func, ast.Attribute) and last == "read_text":
            yield "read_text", node.lineno
        elif name == "os.open":
            yield "os.open", node.lineno
        elif last == "open" and _writes(node):
            yield "open to write", node.lineno
        elif last in ("imwrite", "savefig"):
            yield last, node.lineno


def test_nothing_goes_past_the_one_place() -> None:
    wrong = [
        f"{path}:{line}: {what}"
        for path in FILES
        for what, line in found(ast.parse(path.read_text(encoding="utf-8")))
        if path.name not in PLACES[what]
    ]
    assert len(FILES) > 300 and not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("from yaml import safe_load", "yaml"),
        ("sys.stdout.write('x')", "stdout"),
        ("(folder / 'a').write_bytes(data)", "write"),
        ("path.open(mode='ab')", "open to write"),
        ("{'atm': 101325}", "constant"),
    ],
)
def test_the_walk_sees_it(text: str, what: str) -> None:
    assert [each for each, _ in found(ast.parse(text))] == [what]


def test_the_gas_constant_is_the_product() -> None:
    """Its literal is rounded from the exact product, whose float is within two roundings."""
    product = constants.AVOGADRO_PER_MOL * constants.BOLTZMANN_J_K
    assert constants.GAS_CONSTANT_J_mol_K == pytest.approx(product, rel=2.0**-52, abs=0.0)
