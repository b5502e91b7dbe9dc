"""Choosing an OpenCL device, and the name that PoCL gives to a processor it does not know."""

from __future__ import annotations

import ctypes
import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyopencl as cl
import pytest

from cldit.errors import DeviceError
from cldit.gpu.buffers import check_size, download, unset, upload, zeros
from cldit.gpu.device import Device, DeviceInfo, choose, list_devices, open_device
from cldit.gpu.pocl import instruction_sets, like_processor, mistaken_for, name_processor

CPU = DeviceInfo(
    index="0:0", platform="PoCL", name="some processor", kind="cpu", version="OpenCL 3.0",
    driver="6", compute_units=8, memory_bytes=10**10, largest_buffer_bytes=10**9, float64=True,
)  # fmt: skip
SMALL = replace(CPU, index="1:0", platform="V", name="small card", kind="gpu", memory_bytes=2**31)
LARGE = replace(CPU, index="1:1", platform="V", name="large card", kind="gpu", memory_bytes=2**35)


def test_gpu_with_most_memory_comes_first() -> None:
    number, reason = choose([CPU, SMALL, LARGE], None)
    assert number == 2 and "GPU" in reason


def test_cpu_where_there_is_no_gpu() -> None:
    number, reason = choose([replace(CPU, compute_units=1), CPU], None)
    assert number == 1 and "no GPU" in reason


@pytest.mark.parametrize(
    ("wanted", "expected"), [("1:0", 1), ("LARGE", 2), ("cpu", 0), ("pocl", 0)]
)
def test_asked_for(wanted: str, expected: int) -> None:
    assert choose([CPU, SMALL, LARGE], wanted)[0] == expected


def test_unknown_device_lists_what_there_is() -> None:
    with pytest.raises(DeviceError, match=r"'5:0' does not exist; allowed: 0:0 some processor"):
        choose([CPU], "5:0")


def test_no_platform_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> list[object]:
        raise cl.LogicError("clGetPlatformIDs failed: PLATFORM_NOT_FOUND_KHR")

    monkeypatch.setattr(cl, "get_platforms", none)
    with pytest.raises(DeviceError, match=r"pyopencl\[pocl\]"):
        list_devices()


def test_platform_without_devices(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cl, "get_platforms", lambda: [])
    with pytest.raises(DeviceError, match=r"pyopencl\[pocl\]"):
        open_device()


def test_buffer_beyond_the_device_is_refused_by_name(device: Device) -> None:
    with pytest.raises(DeviceError, match=r"octree: .* GB is more than"):
        check_size(device, "octree", device.info.largest_buffer_bytes + 1)


def test_empty_buffers_exist(device: Device) -> None:
    assert upload(device, "nothing", np.zeros(0, np.float32)).size == 4
    assert zeros(device, "nothing", 0, np.float64).size == 8


def test_poison_shows_in_fresh_buffers_alone(device: Device) -> None:
    """Of all devices, in every type that kernels read."""
    poisoned = replace(device, others=(device,)).poisoned()
    for one in (poisoned, *poisoned.others):
        for real in (np.float32, np.float64):
            found = download(one, unset(one, "fresh", 3, real), np.zeros(3, real))
            assert np.all(np.isnan(found))
            assert np.all(download(one, zeros(one, "zeros", 3, real), found) == 0)
        for whole in (np.int32, np.uint32):
            found = download(one, unset(one, "fresh", 3, whole), np.zeros(3, whole))
            assert np.all(found == np.iinfo(whole).max)
    assert not device.poison


HASWELL = frozenset("sse2 avx2 fma bmi1 bmi2 f16c movbe avx popcnt pclmulqdq sse4_2".split())
needs_linux = pytest.mark.skipif(sys.platform != "linux", reason="PoCL's record is read on Linux")


def _device(*texts: bytes) -> tuple[Any, Any]:
    """A record of pointers to texts, as PoCL's of a device; the device and the record."""
    record = (ctypes.c_char_p * 512)()
    for place, text in enumerate(texts, 10):
        record[place] = text
    numbers = ctypes.cast(record, ctypes.POINTER(ctypes.c_uint64))
    numbers[400], numbers[401] = 0xDEAD_BEEF_0000, (1 << 64) - 1  # lead nowhere
    version = "OpenCL 3.0 PoCL HSTR: pthread-x86_64-unknown-linux-gnu-generic "
    return SimpleNamespace(int_ptr=ctypes.addressof(record), version=version), record


def test_no_instruction_is_taken_for_granted() -> None:
    assert like_processor(HASWELL) == b"haswell"
    assert like_processor(HASWELL - {"fma"}) == b"sandybridge"
    assert like_processor(frozenset({"sse2"})) == b"x86-64"
    assert like_processor(frozenset({"neon"})) is None


@needs_linux
def test_the_name_in_the_record_is_replaced() -> None:
    device, record = _device(b"generic", b"x86_64-unknown-linux-gnu", b"generic", b"3.0")
    flags = instruction_sets()
    assert name_processor(device, b"generic", flags)
    name = record[12]
    assert name == like_processor(flags)
    assert name not in (b"generic", b"", None)
    assert record[10:14] == [b"generic", b"x86_64-unknown-linux-gnu", name, b"3.0"]
    assert not name_processor(device, b"generic", flags)  # done already


@needs_linux
@pytest.mark.parametrize(
    "texts", [(b"x86_64-unknown-linux-gnu", b"znver3"), (b"linux-musl", b"generic")]
)
def test_a_record_that_is_not_understood_is_left_alone(texts: tuple[bytes, ...]) -> None:
    device, record = _device(*texts)
    assert not name_processor(device, b"generic", instruction_sets())
    assert record[10:12] == list(texts)


def test_only_pocl_of_an_unknown_processor_is_touched() -> None:
    """One that it has no name for; and Zen 4, which it takes for Zen 3, by its AVX-512."""

    def name(platform: str, version: str, flags: frozenset[str] = HASWELL) -> bytes | None:
        device = SimpleNamespace(version=version)
        return mistaken_for(SimpleNamespace(name=platform), device, flags)

    pocl = "Portable Computing Language"
    linux = "OpenCL 3.0 PoCL HSTR: pthread-x86_64-unknown-linux-gnu-"
    zen_4 = HASWELL | frozenset("adx avx512f avx512bw avx512cd avx512dq avx512vl".split())
    assert name(pocl, linux + "generic ") == b"generic"
    assert name(pocl, linux + "znver3", zen_4) == b"znver3"
    assert name(pocl, linux + "znver3") is None
    assert name(pocl, linux + "icelake-client", zen_4) is None
    assert name("NVIDIA CUDA", "OpenCL 3.0 CUDA-generic") is None
    assert like_processor(zen_4) == b"skylake-avx512"
