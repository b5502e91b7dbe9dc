"""Runs one helper function of a header in a three-line kernel, so that it can be held to NumPy."""

from __future__ import annotations

from functools import partial
from typing import Any, Protocol

import numpy as np
import pyopencl as cl
import pytest
from numpy.typing import NDArray

from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import OPTIONS
from cldit.gpu.source import assemble

Floats = NDArray[np.float32]


class Apply(Protocol):
    def __call__(
        self,
        header: str,
        expression: str,
        inputs: list[Floats],
        *,
        defines: str = "",
        setup: str = "",
    ) -> Floats: ...


def _apply(
    device: Device,
    header: str,
    expression: str,
    inputs: list[Floats],
    *,
    defines: str = "",
    setup: str = "",
) -> Floats:
    """`expression` of a, b, c ... (one float a work-item each, as in `inputs`), after `setup`."""
    names = [chr(ord("a") + i) for i in range(len(inputs))]
    arguments = "".join(f", __global const float *{name}_" for name in names)
    loads = " ".join(f"const float {name} = {name}_[i];" for name in names)
    source = (
        f"{defines}\n{assemble(header)}\n__kernel void apply(__global float *out{arguments})\n"
        f"{{ const int i = get_global_id(0); {loads} {setup} out[i] = {expression}; }}\n"
    )
    program = cl.Program(device.context, source).build(options=list(OPTIONS))
    count = len(inputs[0])
    out = zeros(device, "out", count, np.float32)
    buffers: list[Any] = [upload(device, "in", array.astype(np.float32)) for array in inputs]
    cl.Kernel(program, "apply")(device.queue, (count,), None, out, *buffers)
    return download(device, out, np.empty(count, np.float32))


@pytest.fixture(scope="session")
def apply(device: Device) -> Apply:
    return partial(_apply, device)
