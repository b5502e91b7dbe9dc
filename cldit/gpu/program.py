"""Programs: a kernel source, specialised by defines and built for a device; launches by name."""

import re
import threading
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pyopencl as cl

from cldit.errors import KernelError
from cldit.gpu.compilation import Compiled, compiled
from cldit.gpu.device import Device
from cldit.gpu.kernel_source import assemble, with_files
from cldit.gpu.pocl import check_room
from cldit.gpu.signature import Signature

Define = int | float | str
GROUP = 64  # work-items of a group without shared data: whole subgroups of all GPUs (8 to 64)

_OLD_POCL = (
    "\nThis PoCL is older than the processor. Install a later one (from conda-forge, say) or "
    "another OpenCL driver; `cldit devices` lists the devices."
)


@dataclass(frozen=True)
class Launch:
    """A kernel with its arguments, queued by each call; it belongs to the thread that made it."""

    program: "Program"
    queue: Any
    kernel: Any
    signature: Signature
    size: tuple[int, ...]
    group: tuple[int, ...] | None
    arguments: Mapping[str, Any]  # whose buffers OpenCL does not keep

    def __call__(self, **changed: Any) -> None:
        """Queues the kernel, with new values of those arguments that it has."""
        for number, argument in enumerate(self.signature.arguments):
            if argument.name in changed:
                self.kernel.set_arg(number, argument.value(changed[argument.name]))
        cl.enqueue_nd_range_kernel(self.queue, self.kernel, self.size, self.group)
        if self.program.device.watch is not None:
            self.program.watched(self.signature.kernel, {**self.arguments, **changed})

    def resized(self, size: tuple[int, ...]) -> "Launch":
        """The same launch, of so many work-items."""
        return replace(self, size=size)


@dataclass(frozen=True)
class Program:
    """A built program.

    defines: exactly those that the compiler was given. build_s, build_core_s: wall and CPU seconds
    that the build took in this process, near 0 if the program was built before.
    """

    device: Device
    name: str
    defines: Mapping[str, Define]
    build_s: float
    build_core_s: float
    built: Compiled
    _thread: threading.local = field(default_factory=threading.local, repr=False, compare=False)

    @property
    def real(self) -> type[np.floating]:
        """The type that the kernels call real."""
        return np.float64 if "USE_FLOAT64" in self.defines else np.float32

    def largest_group(self, kernel: str) -> int:
        """Largest number of work-items in a group of this kernel on this device."""
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
        """Queues a kernel and returns at once.

        Args:
            kernel: its name.
            size: number of work-items, rounded up to whole groups.
            group: work-items of a group; None lets the driver choose.
            arguments: by their names in the source: buffers, arrays for vectors, and numbers, those
                of NumPy in the kernel's own type. Others raise KernelError.
            offset: of the first work-item.
        """
        kernel_object, signature = self._kernel(kernel)
        kernel_object.set_args(*signature.values(arguments))
        global_size = _whole_groups(size, group)
        cl.enqueue_nd_range_kernel(self.device.queue, kernel_object, global_size, group, offset)
        self.watched(kernel, arguments)

    def launch_each(
        self,
        kernel: str,
        sizes: Iterable[int],
        group: int,
        varying: str,
        values: Iterable[int],
        arguments: Mapping[str, Any],
    ) -> None:
        """Queues a kernel once for each size, in whole groups, with one argument that varies.

        varying, values: its name, and its value in each launch; the rest is as in `launch`.
        """
        kernel_object, signature = self._kernel(kernel)
        number, values = signature.place(varying), list(values)
        if not values:
            return
        takes = signature.arguments[number].value
        kernel_object.set_args(*signature.values({varying: values[0], **arguments}))
        queue = self.device.queue
        for size, value in zip(sizes, values, strict=True):
            kernel_object.set_arg(number, takes(value))
            cl.enqueue_nd_range_kernel(queue, kernel_object, (size,), (group,))
        self.watched(kernel, arguments)

    def watched(self, kernel: str, arguments: Mapping[str, Any]) -> None:
        """Reports a launch to `Device.watch`."""
        if self.device.watch is not None:
            self.device.watch(self, kernel, arguments)

    def takes(self, kernel: str) -> tuple[str, ...]:
        """Names of a kernel's arguments in order."""
        return tuple(argument.name for argument in self._kernel(kernel)[1].arguments)

    def bind(
        self,
        kernel: str,
        size: tuple[int, ...],
        group: tuple[int, ...] | None,
        arguments: Mapping[str, Any],
    ) -> "Launch":
        """A launch that is repeated, with its arguments set once; see `launch`."""
        signature = self._kernel(kernel)[1]
        kernel_object = cl.Kernel(self.built.program, kernel)
        kernel_object.set_args(*signature.values(arguments))
        global_size = _whole_groups(size, group)
        return Launch(
            self, self.device.queue, kernel_object, signature, global_size, group, dict(arguments)
        )

    def _kernel(self, name: str) -> tuple[Any, Signature]:
        """The kernel object of this thread (arguments stay set in it), and its signature."""
        kernels: dict[str, tuple[Any, Signature]] = self._thread.__dict__
        if name not in kernels:
            arguments, signatures = self.built.arguments, self.built.signatures
            if name not in arguments:
                has = ", ".join(arguments)
                raise KernelError(f"kernels/{self.name}: no kernel {name}; it has {has}")
            handle = self.device.opened.handle
            if name not in signatures:
                check_room(handle)  # PoCL compiles once more at the first launch
            kernel_object = cl.Kernel(self.built.program, name)
            if name not in signatures:
                signatures[name] = Signature.of(kernel_object, arguments[name], handle, self.real)
            kernels[name] = kernel_object, signatures[name]
        return kernels[name]


def _whole_groups(size: tuple[int, ...], group: tuple[int, ...] | None) -> tuple[int, ...]:
    """Numbers of work-items, rounded up to whole groups."""
    if group is None:
        return size
    return tuple(-(-items // width) * width for items, width in zip(size, group, strict=True))


def _literal(value: Define) -> str:
    if isinstance(value, float):
        return f"{np.float32(value):.9e}f"
    return str(value)


def build(
    device: Device, name: str, defines: Mapping[str, Define], *, preamble: str = ""
) -> Program:
    """Builds kernels/NAME with those defines that its source names, so that others build nothing
    anew; floats become single-precision literals.

    `preamble` is OpenCL C in front of it, see `assemble`. Raises KernelError with the compiler's
    log.
    """
    source = assemble(name, preamble=preamble)
    named = set(re.findall(r"\w+", source))
    defines = {key: value for key, value in defines.items() if key in named}
    # PoCL's cache is by text and options, whichever processor the program was compiled for.
    built_for = re.sub(r"\W+", "_", device.info.version)
    options = [f"-D{key}={_literal(value)}" for key, value in sorted(defines.items())]
    options.append(f"-DBUILT_FOR={built_for}")
    start, cpu = time.perf_counter(), time.process_time()
    try:
        built = compiled(device, source, options)
    except cl.Error as error:
        hint = _OLD_POCL if "unknown target CPU" in str(error) else ""
        log = with_files(str(error), source)
        raise KernelError(f"kernels/{name} with {' '.join(options)}:\n{log}{hint}") from error
    return Program(
        device=device,
        name=name,
        defines=dict(defines),
        build_s=time.perf_counter() - start,
        build_core_s=time.process_time() - cpu,
        built=built,
    )
