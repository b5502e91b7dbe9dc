"""Building: one source, specialised by defines, on one device."""

from __future__ import annotations

import re
import threading
import time
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyopencl as cl

from cldit.errors import KernelError
from cldit.gpu.device import Device
from cldit.gpu.kernel_source import assemble
from cldit.gpu.malloc_trim import trim_heap
from cldit.gpu.signature import ASKED_FOR, Signature

Define = int | float | str

# Light that goes deep into a spray dies away into denormal numbers, with which CPUs are a hundred
# times slower: scattering took a sixth of its time more in `gdi`.
OPTIONS = ("-cl-std=CL1.2", "-cl-denorms-are-zero", ASKED_FOR)

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

    device: Device
    name: str
    defines: Mapping[str, Define]
    build_s: float
    build_core_s: float
    built: Any
    _own: threading.local = field(default_factory=threading.local, repr=False, compare=False)

    def largest_group(self, kernel: str) -> int:
        """Work-items of a group of this kernel on this device, at most."""
        return min(self.device.info.largest_group, self._kernel(kernel)[1].largest_group)

    def launch(
        self,
        kernel: str,
        size: tuple[int, ...],
        group: tuple[int, ...] | None,
        arguments: Mapping[str, Any],
        *,
        offset: tuple[int, ...] | None = None,
    ) -> None:
        """Queues a kernel, with arguments by their names in the source; waits for nothing.

        Args:
            size: work-items, at least; rounded up to whole groups.
            group: work-items of a group; None lets the driver choose.
            arguments: by name: buffers, arrays for vectors, numbers; those of NumPy in the
                kernel's own type.
            offset: of the first work-item.

        Raises:
            KernelError: an argument is missing, not known, or of another type.
        """
        made, signature = self._kernel(kernel)
        made.set_args(*signature.values(arguments))
        whole = size
        if group is not None:
            whole = tuple(-(-items // each) * each for items, each in zip(size, group, strict=True))
        cl.enqueue_nd_range_kernel(self.device.queue, made, whole, group, offset)

    def launch_each(
        self,
        kernel: str,
        sizes: Iterable[int],
        group: int,
        varying: str,
        values: Iterable[int],
        arguments: Mapping[str, Any],
    ) -> None:
        """As `launch`, once for each size, where one argument alone is another each time."""
        made, signature = self._kernel(kernel)
        number, values = signature.place(varying), list(values)
        if not values:
            return
        takes = signature.arguments[number].value
        made.set_args(*signature.values({varying: values[0], **arguments}))
        queue = self.device.queue
        for size, value in zip(sizes, values, strict=True):
            made.set_arg(number, takes(value))
            cl.enqueue_nd_range_kernel(queue, made, (size,), (group,))

    def _kernel(self, name: str) -> tuple[Any, Signature]:
        """This thread's kernel, as arguments that are set stay with it; and what it takes."""
        kernels: dict[str, tuple[Any, Signature]] = self._own.__dict__
        if name not in kernels:
            names = self.built.kernel_names.split(";")
            if name not in names:
                known = ", ".join(names)
                raise KernelError(f"kernels/{self.name}: no kernel {name}; it has {known}")
            made, known_as = cl.Kernel(self.built, name), (id(self.built), name)
            opened = self.device.opened  # which keeps the program, and so its id
            signature = opened.signatures.get(known_as)
            if signature is None:
                real = np.float64 if "USE_FLOAT64" in self.defines else np.float32
                signature = Signature.of(made, opened.handle, real)
                opened.signatures[known_as] = signature
            kernels[name] = made, signature
        return kernels[name]


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
        device=device,
        name=name,
        defines=dict(defines),
        build_s=time.perf_counter() - start,
        build_core_s=time.process_time() - cpu,
        built=built,
    )
