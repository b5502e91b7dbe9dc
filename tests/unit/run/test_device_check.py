"""Check of devices: it passes here, names the kernel that is wrong, and decides the choice."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import cldit
from cldit.errors import ClditError, DeviceError
from cldit.gpu import checks, compilation, kernel_source
from cldit.gpu.checks import Check, failed_devices, store_check, stored_check
from cldit.gpu.device import Device, list_devices
from cldit.prepare.spray_factory import make_spray
from cldit.run import device_check
from cldit.run.device_check import check_device
from cldit.study.sweep import _gpus
from tests.command_line import command
from tests.small_scenes import SCENE, TRANSPORT

KERNELS = Path(cldit.__file__).parents[1] / "kernels"
_KERNEL = r"(?:__kernel[^{;]*?\bvoid|SLICED)\s+(\w+)\("
LLVMPIPE = 65_535  # rounds, after which it ends loops
THROUGH = "source, order 2"  # without thick cells: the fewest kernels


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tables: Path) -> None:
    """Results of checks are not those of other tests; fluids' tables are."""
    monkeypatch.setattr(checks, "default_cache", lambda: tmp_path)
    monkeypatch.setattr(device_check, "default_cache", lambda: tables)


def _launched() -> set[str]:
    """All kernels."""
    return {
        f"{path.relative_to(KERNELS).as_posix()} {name}"
        for path in KERNELS.rglob("*.cl")
        for name in re.findall(_KERNEL, path.read_text(encoding="utf-8"))
    }


def test_every_kernel_has_a_reference() -> None:
    """On devices with and without double precision; the gas is single on both."""
    for precision in ("float32", "float64"):
        known = {
            key.rsplit(" ", 2)[0]
            for name, sums in device_check._reference().items()
            for key in sums
            if name.startswith((precision, "float32 spray"))
        }
        assert known - {"image of all"} == _launched()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["cpu", "gpu"])
def test_this_device_passes_the_whole_check(device: Device, kind: str) -> None:
    """By the code for either kind of device."""
    found = check_device(replace(device, info=replace(device.info, kind=kind)))
    assert found.faults == ()
    assert found.kernels == len(_launched())


@dataclass(frozen=True)
class Fault:
    """Fault of a device: it takes `old` for `new` in the sources.

    problem, names: that show it, and how the first kernel with a wrong result is reported.
    """

    problem: str
    old: str
    new: str
    names: str


FAULTS = {
    "emission in images is 5 % high": Fault(
        f"float32 {THROUGH}",
        "+= taken * source[c];",
        "+= taken * source[c] * (FIRST_SOURCE + c >= BOUNDARIES ? R(1.05) : R(1));",
        "image.cl image: planes is off by",
    ),
    "random words repeat": Fault(
        "float32 path, isotropic", "(uint4)(x, y, z, w)", "(uint4)(x, x, x, x)", "path.cl scatter"
    ),
    "exp is 0.1 % low": Fault(
        f"float32 {THROUGH}", "return two + two * rest;", "return R(0.999) * (two + two * rest);",
        "sweep.cl sweep",
    ),
    "a list's sources are 3 % low": Fault(
        f"float32 {THROUGH}", "? SUM_OF(box[first_plane",
        "? R(0.97) * SUM_OF(box[first_plane", "source_update.cl collect_i_minus_s: out",
    ),
    "sums lose one addition in 16": Fault(
        "float64 deposit", "const real share = row->share * (upto - before);",
        "const real share = x % 16 ? row->share * (upto - before) : R(0);", "deposit.cl deposit",
    ),
    "a brick is not marked": Fault(
        "float64 deposit", "line[x] = 1;", "line[x] = x > 0;", "deposit.cl mark_bricks"
    ),
    "droplets evaporate 1 % too fast": Fault(
        "float64 droplets, spalding", "sherwood * log1p_of(", "R(1.01) * sherwood * log1p_of(",
        "droplets.cl",
    ),
    "voxels have 1 % too little vapour": Fault(
        "float32 spray", "*voxel = (real2)(mass", "*voxel = (real2)(R(0.99) * mass",
        "vapour_lattice.cl vapour_lattice: voxels",
    ),
}  # fmt: skip


