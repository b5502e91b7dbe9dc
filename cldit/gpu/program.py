"""Building: one source, specialised by defines, on one device."""

from __future__ import annotations

import re
import time
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyopencl as cl

from cldit.errors import KernelError
from cldit.gpu.device import Device
from cldit.gpu.kernel_source import assemble
from cldit.gpu.malloc_trim import trim_heap

Define = int | float | str

# Light that goes deep into a spray dies away into denormal numbers, with which CPUs are a hundred
# times slower: scattering took a sixth of its time more in `gdi`.
OPTIONS = ("-cl-std=CL1.2", "-cl-denorms-are-zero")

_OLD_POCL = (
    "\nThis PoCL is older than the processor. A later one (conda-forge has them) or another driver "
    "for OpenCL will do; `cldit devices` lists what there is."
)


@dataclass(frozen=True)
class Program:
    """A built program; `defines` are exactly what the compiler was given.

    build_s, build_core_s: wall seconds and CPU seconds of this process that building took; next to
    nothing, where this device has built the same before.
    """

    name: str
    defines: Mapping[str, Define]
    build_s: float
    build_core_s: float
    _kernels: Mapping[str, Any]

    def __getitem__(self, kernel: str) -> Any:
        return self._kernels[kernel]


def _literal(value: Define) -> str:
    if isinstance(value, float):
        return f"{np.float32(value):.9e}f"
    return str(value)


def build(device: Device, name: str, defines: Mapping[str, Define]) -> Program:
    """Builds `kernels/name` for the device; floats become single-precision literals.

    Raises:
        KernelError: the source does not assemble or build; the message holds the compiler's log.
    """
    source = assemble(name)
    # PoCL keeps what it has built by text and options, whatever processor it took this one for.
    built_for = re.sub(r"\W+", "_", device.info.version)
    options = [f"-D{key}={_literal(value)}" for key, value in sorted(defines.items())]
    options.append(f"-DBUILT_FOR={built_for}")
    start, cpu = time.perf_counter(), time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", cl.CompilerWarning)  # PoCL reports its own headers
            program = device.built.get((source, *options))
            if program is None:
                program = cl.Program(device.context, source).build(options=[*OPTIONS, *options])
                device.built[source, *options] = program
                trim_heap()
            # Arguments that are set stay with a kernel: each program has its own.
            kernels = {kernel.function_name: kernel for kernel in program.all_kernels()}
    except cl.Error as error:
        hint = _OLD_POCL if "unknown target CPU" in str(error) else ""
        raise KernelError(f"kernels/{name} with {' '.join(options)}:\n{error}{hint}") from error
    return Program(
        name=name,
        defines=dict(defines),
        build_s=time.perf_counter() - start,
        build_core_s=time.process_time() - cpu,
        _kernels=kernels,
    )
