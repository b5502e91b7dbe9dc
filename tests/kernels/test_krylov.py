"""Kernels of the Krylov space against NumPy's Gram-Schmidt in double precision."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyopencl as cl
import pytest
from numpy.typing import NDArray

from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.device import Device
from cldit.gpu.program import build
from cldit.transport.discrete_ordinates.krylov import KrylovSpace
from cldit.transport.discrete_ordinates.scattering_cells import ScatteringCells

PARTS = 4
DEFINES: dict[str, Any] = {"HAS_SCATTERING": 1, "EMITTERS": 2}


def space_of(device: Device, count: int, vector: int) -> tuple[KrylovSpace, ScatteringCells]:
    program = build(device, "source_update.cl", {**DEFINES, "SIMD_WIDTH": vector})
    source = zeros(device, "list", PARTS * count, np.float32)
    cells = ScatteringCells(device, program, PARTS, count, np.float32, source)
    return KrylovSpace(cells, np.linspace(0, 1, count)), cells


def multiply(
    device: Device, space: KrylovSpace, cells: ScatteringCells, image: NDArray[np.floating], n: int
) -> None:
    """Makes `image` the residual of a sweep: without scattering it is the source, with the sign of
    a coalbedo of -1. It gets its products with n vectors."""
    count = cells.count
    cl.enqueue_copy(device.queue, cells.source, np.ascontiguousarray(image, np.float32))
    one, none = np.ones(count, np.float32), np.zeros((PARTS, count), np.float32)
    space.residual(
        space.image if n else space.left,
        number=n,
        i_minus_s=upload(device, "I - S", none),
        emission=upload(device, "emission", none),
        albedo=upload(device, "albedo", one),
        coalbedo=upload(device, "coalbedo", -one),
        one_minus_lambda=upload(device, "1 - Lambda*", one),
        shine=0.0,
    )


def rms(values: NDArray[np.floating]) -> NDArray[np.float64]:
    return np.asarray(np.sqrt(np.mean(np.square(values, dtype=np.float64), axis=-1)))


@pytest.mark.parametrize("vector", [1, 8])
@pytest.mark.parametrize("count", [5, 3001])
def test_a_krylov_space_is_numpys(device: Device, vector: int, count: int) -> None:
    """More vectors than the space has room for at first, or in few cells as many as they span,
    that are almost parallel: all of them beside the first differ from it by 1e-3."""
    rng = np.random.default_rng(1)
    number = min(count - 1, 16)
    space, cells = space_of(device, count, vector)
    residual = rng.normal(size=(PARTS, count)).astype(np.float32)
    residual[1] = 0.0  # a component without a residual has vectors of 0
    multiply(device, space, cells, residual, 0)
    start, peak, source = space.measured()
    np.testing.assert_allclose(start, rms(residual), rtol=1e-6)
    np.testing.assert_array_equal(source, start)
    assert peak == pytest.approx(np.abs(residual * np.linspace(0, 1, count)).max(), rel=1e-6)
    space.begin()
    live = np.array([0, 2, 3])
    basis = [residual[live] / rms(residual[live])[:, None]]
    for n in range(1, number):
        image = (residual + 1e-3 * rng.normal(size=residual.shape)).astype(np.float32)
        image[1] = 0.0
        multiply(device, space, cells, image, n)
        products, length = space.extend(n)
        rest = image[live].astype(np.float64)
        expected = np.zeros((n, len(live)))
        for _ in range(2):
            for i, own in enumerate(basis):
                along = np.mean(own * rest, axis=1)
                expected[i] += along
                rest = rest - along[:, None] * own
        # Single precision: some roundings of numbers up to 4 in a mean.
        np.testing.assert_allclose(products[:, live], expected, atol=3e-6)
        np.testing.assert_allclose(length[live], rms(rest), rtol=3e-3)
        assert not products[:, 1].any() and length[1] == 0.0
        now = download(device, cells.source, np.empty((PARTS, count), np.float32))
        assert not now[1].any()
        # Rounding of the image, 6e-8 of it, over what is left of it, 1e-3 or less in few cells.
        np.testing.assert_allclose(now[live], rest / rms(rest)[:, None], atol=4e-3)
        basis.append(now[live].astype(np.float64))
        gram = np.mean(np.stack(basis)[:, None] * np.stack(basis)[None], axis=-1)
        np.testing.assert_allclose(gram, np.eye(n + 1)[..., None] + 0 * gram, atol=2e-6)

    factors = rng.normal(size=(2, number, PARTS))
    after, peak = space.add(factors)
    every = np.zeros((number, PARTS, count))
    every[:, live] = basis
    onto, left = (np.einsum("kc,kcn->cn", each, every) for each in factors)
    np.testing.assert_allclose(space.read(space.onto), onto, atol=1e-5)
    np.testing.assert_allclose(space.read(space.left), residual + left, atol=1e-5)
    np.testing.assert_allclose(after, rms(residual + left), rtol=1e-5)
    assert peak == pytest.approx(
        np.abs((residual + left) * np.linspace(0, 1, count)).max(), rel=1e-5
    )


@pytest.mark.parametrize("vector", [1, 8])
def test_sums_repeat_to_the_last_bit(device: Device, vector: int) -> None:
    values = np.random.default_rng(2).normal(size=(PARTS, 9999))
    results = []
    for _ in range(4):
        space, cells = space_of(device, 9999, vector)
        multiply(device, space, cells, values, 0)
        sizes = space.measured()
        space.begin()
        multiply(device, space, cells, np.roll(values, 7, axis=1), 1)
        results.append((*sizes, *space.extend(1), space.read(space.image)))
    for other in results[1:]:
        for ours, theirs in zip(results[0], other, strict=True):
            np.testing.assert_array_equal(ours, theirs)