def faulty(monkeypatch: pytest.MonkeyPatch, change: Callable[[str], str]) -> None:
    """Compiles other sources from here on."""
    monkeypatch.setattr(
        "cldit.gpu.program.assemble",
        lambda name, preamble="": change(kernel_source.assemble(name, preamble=preamble)),
    )


# One of each kind of problem; the table of the check's references holds for all of them.
FIRST = (
    "emission in images is 5 % high",
    "exp is 0.1 % low",
    "a brick is not marked",
    "droplets evaporate 1 % too fast",
    "voxels have 1 % too little vapour",
)


@pytest.mark.parametrize(
    "name",
    [name if name in FIRST else pytest.param(name, marks=pytest.mark.slow) for name in FAULTS],
)
def test_a_fault_is_named(name: str, device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    fault, hits = FAULTS[name], []

    def change(source: str) -> str:
        hits.append(source.count(fault.old))
        return source.replace(fault.old, fault.new)

    faulty(monkeypatch, change)
    found = check_device(device, only=[fault.problem])
    assert sum(hits)
    assert re.match(f"{fault.problem}: .*{fault.names}", "\n".join(found.faults))


@pytest.mark.slow
def test_inexact_mathematics_are_named(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parallel rays divide by zero."""
    options = (*compilation.OPTIONS, "-cl-fast-relaxed-math")
    monkeypatch.setattr(compilation, "OPTIONS", options)
    monkeypatch.setattr(device.opened, "programs", {})
    [fault] = check_device(device, only=["float32 source, parallel rays"]).faults
    assert re.search(r"source_update\.cl \w+: \w+ is off by [\d.e+-]+; allowed", fault)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_a_rounding_in_each_cell_is_no_fault(kind: type[np.floating]) -> None:
    """Radiances less 1 may be rounding errors alone, which differ between processors."""
    rounding = np.finfo(kind).eps
    known = {"source_update.cl cavity_defect out 1": [(0.0, 9 * float(rounding))]}
    for size, names in ((0.5, False), (2.0, True)):
        launches = device_check.Launches(5e-6, known)
        with pytest.raises(Exception, match="is off by") if names else nullcontext():
            launches.add(
                "source_update.cl cavity_defect", "out", np.full((1, 9), size * rounding, kind)
            )


def cut(source: str, rounds: int) -> str:
    """The source with loops that end after so many rounds."""
    source = re.sub(
        r"for \((u?int) (\w+ = [^;]*); ([^;]+);", rf"for (\1 \2, n_ = 0; n_++ < {rounds} && (\3);",
        source,
    )  # fmt: skip
    source = source.replace("for (;;)", f"for (int n_ = 0; n_ < {rounds}; ++n_)")
    return re.sub(
        r"\bwhile (\((?:[^()]|\((?:[^()]|\([^()]*\))*\))*\)) \{",
        rf"for (int n_ = 0; n_ < {rounds} && \1; ++n_) {{",
        source,
    )


@pytest.mark.parametrize(
    ("problem", "kernel"),
    [
        ("float64 deposit", "deposit.cl"),
        pytest.param(
            "float32 source, long paths", "gather.cl gather: means", marks=pytest.mark.slow
        ),
    ],
)
def test_loops_cut_short_are_named(
    problem: str, kernel: str, device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As by llvmpipe, in all kernels."""
    faulty(monkeypatch, lambda source: cut(source, LLVMPIPE))
    [fault] = check_device(device, only=[problem]).faults
    assert kernel in fault
    assert "is off by" in fault


def test_a_run_ends_if_loops_are_cut_short(
    device: Device, monkeypatch: pytest.MonkeyPatch, tables: Path
) -> None:
    """Rounds of the host are bounded, and a source that does not converge is refused."""
    transport = {**TRANSPORT["source"], "audit": False, "phase": "isotropic"}
    scene = cldit.Scene.from_dict({**SCENE, "transport": transport})
    spray = make_spray(scene.spray, device)
    faulty(monkeypatch, lambda source: cut(source, 8))
    with pytest.raises(ClditError, match=r"energy is not conserved|does not converge"):
        cldit.simulate(scene, device=device, cache=tables, spray=spray)


CPU = list_devices()[0]
GPU = replace(CPU, index="9:0", platform="Other", name="Fast", kind="gpu", memory_bytes=2**40)


@pytest.fixture
def two(monkeypatch: pytest.MonkeyPatch, device: Device) -> list[str]:
    """A second device, a GPU, whose check fails; the names of those that are checked."""
    checked: list[str] = []

    def check(one: Device, **_: object) -> Check:
        checked.append(one.info.name)
        return Check(("float32 x: path.cl scatter: means is off by 3e-01",), 45, 1.0)

    found = [(device.info, device.opened.handle), (GPU, device.opened.handle)]
    monkeypatch.setattr("cldit.gpu.device._described_devices", lambda: found)
    monkeypatch.setattr(
        "cldit.gpu.device._open",
        lambda info, handle, reason, **_: replace(device, info=info, reason=reason),
    )
    monkeypatch.setattr(Device, "close", lambda self: None)
    monkeypatch.setattr(device_check, "check_device", check)
    return checked


def test_a_device_that_fails_is_not_chosen(
    two: list[str], caplog: pytest.LogCaptureFixture
) -> None:
    opened = cldit.opencl_device()
    assert opened.info.kind == "cpu"
    assert opened.reason.endswith("failed their check: 9:0")
    assert failed_devices() == ["9:0"]
    assert "Fast: is checked before its first use" in caplog.text
    assert cldit.opencl_device().info.kind == "cpu"
    assert two == ["Fast"]  # once


def test_a_named_device_that_fails_is_refused(two: list[str]) -> None:
    with pytest.raises(DeviceError, match=r"9:0 \(Fast\): .*path.cl scatter.*another version"):
        cldit.opencl_device("9:0")


def test_a_check_holds_for_a_driver_and_the_kernels(
    two: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    passed = Check((), 45, 2.0)
    store_check(GPU, passed)
    assert stored_check(GPU) == passed
    assert cldit.opencl_device().info.name == "Fast"
    assert not two
    assert stored_check(replace(GPU, driver="another")) is None
    monkeypatch.setattr(checks, "code_digest", lambda _: "another")
    assert stored_check(GPU) is None


def test_nothing_is_chosen_if_all_fail(two: list[str]) -> None:
    for info in list_devices():
        store_check(info, Check(("wrong",), 45, 2.0))
    with pytest.raises(DeviceError, match="none is usable"):
        cldit.opencl_device()


def test_a_damaged_result_is_none(two: list[str], tmp_path: Path) -> None:
    store_check(GPU, Check((), 45, 2.0))
    [path] = (tmp_path / "devices").iterdir()
    path.write_text("faults: [", encoding="utf-8")
    assert stored_check(GPU) is None


def test_the_command_reports_a_fault(two: list[str]) -> None:
    said = command("devices", "--check", "--device", "9:0", status=1).output
    assert "9:0 Fast: float32 x: path.cl scatter: means is off by 3e-01" in said
    plain = json.loads(command("devices", "--json").stdout)
    assert plain["reason"].endswith("failed their check: 9:0")
    assert [one["check"] and one["check"]["kernels"] for one in plain["devices"]] == [None, 45]
    assert two == ["Fast"]


def test_workers_take_no_device_that_fails(two: list[str]) -> None:
    assert _gpus() == ["9:0"]
    store_check(GPU, Check(("wrong",), 45, 2.0))
    assert _gpus() == []
