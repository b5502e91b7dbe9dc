"""Kernels' arguments go by name, and what is wrong with them is said before they are set."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest

from cldit.errors import KernelError
from cldit.gpu import kernel_source
from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import Program, build

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
