"""Runs helper functions of a header in a three-line kernel, so that they can be held to NumPy."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, Protocol

import numpy as np
import pyopencl as cl
import pytest
from numpy.typing import NDArray

from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.compilation import compiled
from cldit.gpu.device import Device
from cldit.gpu.kernel_source import assemble
from cldit.spray.flow.gas import GasFlow

from .gas_twin import as_device, gas_of, grid_of

Floats = NDArray[np.floating]


class Apply(Protocol):
    def __call__(
        self,
        header: str,
        expression: str | Sequence[str],
        inputs: list[Floats],
        *,
        defines: str = "",
        setup: str = "",
    ) -> Floats: ...


def _apply(
    device: Device,
    header: str,
    expression: str | Sequence[str],
    inputs: list[Floats],
    *,
    defines: str = "",
    setup: str = "",
) -> Floats:
    """`expression` of a, b, c ... (one number a work-item each, as in `inputs`), after `setup`; in
    double precision with USE_FLOAT64. Several are compiled at once, and are rows of the result."""
    double = "USE_FLOAT64" in defines
    real: type[np.floating] = np.float64 if double else np.float32
    number = "double" if double else "float"
    names = [chr(ord("a") + i) for i in range(len(inputs))]
    arguments = "".join(f", __global const {number} *{name}_" for name in names)
    loads = " ".join(f"const {number} {name} = {name}_[i];" for name in names)
    several = (expression,) if isinstance(expression, str) else tuple(expression)
    lines = " ".join(f"out[{n} * get_global_size(0) + i] = {e};" for n, e in enumerate(several))
    source = (
        f"{defines}\n{assemble(header)}\n__kernel void apply(__global {number} *out{arguments})\n"
        f"{{ const int i = get_global_id(0); {loads} {setup} {lines} }}\n"
    )
    program = compiled(device, source).program
    count = len(inputs[0])
    out = zeros(device, "out", count * len(several), real)
    buffers: list[Any] = [upload(device, "in", array.astype(real)) for array in inputs]
    cl.Kernel(program, "apply")(device.queue, (count,), None, out, *buffers)
    shape = (count,) if isinstance(expression, str) else (len(several), count)
    return download(device, out, np.empty(shape, real))


@pytest.fixture(scope="session")
def apply(device: Device) -> Apply:
    return partial(_apply, device)


@pytest.fixture(
    scope="session",
    params=[
        (np.float64, 8),
        pytest.param((np.float64, 1), marks=pytest.mark.slow),
        (np.float32, 1),
    ],
    ids=["double-8", "double-1", "single-1"],
)
def gas_device(request: pytest.FixtureRequest, device: Device) -> Device:
    """The device as the gas sees a CPU, a GPU, and one without double precision."""
    real, width = request.param
    if real is np.float64 and not device.info.float64:
        pytest.skip("the device has no double precision")
    return as_device(device, real, width)


@pytest.fixture(params=["walls", "ring", "round", "sector"])
def gas_flow(request: pytest.FixtureRequest, gas_device: Device) -> GasFlow:
    """Gas at rest on each kind of grid."""
    return gas_of(grid_of(request.param), gas_device)
