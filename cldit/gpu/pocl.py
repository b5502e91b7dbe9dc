"""Two workarounds for PoCL: processors that are newer than it, and a cache without room.

The PoCL that pip installs is of 2022, with LLVM 14. A processor that LLVM does not know (AMD's
family 26, Zen 5) is called `generic`, a name that PoCL's compiler then rejects, so that nothing can
be built (github.com/pocl/pocl/issues/1049). Zen 4 is taken for Zen 3, which has no AVX-512: a trace
of `gdi` takes a tenth longer. No setting of PoCL helps. The instruction sets of the processor are
known, so it is given the name of another with no more than these.
"""

import ctypes
import itertools
import os
import struct
from pathlib import Path
from typing import Any

from cldit.io.caches import pocl_cache, probe
from cldit.io.files import written

_PLATFORM = "Portable Computing Language"
_ROOM_BYTES = 1_000_000  # for one compilation; the largest program takes 200,000
_RECORD_BYTES = 2048  # of PoCL's record of a device that are searched for a pointer to the name
_POINTER = struct.Struct("@P")

_AVX512 = frozenset("avx512f avx512bw avx512cd avx512dq avx512vl avx2 fma bmi2 f16c adx".split())

# Instruction sets, by Linux's names, of processors that LLVM 14 knows, the best first.
_KNOWN: tuple[tuple[bytes, frozenset[str]], ...] = (
    (b"skylake-avx512", _AVX512),
    (b"haswell", frozenset("avx2 fma bmi1 bmi2 f16c movbe".split())),
    (b"sandybridge", frozenset("avx popcnt pclmulqdq sse4_2".split())),
    (b"x86-64", frozenset({"sse2"})),
)

# Wrong names that PoCL gives to processors with these instruction sets.
_MISTAKEN: dict[bytes, frozenset[str]] = {b"generic": frozenset(), b"znver3": _AVX512}


def check_room(device: Any) -> None:
    """Raises FileError if PoCL's cache has no room: its compiler would abort the process."""
    if device.platform.name.strip() == _PLATFORM:
        with written(pocl_cache(), needed_bytes=_ROOM_BYTES):
            probe(pocl_cache(), _ROOM_BYTES)


def like_processor(flags: frozenset[str]) -> bytes | None:
    """The best processor known to LLVM 14 that has no instruction sets beyond `flags`."""
    return next((name for name, needs in _KNOWN if needs <= flags), None)


def mistaken_for(platform: Any, device: Any, flags: frozenset[str]) -> bytes | None:
    """PoCL's name of the processor, which ends the device's version, if it is wrong; else None.

    platform, device: pyopencl's. flags: instruction sets of the processor.
    """
    name = device.version.strip().rpartition("-")[2].encode()
    mistaken = platform.name.strip() == _PLATFORM and name in _MISTAKEN
    return name if mistaken and _MISTAKEN[name] <= flags else None


def name_processor(device: Any, mistaken: bytes, flags: frozenset[str]) -> bytes | None:
    """Renames the processor in PoCL's record of a device, and gives the new name; None on failure.

    The record contains pointers to the target's triple and then to the processor's name; the
    device's version ends with both. Memory is read through /proc, where a wrong address is an error
    instead of a crash.

    device: pyopencl's. mistaken: the present name. flags: instruction sets of the processor.
    """
    name = like_processor(flags)
    if name is None:
        return None
    try:
        memory = os.open("/proc/self/mem", os.O_RDWR)
    except OSError:
        return None
    try:
        record = os.pread(memory, _RECORD_BYTES, device.int_ptr)
        texts = [_text_at(memory, address) for (address,) in _POINTER.iter_unpack(record)]
        version = device.version.strip().encode()
        place = next(
            place
            for place, (triple, processor) in enumerate(itertools.pairwise(texts), 1)
            if processor == mistaken
            and triple
            and version.endswith(b"-" + triple + b"-" + mistaken)
        )
        buffer = ctypes.create_string_buffer(name)
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(buffer))  # PoCL reads it until the process ends
        where = device.int_ptr + place * _POINTER.size
        os.pwrite(memory, _POINTER.pack(ctypes.addressof(buffer)), where)
    except (OSError, StopIteration):
        return None
    finally:
        os.close(memory)
    return name


def _text_at(memory: int, address: int) -> bytes | None:
    try:
        return os.pread(memory, 64, address).split(b"\0")[0] if address > 0 else None
    except (OSError, OverflowError):
        return None  # not a pointer


def instruction_sets(cpuinfo: Path = Path("/proc/cpuinfo")) -> frozenset[str]:
    """Instruction sets of an x86 processor by Linux's names; none on other systems."""
    try:
        with cpuinfo.open() as lines:  # read up to the first core's only
            line = next((line for line in lines if line.startswith("flags")), "")
    except OSError:
        return frozenset()
    return frozenset(line.partition(":")[2].split())
