"""A processor that PoCL's compiler does not know gets the name of one that it knows."""

from __future__ import annotations

import ctypes
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from cldit.gpu.pocl import instruction_sets, like_processor, mistaken_for, name_processor

HASWELL = frozenset("sse2 avx2 fma bmi1 bmi2 f16c movbe avx popcnt pclmulqdq sse4_2".split())
needs_linux = pytest.mark.skipif(sys.platform != "linux", reason="PoCL's record is read on Linux")


def _device(*texts: bytes) -> tuple[Any, Any]:
    """A record of pointers to texts, as PoCL's of a device; the device and the record."""
    record = (ctypes.c_char_p * 512)()
    for place, text in enumerate(texts, 10):
        record[place] = text
    numbers = ctypes.cast(record, ctypes.POINTER(ctypes.c_uint64))
    numbers[400], numbers[401] = 0xDEAD_BEEF_0000, (1 << 64) - 1  # lead nowhere
    version = "OpenCL 3.0 PoCL HSTR: pthread-x86_64-unknown-linux-gnu-generic "
    return SimpleNamespace(int_ptr=ctypes.addressof(record), version=version), record


def test_no_instruction_is_taken_for_granted() -> None:
    assert like_processor(HASWELL) == b"haswell"
    assert like_processor(HASWELL - {"fma"}) == b"sandybridge"
    assert like_processor(frozenset({"sse2"})) == b"x86-64"
    assert like_processor(frozenset({"neon"})) is None


@needs_linux
def test_the_name_in_the_record_is_replaced() -> None:
    device, record = _device(b"generic", b"x86_64-unknown-linux-gnu", b"generic", b"3.0")
    flags = instruction_sets()
    assert name_processor(device, b"generic", flags)
    name = record[12]
    assert name == like_processor(flags)
    assert name not in (b"generic", b"", None)
    assert record[10:14] == [b"generic", b"x86_64-unknown-linux-gnu", name, b"3.0"]
    assert not name_processor(device, b"generic", flags)  # done already


@needs_linux
@pytest.mark.parametrize(
    "texts", [(b"x86_64-unknown-linux-gnu", b"znver3"), (b"linux-musl", b"generic")]
)
def test_a_record_that_is_not_understood_is_left_alone(texts: tuple[bytes, ...]) -> None:
    device, record = _device(*texts)
    assert not name_processor(device, b"generic", instruction_sets())
    assert record[10:12] == list(texts)


def test_only_pocl_of_an_unknown_processor_is_touched() -> None:
    """One that it has no name for; and Zen 4, which it takes for Zen 3, by its AVX-512."""

    def name(platform: str, version: str, flags: frozenset[str] = HASWELL) -> bytes | None:
        device = SimpleNamespace(version=version)
        return mistaken_for(SimpleNamespace(name=platform), device, flags)

    pocl = "Portable Computing Language"
    linux = "OpenCL 3.0 PoCL HSTR: pthread-x86_64-unknown-linux-gnu-"
    zen_4 = HASWELL | frozenset("adx avx512f avx512bw avx512cd avx512dq avx512vl".split())
    assert name(pocl, linux + "generic ") == b"generic"
    assert name(pocl, linux + "znver3", zen_4) == b"znver3"
    assert name(pocl, linux + "znver3") is None
    assert name(pocl, linux + "icelake-client", zen_4) is None
    assert name("NVIDIA CUDA", "OpenCL 3.0 CUDA-generic") is None
    assert like_processor(zen_4) == b"skylake-avx512"
