"""Choosing an OpenCL device: by rule, by index, by name; and what is said where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyopencl as cl
import pytest

from cldit.errors import DeviceError
from cldit.gpu.buffers import check_size, download, unset, upload, zeros
from cldit.gpu.device import Device, DeviceInfo, choose, list_devices, open_device

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
