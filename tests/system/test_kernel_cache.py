"""PoCL's folder of compiled kernels: full, or shared by processes that all find it empty."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cldit.gpu.device import open_device

BUILD = """
from cldit.gpu.device import open_device
from cldit.gpu.program import build
device = open_device()
def built(name, defines): return build(device, name, defines)
"""
COPY = """
__kernel void copy(__global float *out, __global const float *in)
{
    out[get_global_id(0)] = NUMBER * in[get_global_id(0)];
}
"""
FULL = f"""
import numpy as np, sys
from cldit.gpu import program as module
from cldit.gpu.buffers import upload, zeros
from tests.full_disk import full_disk
module.assemble = lambda name, **_: {COPY!r}
program = built("copy", {{"NUMBER": 1}})
data = upload(device, "in", np.ones(64, np.float32))
what = {{
    "build": lambda: built("copy", {{"NUMBER": 8}}),
    "launch": lambda: program.launch(
        "copy", (64,), (16,), {{"in": data, "out": zeros(device, "out", 64, np.float32)}}
    ),
}}[sys.argv[1]]
with full_disk(most_bytes=1_000):
    what()
"""


def process(code: str, cache: Path, *arguments: str) -> subprocess.Popen[str]:
    environment = {k: v for k, v in os.environ.items() if k != "POCL_CACHE_DIR"}
    environment["XDG_CACHE_HOME"] = str(cache)
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        cwd=Path(__file__).resolve().parents[2],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.parametrize("what", ["build", "launch"])
def test_a_full_cache_is_an_error_that_names_it(what: str, tmp_path: Path) -> None:
    """PoCL's compiler itself would abort the process, where it compiles and where it first runs."""
    platform = open_device().info.platform
    if platform != "Portable Computing Language":
        pytest.skip(f"{platform} is used, not PoCL")
    child = process(BUILD + FULL, tmp_path, what)
    _, said = child.communicate()
    assert child.returncode == 1, said
    assert "LLVM" not in said
    assert f"DiskFull: {tmp_path / 'pocl'}: the disk is full" in said


@pytest.mark.parametrize("count", [3, pytest.param(10, marks=pytest.mark.slow)])
def test_processes_on_an_empty_cache_all_build(count: int, tmp_path: Path) -> None:
    """Every one of them, the same programs at the same time."""
    several = "\n".join(
        f"built('boundary_shares.cl', {{'N_PATCHES': {number}}})"
        for number in range(3 if count < 10 else 12)
    )
    children = [process(BUILD + several, tmp_path) for _ in range(count)]
    said = [child.communicate()[1] for child in children]
    assert [child.returncode for child in children] == [0] * count, "\n".join(said)
