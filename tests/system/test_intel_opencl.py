"""Another OpenCL beside PoCL: Intel's runtime for CPUs, which pip installs (extra `dev`).

Drivers differ in what they keep between runs, so scenes run on an empty cache and on a full one.
"""

from __future__ import annotations

import os
import shutil
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cldit.gpu.device import Device
from tests.small_scenes import agree, weights
from tests.system.test_kernel_cache import COPY
from tests.system.test_portability import run


@pytest.fixture(scope="module")
def intel(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Environment of a process that sees Intel's runtime and has caches of its own."""
    try:
        files = distribution("intel-opencl-rt").files or []
    except PackageNotFoundError:
        pytest.skip("intel-opencl-rt is not installed; pip has it for Linux on x86-64")
    [library] = [Path(str(each.locate())).resolve() for each in files
                 if each.name == "libintelocl.so"]  # fmt: skip
    if " " in str(library):  # of which Intel's runtime makes DEVICE_NOT_AVAILABLE
        place = tmp_path_factory.mktemp("intel")
        for each in library.parent.iterdir():
            if each.is_file():
                shutil.copy2(each, place)
        library = place / library.name
    drivers = tmp_path_factory.mktemp("drivers")
    (drivers / "intel.icd").write_text(f"{library}\n")
    found = os.pathsep.join([str(library.parent), os.environ.get("LD_LIBRARY_PATH", "")])
    return {
        **os.environ,
        "OCL_ICD_VENDORS": str(drivers),
        "LD_LIBRARY_PATH": found.rstrip(os.pathsep),
        "XDG_CACHE_HOME": str(tmp_path_factory.mktemp("cache")),
        "CLDIT_TEST_DEVICE": "Intel(R) OpenCL",
    }


def traced(environment: dict[str, str], out: Path) -> dict[str, NDArray[Any]]:
    run(environment, "-m", "tests.small_scenes", str(out))
    with np.load(out) as stored:
        found = dict(stored)
    assert found.pop("platform") == "Intel(R) OpenCL"
    return found


@pytest.mark.long
def test_scenes_agree_with_pocl_on_a_cold_and_a_warm_cache(
    intel: dict[str, str], device: Device, tmp_path: Path
) -> None:
    """The second run loads binaries, and gives the same bits."""
    cold = traced(intel, tmp_path / "cold.npz")
    programs = Path(intel["XDG_CACHE_HOME"]) / "cldit" / "programs"
    kept = {path: path.stat().st_mtime_ns for path in programs.glob("*.program")}
    assert len(kept) > 3
    warm = traced(intel, tmp_path / "warm.npz")
    assert {path: path.stat().st_mtime_ns for path in programs.glob("*.program")} == kept
    for method, expected in weights(device).items():
        np.testing.assert_array_equal(warm[method], cold[method])
        agree(cold[method], expected, method)


@pytest.mark.slow
def test_kernels_pass(intel: dict[str, str]) -> None:
    quiet = ("-q", "-x", "-p", "no:xdist", "-p", "no:cacheprovider")
    run(intel, "-m", "pytest", *quiet, "tests/kernels")


def test_a_damaged_binary_is_compiled_again(intel: dict[str, str], tmp_path: Path) -> None:
    """A program's file that is cut, as by a power failure, costs time only."""
    code = (
        "from cldit.gpu import program as module; "
        "from cldit.gpu.device import open_device; from cldit.gpu.program import build; "
        f"module.assemble = lambda name, **_: {COPY!r}; "
        "program = build(open_device('Intel(R) OpenCL'), 'copy', {'NUMBER': 1}); "
        "assert [name for name, _ in program.built.arguments['copy']] == ['out', 'in']"
    )
    environment = intel | {"XDG_CACHE_HOME": str(tmp_path)}
    run(environment, "-c", code)
    [path] = (tmp_path / "cldit" / "programs").glob("*.program")
    whole = path.read_bytes()
    for damaged in (whole[:-1], b"00000000" + whole[8:]):
        path.write_bytes(damaged)
        run(environment, "-c", code)
        assert len(path.read_bytes()) == len(whole)
        assert path.read_bytes()[:8] != b"00000000"
