"""OpenCL devices by rule and name, names of processors for PoCL, arguments of kernels."""

from __future__ import annotations

import ctypes
import sys
import threading
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyopencl as cl
import pytest

from cldit.errors import DeviceError, KernelError
from cldit.gpu import kernel_source
from cldit.gpu.buffers import check_size, download, unset, upload, zeros
from cldit.gpu.device import Device, DeviceInfo, choose, list_devices, open_device, shares
from cldit.gpu.pocl import instruction_sets, like_processor, mistaken_for, name_processor
from cldit.gpu.program import Program, build

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


def test_devices_share_all_rows_by_their_compute_units(device: Device) -> None:
    first, *others = (
        replace(device, info=replace(device.info, compute_units=units)) for units in (1, 3, 4)
    )
    together = replace(first, others=tuple(others))
    for count in (0, 1, 7, 800):
        rows = [row for _, member in shares(together, count) for row in member]
        assert rows == list(range(count))
    assert [len(member) for _, member in shares(together, 800)] == [100, 300, 400]


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
    """A processor without a name in PoCL, and Zen 4, taken for Zen 3, by its AVX-512."""

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


COUNT = 8
SOURCE = """
#ifdef USE_FLOAT64
typedef double real;
typedef double4 real4;
#else
typedef float real;
typedef float4 real4;
#endif
__kernel void fill(__global real *out, const real height, const int first,
#ifdef SHIFTED
    const real4 shift,
#endif
    __constant uint *all)
{
    real value = height + all[0];
#ifdef SHIFTED
    value += shift.w;
#endif
    out[get_global_id(0)] = value + first;
}
"""


@pytest.fixture
def program(device: Device, monkeypatch: pytest.MonkeyPatch) -> Program:
    monkeypatch.setattr(kernel_source, "read_source", lambda _: SOURCE)
    return build(device, "fill.cl", {"SHIFTED": 1})


@pytest.fixture
def arguments(device: Device) -> dict[str, Any]:
    return {
        "all": upload(device, "all", np.array([4], np.uint32)),  # a function of OpenCL C, too
        "shift": np.array([0, 0, 0, 0.5], np.float32),
        "first": 2,
        "height": 0.25,
        "out": zeros(device, "out", COUNT, np.float32),
    }


def test_arguments_go_by_name(program: Program, arguments: dict[str, Any], device: Device) -> None:
    """In whatever order; and as the defines have it."""
    program.launch("fill", (COUNT - 1,), (COUNT,), arguments)
    got = download(device, arguments["out"], np.empty(COUNT, np.float32))
    assert got.tolist() == [6.75] * COUNT  # of whole groups
    plain = build(device, "fill.cl", {})
    del arguments["shift"]
    plain.launch("fill", (COUNT,), None, arguments)
    got = download(device, arguments["out"], np.empty(COUNT, np.float32))
    assert got.tolist() == [6.25] * COUNT


def test_one_argument_may_vary(program: Program, arguments: dict[str, Any], device: Device) -> None:
    del arguments["first"]
    program.launch_each("fill", [COUNT, COUNT // 2], 2, "first", [1, 3], arguments)
    got = download(device, arguments["out"], np.empty(COUNT, np.float32))
    assert got.tolist() == [7.75] * (COUNT // 2) + [5.75] * (COUNT // 2)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (
            {"first": None},
            r"kernel fill: misses first; it takes real\* out, real height, int first",
        ),
        ({"begin": 1}, "kernel fill: has no argument begin; it takes"),
        ({"first": 1.5}, "argument first: is a float; expected: int32, int"),
        ({"first": 2**31}, "argument first: is 2147483648; expected: int32, int"),
        ({"first": np.uint32(1)}, "argument first: is a uint32; expected: int32, int"),
        ({"height": np.float64(1)}, "argument height: is a float64; expected: float32, real"),
        ({"out": 1.0}, r"argument out: is a float; expected: a buffer, real\*"),
        ({"shift": np.zeros(4)}, r"shift: is float64 \(4,\); expected: an array of 4 float32"),
        (
            {"shift": np.zeros(3, np.float32)},
            r"shift: is float32 \(3,\); expected: an array of 4",
        ),
    ],
)
def test_what_is_wrong_is_named(
    program: Program, arguments: dict[str, Any], changed: dict[str, Any], words: str
) -> None:
    given = {name: value for name, value in (arguments | changed).items() if value is not None}
    with pytest.raises(KernelError, match=words):
        program.launch("fill", (COUNT,), None, given)


def test_buffers_of_other_numbers_are_refused(
    program: Program, arguments: dict[str, Any], device: Device
) -> None:
    arguments["out"] = zeros(device, "out", COUNT, np.int32)
    with pytest.raises(KernelError, match="out: is a buffer of int32; expected: float32"):
        program.launch("fill", (COUNT,), None, arguments)
    with pytest.raises(KernelError, match=r"kernels/fill\.cl: no kernel gill; it has fill"):
        program.launch("gill", (COUNT,), None, arguments)
    with pytest.raises(KernelError, match="kernel fill: has no argument begin"):
        program.launch_each("fill", [1], 1, "begin", [1], arguments)


def test_threads_set_their_own_arguments(
    program: Program, arguments: dict[str, Any], device: Device
) -> None:
    """One sets all of its arguments between those of another and its launch."""
    other = arguments | {"out": zeros(device, "out", COUNT, np.float32), "first": 5}

    def sizes() -> Any:
        """Asked for after the arguments are set."""
        thread = threading.Thread(target=program.launch, args=("fill", (COUNT,), None, other))
        thread.start()
        thread.join()
        yield COUNT

    del arguments["first"]
    program.launch_each("fill", sizes(), COUNT, "first", [2], arguments)
    got = download(device, arguments["out"], np.empty(COUNT, np.float32))
    assert got.tolist() == [6.75] * COUNT


def test_groups_are_no_larger_than_the_kernel_allows(program: Program) -> None:
    made, signature = program._kernel("fill")
    assert 1 <= program.largest_group("fill") <= signature.largest_group
    assert signature.kernel == made.function_name == "fill"
