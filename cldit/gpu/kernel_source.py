"""Kernel sources: includes resolved in Python, so that no path ever reaches the OpenCL compiler."""

from __future__ import annotations

import re
from importlib import resources

from cldit.errors import KernelError

_INCLUDE = re.compile(r'^\s*#include\s+"([^"]+)"\s*$')


def read_source(name: str) -> str:
    """The text of `kernels/name`.

    Raises:
        KernelError: there is no such file.
    """
    entry = resources.files("cldit.kernels").joinpath(name)
    if not entry.is_file():
        raise KernelError(f"kernels/{name}: no such file")
    return entry.read_text(encoding="utf-8")


def assemble(name: str) -> str:
    """The source of a kernel with every `#include "x.h"` put in place, each file once.

    `#line` directives let the compiler's messages name the right file and line.

    Raises:
        KernelError: an included file does not exist.
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
