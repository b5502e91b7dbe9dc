"""A processor that PoCL's compiler does not know gets the name of one that it knows."""

from __future__ import annotations

import ctypes
import sys
from types import SimpleNamespace
from typing import Any

import pytest

from cldit.gpu.pocl import known_to_pocl, like_processor, name_processor

HASWELL = frozenset("sse2 avx2 fma bmi1 bmi2 f16c movbe avx popcnt pclmulqdq sse4_2".split())
needs_linux = pytest.mark.skipif(sys.platform != "linux", reason="PoCL's record is read on Linux")


def _device(*texts: bytes) -> tuple[Any, Any, list[Any]]:
    """A record of pointers to texts, as PoCL's of a device; the device, the record, the texts."""
    kept = [ctypes.create_string_buffer(text) for text in texts]
    record = (ctypes.c_void_p * 512)()
    for place, text in enumerate(kept):
        record[10 + 3 * place] = ctypes.addressof(text)
    record[400] = 0xDEAD_BEEF_0000  # leads nowhere
    record[401] = (1 << 64) - 1
    return SimpleNamespace(int_ptr=ctypes.addressof(record)), record, kept


def test_no_instruction_is_taken_for_granted() -> None:
    assert like_processor(HASWELL) == b"haswell"
    assert like_processor(HASWELL - {"fma"}) == b"sandybridge"
    assert like_processor(frozenset({"sse2"})) == b"x86-64"
    assert like_processor(frozenset({"neon"})) is None


@needs_linux
def test_the_name_in_the_record_is_replaced() -> None:
    device, record, _kept = _device(b"pthread", b"generic", b"3.0")
    assert name_processor(device)
    name = ctypes.string_at(record[13])
    assert name not in (b"generic", b"")
    assert [ctypes.string_at(record[at]) for at in (10, 16)] == [b"pthread", b"3.0"]
    assert not name_processor(device)  # done already


@needs_linux
@pytest.mark.parametrize("texts", [(b"haswell",), (b"generic", b"generic")])
def test_a_record_that_is_not_understood_is_left_alone(texts: tuple[bytes, ...]) -> None:
    device, record, kept = _device(*texts)
    assert not name_processor(device)
    assert [record[10 + 3 * n] for n in range(len(kept))] == [ctypes.addressof(t) for t in kept]


def test_only_pocl_of_an_unknown_processor_is_touched() -> None:
    def known(platform: str, version: str) -> bool:
        return known_to_pocl(SimpleNamespace(name=platform), SimpleNamespace(version=version))

    pocl = "Portable Computing Language"
    assert not known(pocl, "OpenCL 3.0 PoCL HSTR: pthread-x86_64-unknown-linux-gnu-generic ")
    assert known(pocl, "OpenCL 3.0 PoCL HSTR: pthread-x86_64-unknown-linux-gnu-znver3")
    assert known("NVIDIA CUDA", "OpenCL 3.0 CUDA-generic")
