"""Entries at the top level of a field's file, by OpenFOAM's grammar: dimensions, macros, includes.

After the OpenFOAM user guide ("Basic input/output file format"). foamlib 1.7 reads these entries,
too, but expands neither macros nor `#include`. Other directives (#calc, #eval) are refused:
OpenFOAM writes results without any.
"""

import re
from pathlib import Path

from cldit.cfd.inputs import content
from cldit.cfd.mapping.file import SI_UNITS
from cldit.cfd.openfoam.collated import GAP
from cldit.cfd.openfoam.file import FoamFile, find_foam, open_foam, without_comments

_KEY = re.compile(GAP + rb'("[^"\n]*"|[^\s"{}();]++)', re.DOTALL)
_PART = re.compile(rb'"[^"]*"|//[^\n]*|/\*.*?\*/|[{}();]|List<(\w+)>\s*(\d{1,15})\s*\(', re.DOTALL)
_NUMBERS = {b"scalar": 1, b"vector": 3, b"symmTensor": 6, b"tensor": 9}
_MACRO = re.compile(rb"\$\{?[:.]*(\w+)\}?")


def top_level(
    file: FoamFile, at: int, entries: dict[bytes, bytes], within: tuple[Path, ...] = ()
) -> int:
    """Adds the entries from `at` on to `entries`, up to internalField, and those of included files.

    within: files that include this one. Returns the place of the value of internalField; -1 without
    it.
    """
    while (key := _KEY.match(file.body, at)) is not None:
        name, at = key.group(1), key.end()
        if name.startswith(b"#"):
            line = file.body.find(b"\n", at)
            line = len(file.body) if line < 0 else line
            if name in (b"#include", b"#sinclude", b"#includeIfPresent"):
                _include(file, file.body[at:line], entries, within)
            at = line
            continue
        end = entry_end(file, at)
        entries[name] = file.body[at : min(end, at + 1000)].strip()
        if name == b"internalField":
            return at
        at = end + 1
    return -1


def entry_end(file: FoamFile, at: int) -> int:
    """Place of the semicolon or brace that ends an entry; skips the content of binary lists."""
    depth = 0
    while (part := _PART.search(file.body, at)) is not None:
        mark, at = part.group(), part.end()
        if mark.endswith(b"(") and part.group(1) and file.binary:
            at += int(part.group(2)) * _NUMBERS.get(part.group(1), 1) * file.scalar_sizes[0]
        elif mark.endswith((b"(", b"{")):
            depth += 1
        elif mark in (b")", b"}"):
            depth -= 1
        if (mark == b";" or mark == b"}") and depth <= 0:
            return part.start()
    return len(file.body)


def _include(
    file: FoamFile, line: bytes, entries: dict[bytes, bytes], within: tuple[Path, ...]
) -> None:
    """Adds the entries of an included file; a missing one is named once a macro is not found."""
    name = line.strip().strip(b'"')
    path = find_foam(file.path.parent / name.decode("latin-1"))
    if path is None or path in within:
        entries[b"#include"] = name
        return
    with open_foam(path) as stream:
        body = without_comments(content(stream, path))
    included = FoamFile(path, False, file.order, file.label_sizes, file.scalar_sizes, body)
    top_level(included, 0, entries, (*within, path))


def expanded(
    file: FoamFile, code: bytes, entries: dict[bytes, bytes], within: tuple[bytes, ...] = ()
) -> bytes:
    """Replaces macros such as `$T0` by the entries that they name; `within`: macros around it."""
    code = code.partition(b";")[0]
    while (macro := _MACRO.search(code)) is not None:
        name = macro.group().decode("latin-1")
        if macro.group(1) in within:
            raise file.fail(f"the macro {name} names itself")
        if macro.group(1) not in entries:
            lost = entries.get(b"#include", b"").decode("latin-1")
            where = f'; "{lost}", which it includes, is missing beside it' if lost else ""
            raise file.fail(f"the macro {name} has no entry above it or in its includes{where}")
        value = expanded(file, entries[macro.group(1)], entries, (*within, macro.group(1)))
        code = code[: macro.start()] + value + code[macro.end() :]
    return code


def unit_of(file: FoamFile, entries: dict[bytes, bytes]) -> str | None:
    """Unit by the `dimensions`, as mapping files spell it, or these themselves; None without."""
    inside = re.search(rb"\[([^\]]*)\]", expanded(file, entries.get(b"dimensions", b""), entries))
    if inside is None:
        return None
    dimensions = inside.group(1).decode("latin-1").strip()
    try:
        powers = [float(word) for word in dimensions.split()]
    except ValueError:  # symbols, such as [kg m^-3]
        return dimensions
    return SI_UNITS.get(tuple(powers[:5]) if not any(powers[5:]) else (), f"[{dimensions}]")
