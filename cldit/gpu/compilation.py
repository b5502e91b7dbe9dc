"""Compiling a source for a device: once in a process, and once in a folder of caches.

PoCL and NVIDIA's driver keep what they have compiled. For the others a program's binary is kept
here, and beside it the arguments of its kernels, because clGetKernelArgInfo answers only for
programs that were made from source.
"""

import ctypes
import hashlib
import json
import threading
import warnings
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pyopencl as cl
from filelock import FileLock
from pyopencl.characterize import has_src_build_cache

from cldit.gpu.context import Context
from cldit.gpu.device import Device
from cldit.gpu.pocl import check_room
from cldit.gpu.signature import Arguments, Signature
from cldit.io.caches import default_cache
from cldit.io.files import make_folder, write_bytes

# Denormal numbers make CPUs a hundred times slower, and light that goes deep into a spray becomes
# one: without the second option, scattering in `gdi` takes a sixth longer.
OPTIONS = ("-cl-std=CL1.2", "-cl-denorms-are-zero", "-cl-kernel-arg-info")


@dataclass(frozen=True)
class Compiled:
    """A compiled program of pyopencl, the arguments of its kernels by the kernel's name, and the
    signatures of the kernels that were launched."""

    program: Any
    arguments: Mapping[str, Arguments]
    signatures: dict[str, Signature] = field(default_factory=dict)


# Python's filters of warnings are the whole process's: one thread at a time changes them.
_FILTERS = threading.Lock()


def compiled(device: Device, source: str, options: Sequence[str] = ()) -> Compiled:
    """Compiles a source in OpenCL C, once for a device, with options beside `OPTIONS`."""
    opened, key = device.opened, (source, *options)
    with opened.lock:
        program = opened.programs.get(key)
        if program is None:
            program = _compiled(opened, source, [*OPTIONS, *options])
            opened.programs[key] = program
            _trim_heap()
    return program


def _compiled(opened: Context, source: str, options: list[str]) -> Compiled:
    """Compiles a source, or loads its binary; one process at a time, because PoCL may fail if two
    write the same program at once. Intel's log is never empty, so logs are no warnings."""
    handle = opened.handle
    platform = handle.platform
    made_by = (platform.vendor, platform.name, platform.version, handle.name, handle.driver_version)
    identity = "\0".join((*made_by, *options, source))
    key = hashlib.sha256(identity.encode()).hexdigest()[:32]
    folder = default_cache() / "programs"
    with _locked(folder / f"{key[0]}.lock"), _FILTERS, warnings.catch_warnings():
        warnings.simplefilter("ignore", cl.CompilerWarning)
        if has_src_build_cache(handle):
            check_room(handle)
            return _from_source(opened, source, options)
        path = folder / f"{key}.program"
        program = _loaded(path, opened, options)
        if program is None:
            program = _from_source(opened, source, options)
            with suppress(OSError):  # without room it is compiled again next time
                _keep(path, program)
        return program


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Holds a lock on the file, if the folder allows one, so that one process at a time runs."""
    with ExitStack() as held:
        with suppress(OSError):
            make_folder(path.parent)
            held.enter_context(FileLock(path))
        yield


def _from_source(opened: Context, source: str, options: list[str]) -> Compiled:
    build: Any = cl.Program(opened.opencl, source).build
    program = build(options=options, cache_dir=False)
    return Compiled(
        program,
        {kernel.function_name: _kernel_arguments(kernel) for kernel in program.all_kernels()},
    )


def _kernel_arguments(kernel: Any) -> Arguments:
    """Arguments of a kernel by its compiler; in the source they depend on defines and macros."""
    info, ask = cl.kernel_arg_info, kernel.get_arg_info
    # PoCL's headers rename arguments that have the name of a function of OpenCL C.
    return [
        (ask(number, info.NAME).removeprefix("_cl_"), ask(number, info.TYPE_NAME))
        for number in range(kernel.num_args)
    ]


def _keep(path: Path, built: Compiled) -> None:
    [binary] = built.program.get_info(cl.program_info.BINARIES)
    content = json.dumps(built.arguments).encode() + b"\n" + binary
    write_bytes(path, f"{zlib.crc32(content):08x}\n".encode() + content, sync=False)


def _loaded(path: Path, opened: Context, options: list[str]) -> Compiled | None:
    """The stored program; None if there is none, it is damaged, or the driver rejects it."""
    try:
        check, _, content = path.read_bytes().partition(b"\n")
        if check != f"{zlib.crc32(content):08x}".encode():
            return None
        arguments, _, binary = content.partition(b"\n")
        program = cl.Program(opened.opencl, [opened.handle], [binary]).build(options=options)
    except (OSError, cl.Error):
        return None
    return Compiled(program, json.loads(arguments))


def _trim_heap() -> None:
    """Returns freed memory to the system (glibc): a compiler leaves some hundred megabytes."""
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):  # musl, macOS, Windows
        return
    trim(0)
