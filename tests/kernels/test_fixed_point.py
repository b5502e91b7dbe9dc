"""Sums in fixed point: exact, in any order, with 64-bit atomics and with two words."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pyopencl as cl
import pytest
from numpy.typing import NDArray

from cldit.errors import KernelError
from cldit.gpu.buffers import upload, zeros
from cldit.gpu.compilation import compiled
from cldit.gpu.device import Device
from cldit.gpu.fixed_point import fixed_point_defines, fixed_point_scale, fixed_point_sums
from cldit.gpu.kernel_source import assemble

LAYOUTS = [(), ("-DFIXED_POINT_WORDS=1",)]
BODY = """
__kernel void apply(
    __global long *sums, __global const real *value, __global const long *units,
    __global const int *at, const real scale)
{
    const int i = get_global_id(0);
    BODY
}
"""


def _summed(
    device: Device,
    layout: tuple[str, ...],
    body: str,
    at: NDArray[np.int32],
    *,
    value: Any = None,
    units: Any = None,
    scale: float = 1.0,
    count: int = 1,
) -> NDArray[np.float64]:
    if "FIXED_POINT_WORDS" in fixed_point_defines(device) and not layout:
        pytest.skip("the device has no 64-bit atomics")
    source = assemble("fixed_point.h") + BODY.replace("BODY", body)
    kernel = cl.Kernel(compiled(device, source, layout).program, "apply")
    none = np.zeros(1)
    buffers = [
        upload(device, "value", np.asarray(none if value is None else value, np.float32)),
        upload(device, "units", np.asarray(none if units is None else units, np.int64)),
        upload(device, "at", at),
    ]
    sums = zeros(device, "sums", count, np.int64)
    kernel(device.queue, (len(at),), None, sums, *buffers, np.float32(scale))
    return fixed_point_sums(device, sums, count, scale)


ADD_UNITS = "add_units(sums + at[i], units[i]);"
ADD_FIXED = "add_fixed(sums + at[i], value[i], scale);"


@pytest.mark.parametrize("layout", LAYOUTS, ids=["64 bits", "two words"])
def test_units_of_all_sizes(device: Device, layout: tuple[str, ...]) -> None:
    """40,000 integers of both signs and 0 to 40 bits in 7 sums, against Python's integers. Their
    low words overflow many times; the sums are below 2^53, so that float64 is exact."""
    rng = np.random.default_rng(5)
    count = 40_000
    units = (2.0 ** rng.uniform(0, 40, count)).astype(np.int64) * rng.choice([-1, 0, 1], count)
    units[:4] = [2**32 - 1, -(2**32), -1, 2**32]
    at = rng.integers(0, 7, count).astype(np.int32)
    got = _summed(device, layout, ADD_UNITS, at, units=units, count=7)
    expected = [sum(int(one) for one in units[at == k]) for k in range(7)]
    assert max(map(abs, expected)) < 2**53
    assert got.tolist() == expected


@pytest.mark.parametrize("layout", LAYOUTS, ids=["64 bits", "two words"])
def test_values_are_rounded_once(device: Device, layout: tuple[str, ...]) -> None:
    """Sums of numbers from 1e-12 to 1 in units of 2^-48 are those of their rounded units, in any
    order, and are the exact sums to half a unit a term."""
    rng = np.random.default_rng(6)
    count, scale = 20_000, 2.0**48
    value = (10 ** rng.uniform(-12, 0, count) * rng.choice([-1, 1], count)).astype(np.float32)
    at = np.zeros(count, np.int32)
    got = _summed(device, layout, ADD_FIXED, at, value=value, scale=scale)
    exact = value.astype(np.float64)
    assert got[0] == np.sum(np.rint(exact * scale).astype(np.int64)) / scale
    assert abs(got[0] - exact.sum()) <= 0.5 * count / scale
    turned = rng.permutation(count)
    again = _summed(device, layout, ADD_FIXED, at, value=value[turned], scale=scale)
    assert again[0] == got[0]


def test_units_and_back(apply: Any) -> None:
    """Numbers of 20 bits with their signs return unchanged; halves of a unit become even units."""
    value = np.concatenate([np.arange(-(2**20), 2**20, 1001) / 4.0, [0.125, 0.375, -0.125]])
    got = apply("fixed_point.h", "from_fixed(to_fixed(a, R(4)), R(4))", [value])
    assert got[:-3].tolist() == value[:-3].tolist()
    assert got[-3:].tolist() == [0.0, 0.5, 0.0]


def test_the_scale_leaves_room() -> None:
    """The bound fills 61 to 62 of 63 bits; scales are powers of two of single precision."""
    for bound in (1e-18, 1e-5, 0.5, 1.0, 3.0, 1e30, 2.0**127):
        scale = fixed_point_scale(bound)
        assert 2.0**61 <= bound * scale <= 2.0**62
        assert np.frexp(scale)[0] == 0.5 and float(np.float32(scale)) == scale
    for bound in (0.0, 1e-40):
        assert bound * fixed_point_scale(bound) <= 2.0**62
        assert np.isfinite(np.float32(fixed_point_scale(bound)))
    for wrong in (-1.0, float("nan"), float("inf"), 1e300):
        with pytest.raises(KernelError, match=r"bound .*; allowed: 0 to"):
            fixed_point_scale(wrong)


@pytest.mark.parametrize(
    ("extensions", "words"),
    [("cl_khr_fp64 cl_khr_int64_base_atomics", False), ("cl_khr_int64_base_atomics_x", True)],
)
def test_layout_by_the_device(extensions: str, words: bool) -> None:
    handle = SimpleNamespace(extensions=extensions)
    device: Any = SimpleNamespace(opened=SimpleNamespace(handle=handle))
    assert ("FIXED_POINT_WORDS" in fixed_point_defines(device)) == words
