"""Assembly and building: includes, `#error`s, and messages that name the right file and line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock, Timeout

from cldit.errors import KernelError
from cldit.gpu import compilation, kernel_source
from cldit.gpu.device import Device
from cldit.gpu.kernel_source import assemble, with_files
from cldit.gpu.program import build


def test_includes_are_put_in_place_once() -> None:
    text = assemble("sweep.cl")
    assert "#include" not in text
    assert text.count("#ifndef REAL_H") == 1
    assert '#line 1 "kernels/boundary.h"' in text


def test_unknown_include_names_file_and_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def fake(name: str) -> str:
        if name == "a.cl":
            return '\n#include "missing.h"\n'
        raise KernelError(f"kernels/{name}: no such file")

    monkeypatch.setattr(kernel_source, "read_source", fake)
    with pytest.raises(KernelError, match=r"kernels/a\.cl:2: kernels/missing\.h: no such file"):
        assemble("a.cl")


@pytest.mark.parametrize(
    ("name", "defines", "missing"),
    [
        ("image.cl", {}, "IMAGES"),
        ("branching.cl", {"HAS_SCATTERING": 1}, "HIGHEST_ORDER"),
        ("sweep.cl", {"SIMD_WIDTH": 1}, "HAS_SCATTERING"),
        ("sweep.cl", {"HAS_SCATTERING": 1, "SIMD_WIDTH": 3}, "SIMD_WIDTH"),
    ],
)
def test_missing_define_is_named(
    device: Device, name: str, defines: dict[str, int | float], missing: str
) -> None:
    with pytest.raises(KernelError, match=missing):
        build(device, name, defines)


def test_compiler_errors_name_the_kernel_file(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    good = kernel_source.read_source

    def broken(name: str) -> str:
        return "\n\nthis is no C;\n" if name == "real.h" else good(name)

    monkeypatch.setattr(kernel_source, "read_source", broken)
    with pytest.raises(KernelError, match=r"kernels/real\.h:3"):
        build(device, "boundary_shares.cl", {})


def test_lines_that_a_compiler_counts_itself_are_named_by_file() -> None:
    """NVIDIA's ignores `#line`: line 47 of the whole text was line 3 of real.h."""
    source = assemble("boundary_shares.cl")
    line = source.splitlines().index('#line 1 "kernels/real.h"') + 4
    log = f"<kernel>:{line}:1: error: unknown type\n<kernel>:99999:1: error"
    assert (
        with_files(log, source)
        == "kernels/real.h:3:1: error: unknown type\n<kernel>:99999:1: error"
    )


def test_what_was_built_is_built_once_a_device(device: Device) -> None:
    defines = {"N_PATCHES": 1}
    first, again = (
        build(device, "boundary_shares.cl", defines),
        build(device, "boundary_shares.cl", defines),
    )
    other = build(device, "boundary_shares.cl", {"N_PATCHES": 2})
    made = [program.built.program for program in (first, again, other)]
    assert made[0] is made[1] is not made[2]
    assert again.defines == defines
    more = build(device, "boundary_shares.cl", {**defines, "ELSEWHERE": 1})
    assert more.built.program is made[0] and more.defines == defines


def test_a_program_is_compiled_under_a_lock(
    device: Device, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """One file for the programs of equal first letter; no other process takes it meanwhile."""
    good = compilation._from_source

    def watched(*arguments: Any) -> compilation.Compiled:
        [lock] = tmp_path.rglob("*.lock")
        with pytest.raises(Timeout), FileLock(lock, timeout=0):
            pass
        return good(*arguments)

    monkeypatch.setattr(compilation, "_from_source", watched)
    monkeypatch.setattr(compilation, "default_cache", lambda: tmp_path)
    build(device, "boundary_shares.cl", {}, preamble="#define LOCKED 1")
    [lock] = tmp_path.rglob("*.lock")
    with FileLock(lock, timeout=0):
        pass
