"""Building: one source, specialised by defines, on one device."""

from __future__ import annotations

import re
import threading
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
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
    _built: Any
    _own: threading.local = field(default_factory=threading.local, repr=False, compare=False)

    def __getitem__(self, kernel: str) -> Any:
        """This thread's kernel: arguments that are set stay with it."""
        try:
            return self._own.kernels[kernel]
        except AttributeError:
            made = self._built.all_kernels()
            self._own.kernels = {one.function_name: one for one in made}
            return self._own.kernels[kernel]


# Python's filters of warnings are the whole process's: one thread at a time changes them.
_FILTERS = threading.Lock()


def compiled(device: Device, source: str, options: Sequence[str] = ()) -> Any:
    """pyopencl's program of a source, with `OPTIONS` besides; built once a device.

    A compiler's log without errors is no warning: Intel's is never empty.

    Raises:
        pyopencl.Error: it does not build.
    """
    opened, key = device.opened, (source, *options)
    with opened.lock:
        program = opened.programs.get(key)
        if program is None:
            with _FILTERS, warnings.catch_warnings():
                warnings.simplefilter("ignore", cl.CompilerWarning)
                program = cl.Program(opened.opencl, source).build(options=[*OPTIONS, *options])
            opened.programs[key] = program
            trim_heap()
    return program


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
        built = compiled(device, source, options)
    except cl.Error as error:
        hint = _OLD_POCL if "unknown target CPU" in str(error) else ""
        raise KernelError(f"kernels/{name} with {' '.join(options)}:\n{error}{hint}") from error
    return Program(
        name=name,
        defines=dict(defines),
        build_s=time.perf_counter() - start,
        build_core_s=time.process_time() - cpu,
        _built=built,
    )
