"""PoCL on processors that are newer than it.

The PoCL that pip installs is of 2022, with LLVM 14. Where that does not know the processor (AMD's
family 26, Zen 5, say) it calls it `generic`, a name that its own compiler then refuses: nothing can
be built (github.com/pocl/pocl/issues/1049). Zen 4, of Zen 3's family, it takes for that, which has
no AVX-512: a trace of `gdi` takes a tenth longer. No setting of PoCL's helps. What such a processor
can do is known, so it is given the name of another that can do no more.
"""

from __future__ import annotations

import ctypes
import itertools
import os
import struct
from pathlib import Path
from typing import Any

from cldit.io.caches import pocl_cache, probe
from cldit.io.files import written

_PLATFORM = "Portable Computing Language"
_ROOM_BYTES = 1_000_000  # that compiling a program may need; the largest takes 200,000
_LOOKED_AT = 2048  # bytes of PoCL's record of a device, in which the name is pointed to
_POINTER = struct.Struct("@P")

_AVX512 = frozenset("avx512f avx512bw avx512cd avx512dq avx512vl avx2 fma bmi2 f16c adx".split())

# Instruction sets, as Linux names them, of processors that LLVM 14 knows: the best first.
_KNOWN: tuple[tuple[bytes, frozenset[str]], ...] = (
    (b"skylake-avx512", _AVX512),
    (b"haswell", frozenset("avx2 fma bmi1 bmi2 f16c movbe".split())),
    (b"sandybridge", frozenset("avx popcnt pclmulqdq sse4_2".split())),
    (b"x86-64", frozenset({"sse2"})),
)


# Names that it gives to processors that it does not know, if they have these.
_MISTAKEN: dict[bytes, frozenset[str]] = {b"generic": frozenset(), b"znver3": _AVX512}


def check_room(device: Any) -> None:
    """Refuses a cache of PoCL without room: its compiler would end the process there.

    Raises:
        FileError: names the folder; as `written`.
    """
    if device.platform.name.strip() == _PLATFORM:
        with written(pocl_cache(), needed_bytes=_ROOM_BYTES):
            probe(pocl_cache(), _ROOM_BYTES)


def like_processor(flags: frozenset[str]) -> bytes | None:
    """The best processor known to LLVM 14 that has no instructions beyond `flags`."""
    return next((name for name, needs in _KNOWN if needs <= flags), None)


def mistaken_for(platform: Any, device: Any, flags: frozenset[str]) -> bytes | None:
    """PoCL's name of the processor, at the end of the device's version, where it is mistaken.

    Args:
        platform, device: pyopencl's.
        flags: instruction sets of the processor.

    Returns:
        The name; None where it is right, or the device is not PoCL's.
    """
    name = device.version.strip().rpartition("-")[2].encode()
    mistaken = platform.name.strip() == _PLATFORM and name in _MISTAKEN
    return name if mistaken and _MISTAKEN[name] <= flags else None


def name_processor(device: Any, mistaken: bytes, flags: frozenset[str]) -> bytes | None:
    """Gives PoCL's record of a device the name of a processor with no more than these instructions.

    The record points to the target's triple and then to the processor's name; the device's version
    ends with both. Memory is read through /proc, where a wrong address is an error and no crash.

    Args:
        device: pyopencl's.
        mistaken: the present name, see `mistaken_for`.
        flags: instruction sets of the processor.

    Returns:
        The new name; None where it could not be set.
    """
    name = like_processor(flags)
    if name is None:
        return None
    try:
        memory = os.open("/proc/self/mem", os.O_RDWR)
    except OSError:
        return None
    try:
        record = os.pread(memory, _LOOKED_AT, device.int_ptr)
        texts = [_text_at(memory, address) for (address,) in _POINTER.iter_unpack(record)]
        version = device.version.strip().encode()
        place = next(
            place
            for place, (before, here) in enumerate(itertools.pairwise(texts), 1)
            if here == mistaken and before and version.endswith(b"-" + before + b"-" + mistaken)
        )
        text = ctypes.create_string_buffer(name)
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(text))  # PoCL reads it as long as it lives
        where = device.int_ptr + place * _POINTER.size
        os.pwrite(memory, _POINTER.pack(ctypes.addressof(text)), where)
    except (OSError, StopIteration):
        return None
    finally:
        os.close(memory)
    return name


def _text_at(memory: int, address: int) -> bytes | None:
    try:
        return os.pread(memory, 64, address).split(b"\0")[0] if address > 0 else None
    except (OSError, OverflowError):
        return None  # no pointer, then


def instruction_sets(cpuinfo: Path = Path("/proc/cpuinfo")) -> frozenset[str]:
    """Instruction sets of an x86 processor, as Linux lists them; none on other systems."""
    try:
        with cpuinfo.open() as lines:  # no further than the first core's
            line = next((line for line in lines if line.startswith("flags")), "")
    except OSError:
        return frozenset()
    return frozenset(line.partition(":")[2].split())
