"""Kernel sources with their includes resolved, so that no path reaches the OpenCL compiler."""

import re
from importlib import resources

from cldit.errors import KernelError

_LINE = re.compile(r'#line (\d+) "([^"]+)"')
_COUNTED = re.compile(r"<kernel>:(\d+)")
_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$')


def read_source(name: str) -> str:
    """The text of `kernels/name`."""
    entry = resources.files("cldit.kernels").joinpath(name)
    if not entry.is_file():
        raise KernelError(f"kernels/{name}: no such file")
    return entry.read_text(encoding="utf-8")


def assemble(name: str, *, preamble: str = "") -> str:
    """The source of a kernel with every `#include "x.h"` replaced by the file, once each.

    preamble: text in front of it, which may include files too.

    `#line` directives make the compiler's messages name the right file and line; `with_files`
    corrects a line number that a compiler has counted itself.
    """
    included_files: set[str] = set()
    head = _expand(f"before {name}", preamble, included_files) if preamble else []
    return "\n".join(head + _expand(name, read_source(name), included_files)) + "\n"


def with_files(log: str, source: str) -> str:
    """Replaces `<kernel>:N`, NVIDIA's name of a source's line N, by the file and its line."""
    places, file, number = ["<kernel>:0"], "<kernel>", 0
    for line in source.splitlines():
        number += 1
        places.append(f"{file}:{number}")
        if named := _LINE.match(line):
            file, number = named.group(2), int(named.group(1)) - 1
    return _COUNTED.sub(
        lambda match: (
            places[int(match.group(1))] if int(match.group(1)) < len(places) else match.group()
        ),
        log,
    )


def _expand(name: str, source: str, included_files: set[str]) -> list[str]:
    included_files.add(name)
    out = [f'#line 1 "kernels/{name}"']
    for number, line in enumerate(source.splitlines(), start=1):
        match = _INCLUDE.match(line)
        if match is None:
            out.append(line)
            continue
        included = match.group(1)
        if included not in included_files:
            try:
                out += _expand(included, read_source(included), included_files)
            except KernelError as error:
                raise KernelError(f"kernels/{name}:{number}: {error}") from error
        out.append(f'#line {number + 1} "kernels/{name}"')
    return out
