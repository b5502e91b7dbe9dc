"""Random words, Sobol points and scattered directions of the kernels, against NumPy and SciPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyopencl as cl
import pytest
from numpy.typing import NDArray
from scipy.stats import qmc

from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.compilation import compiled
from cldit.gpu.device import Device
from cldit.gpu.kernel_source import assemble
from cldit.transport.sobol import BITS, DIMENSIONS, columns
from tests.phase_tables import henyey_greenstein

ULP = float(np.finfo(np.float32).eps)


def _run(
    device: Device,
    body: str,
    inputs: list[NDArray[Any]],
    out: NDArray[Any],
    options: list[str] | None = None,
) -> NDArray[Any]:
    """A kernel whose one line sets out[i] from inputs a, b, ..., which are pointers."""
    types = {"uint32": "uint", "float32": "float", "uint8": "uchar"}
    arguments = "".join(
        f", __global const {types[array.dtype.name]} *{chr(97 + n)}"
        for n, array in enumerate(inputs)
    )
    source = (
        f"{assemble('random.h')}{assemble('phase.h')}\n__kernel void apply("
        f"__global {types[out.dtype.name]} *out{arguments})\n"
        f"{{ const int i = get_global_id(0); {body} }}\n"
    )
    program = compiled(device, source, options or _OPTIONS).program
    buffer = zeros(device, "out", out.size, out.dtype.type)
    buffers = [upload(device, "in", array) for array in inputs]
    cl.Kernel(program, "apply")(device.queue, (len(out),), None, buffer, *buffers)
    return download(device, buffer, out)


_OPTIONS = ["-DPHASE_BINS=1024"]
_PHILOX = "vstore4(philox(vload4(i, a), vload2(i, b)), i, out);"


def test_philox_known_answers(device: Device) -> None:
    """The three vectors that the Random123 library is published with (kat_vectors)."""
    counter = np.array(
        [[0] * 4, [0xFFFFFFFF] * 4, [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344]], np.uint32
    )
    key = np.array([[0, 0], [0xFFFFFFFF] * 2, [0xA4093822, 0x299F31D0]], np.uint32)
    expected = [
        [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8],
        [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD],
        [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
    ]
    got = _run(device, _PHILOX, [counter, key], np.empty((3, 4), np.uint32))
    np.testing.assert_array_equal(got, expected)


def test_units_are_open(device: Device) -> None:
    """Never 0 and never 1: both would be logarithms of 0 somewhere."""
    words = np.array([0, 1, 511, 512, 2**31, 2**32 - 1], np.uint32)
    got = _run(device, "out[i] = unit(a[i]);", [words], np.empty(6, np.float32))
    assert got.min() > 0.0 and got.max() < 1.0
    np.testing.assert_allclose(got, (words >> 9) / 2.0**23, atol=2.0**-23)


def test_sobol_against_scipy(device: Device) -> None:
    """SciPy goes through the points in Gray code order; they are the same points."""
    index = np.arange(2**BITS, dtype=np.uint32)
    expected = qmc.Sobol(DIMENSIONS, scramble=False, bits=30).random(2**BITS)
    got = _run(
        device,
        f"for (int d = 0; d < {DIMENSIONS}; ++d)"
        f" out[{DIMENSIONS} * i + d] = sobol(a[i] ^ (a[i] >> 1), d, b);",
        [index, columns()],
        np.empty((2**BITS, DIMENSIONS), np.uint32),
    )
    np.testing.assert_array_equal(got / 2.0**32, expected)


@pytest.mark.parametrize("g", [-0.5, 0.0, 0.85])
def test_phase_cosine_against_numpy(device: Device, g: float) -> None:
    """Bin bounds and shares are single precision: a cosine errs by that, over the density."""
    phase = henyey_greenstein(g)
    table = phase.to_sample().astype(np.float32)
    u = np.linspace(1e-6, 1 - 1e-6, 4001).astype(np.float32)
    got = _run(device, "out[i] = phase_cosine(a[i], b);", [u, table], np.empty(len(u), np.float32))
    expected = np.interp(u.astype(float), phase.cumulative, phase.cosine)
    slope = 1 / phase.density[np.clip(np.searchsorted(-phase.cosine, -expected) - 1, 0, 1023)]
    assert np.all(np.abs(got - expected) <= 4 * ULP * (1 + 1.1 * slope))


def test_class_by_its_share(device: Device) -> None:
    """A number draws each of four classes as often as the bytes say, one of none never; the rest of
    it is even again: its mean within what steps of 1 / 255 of the numbers leave."""
    ends = np.array([[51, 0, 255], [51, 0, 255], [153, 128, 255]], np.uint8)  # a column a cell
    count = 255 * 200
    u = ((np.arange(count) + 0.5) / count).astype(np.float32)
    options = [*_OPTIONS, "-DPHASE_CLASSES=4"]
    body = "real u = a[i]; out[2 * i] = phase_class(&u, b + CELL, 3); out[2 * i + 1] = u;"
    shares = [[51, 0, 102, 102], [0, 0, 128, 127], [255, 0, 0, 0]]
    for cell, expected in enumerate(shares):
        got = _run(
            device,
            body.replace("CELL", str(cell)),
            [u, ends],
            np.empty((count, 2), np.float32),
            options,
        )
        found = np.bincount(got[:, 0].astype(int), minlength=4)
        np.testing.assert_allclose(found, np.multiply(expected, 200), atol=1)
        for number in np.flatnonzero(expected):
            rest = np.sort(got[got[:, 0] == number, 1])
            even = (np.arange(len(rest)) + 0.5) / len(rest)
            np.testing.assert_allclose(rest, even, atol=2 / len(rest) + 8 * ULP * 255)


def test_on_circle(device: Device) -> None:
    """Cosine and sine of a turn, also where quarters meet."""
    u = np.concatenate([np.linspace(0, 1, 4001), np.arange(9) / 8]).astype(np.float32)
    got = _run(device, "vstore2(on_circle(a[i]), i, out);", [u], np.empty((len(u), 2), np.float32))
    angle = 2 * np.pi * u.astype(float)
    np.testing.assert_allclose(got[:, 0], np.cos(angle), rtol=0, atol=1.5e-7)
    np.testing.assert_allclose(got[:, 1], np.sin(angle), rtol=0, atol=1.5e-7)


def test_scattered_directions(device: Device) -> None:
    """At the angle asked for, of length one, and all round: also from directions along axes."""
    rng = np.random.default_rng(2)
    d = rng.normal(size=(4000, 3))
    d[:6] = np.concatenate([np.eye(3), -np.eye(3)])
    d = (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)
    cosine = rng.uniform(-1, 1, 4000).astype(np.float32)
    turn = rng.random(4000).astype(np.float32)
    got = _run(
        device,
        "vstore3(turned(vload3(i, a), b[i], c[i]), i, out);",
        [d, cosine, turn],
        np.empty((4000, 3), np.float32),
    ).astype(float)
    np.testing.assert_allclose(np.linalg.norm(got, axis=1), 1.0, atol=4 * ULP)
    np.testing.assert_allclose(np.sum(got * d, axis=1), cosine, atol=8 * ULP)
    # Mean of what lies across d vanishes: 4000 vectors of length below 1, five standard errors.
    across = got - cosine[:, None] * d
    assert np.all(np.abs(across.mean(axis=0)) < 5 / 4000**0.5)
