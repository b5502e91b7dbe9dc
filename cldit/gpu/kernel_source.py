"""Kernel sources with their includes resolved, so that no path reaches the OpenCL compiler."""

from __future__ import annotations

import re
from importlib import resources

from cldit.errors import KernelError

_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$')


def read_source(name: str) -> str:
    """The text of `kernels/name`."""
    entry = resources.files("cldit.kernels").joinpath(name)
    if not entry.is_file():
        raise KernelError(f"kernels/{name}: no such file")
    return entry.read_text(encoding="utf-8")


def assemble(name: str) -> str:
    """The source of a kernel with every `#include "x.h"` replaced by the file, once each.

    `#line` directives make the compiler's messages name the right file and line.
    """
    return "\n".join(_expand(name, read_source(name), set())) + "\n"


def _expand(name: str, text: str, seen: set[str]) -> list[str]:
    seen.add(name)
    out = [f'#line 1 "kernels/{name}"']
    for number, line in enumerate(text.splitlines(), start=1):
        match = _INCLUDE.match(line)
        if match is None:
            out.append(line)
            continue
        included = match.group(1)
        if included not in seen:
            try:
                out += _expand(included, read_source(included), seen)
            except KernelError as error:
                raise KernelError(f"kernels/{name}:{number}: {error}") from error
        out.append(f'#line {number + 1} "kernels/{name}"')
    return out
