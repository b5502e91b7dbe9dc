"""Krylov space of GMRES on the device: vectors of all components, and sums over their cells.

Products are means over the cells, so a vector has an RMS of 1. Only sums reach the host: a few
numbers for each vector, once an iteration (kernels/source_update.cl).
"""

from typing import Any

import numpy as np
import pyopencl as cl

from cldit.arrays import Floats, Reals
from cldit.gpu.buffers import download, unset, upload, zeros
from cldit.transport.discrete_ordinates.scattering_cells import ScatteringCells

SLICES = 32  # of a sum, as in source_update.cl
_LANES = 64  # work-items for a slice with SIMD_WIDTH 1
_ROOM = 13  # vectors, at first
_FIRST = 3  # blocks of sums before those of the vectors, as in source_update.cl
_PASSES = 2  # of Gram-Schmidt: the second removes the rounding of the first


class KrylovSpace:
    """Vectors (C, N) on the device, and the sums from which they follow.

    left: residual that is left. onto: sum of all corrections. image: the vector
    that is orthogonalised next. A component of each has `stride` numbers, whole packets.
    """

    def __init__(self, cells: ScatteringCells, opacity: Reals) -> None:
        """Vectors of the listed cells; `opacity` (N,) weights residuals for `measured`."""
        self._cells = cells
        self.stride = cells.stride
        self._size = cells.components * self.stride
        self.left, self.onto, self.image = (self._unused(1) for _ in range(3))
        padded = np.pad(opacity, (0, self.stride - cells.count)).astype(cells.real)
        self._opacity = upload(cells.device, "opacity", padded)
        self._resize(_ROOM)

    def _unused(self, vectors: int) -> Any:
        return zeros(self._cells.device, "vectors", vectors * self._size, self._cells.real)

    def _resize(self, vectors: int) -> None:
        kept = getattr(self, "_vectors", None)
        self._room, self._vectors = vectors, self._unused(vectors)
        if kept is not None:
            cl.enqueue_copy(self._cells.device.queue, self._vectors, kept, byte_count=kept.size)
        blocks = _FIRST + _PASSES * vectors
        sums = blocks * self._cells.components * SLICES
        self._sums = unset(self._cells.device, "sums", sums, self._cells.real)

    def _run(self, kernel: str, **arguments: Any) -> None:
        """Runs a kernel on all slices of all components."""
        lanes = _LANES if self._cells.kernels.defines["SIMD_WIDTH"] == 1 else 1
        size = (SLICES * lanes, self._cells.components)
        arguments |= {"vectors": self._vectors, "sums": self._sums, "stride": self.stride}
        self._cells.kernels.launch(kernel, size, (lanes, 1), arguments)

    def _read_sums(self, blocks: int) -> Reals:
        out = np.empty((blocks, self._cells.components, SLICES), self._cells.real)
        return download(self._cells.device, self._sums, out)

    def read(self, vector: Any) -> Reals:
        """Downloads a vector (C, N)."""
        out = np.empty((self._cells.components, self.stride), self._cells.real)
        out = download(self._cells.device, vector, out)[:, : self._cells.count]
        return np.ascontiguousarray(out)

    def copied(self, vector: Any) -> Any:
        """Copy of a vector."""
        out = self._unused(1)
        cl.enqueue_copy(self._cells.device.queue, out, vector)
        return out

    def add(self, factors: Floats) -> tuple[Floats, float]:
        """Adds vectors to `onto` and `left`; `factors` (2, K, C) of the first K vectors for each.

        Returns:
            RMS (C,) of `left`, and its largest magnitude times the opacity.
        """
        self._run(
            "combine",
            onto=self.onto,
            left=self.left,
            factors=upload(self._cells.device, "factors", factors.astype(self._cells.real)),
            opacity=self._opacity,
            number=factors.shape[1],
        )
        squares, peaks = self._read_sums(2)
        return self._rms(squares), float(peaks.max())

    def residual(self, out: Any, *, number: int, **arguments: Any) -> None:
        """Writes the residual of a sweep to `out`; multiplies it with the first `number` vectors.

        `arguments` are further ones of the kernel.
        """
        if number == self._room:
            self._resize(2 * self._room)
        cells = self._cells
        arguments |= {"opacity": self._opacity, "listed": cells.source, "count": cells.count}
        self._run("residual", out=out, number=number, **arguments)

    def measured(self) -> tuple[Floats, float, Floats]:
        """RMS (C,) of the residual, with `number` 0, its largest magnitude times the opacity, and
        RMS (C,) of the source."""
        squares, peaks, sources = self._read_sums(_FIRST)
        return self._rms(squares), float(peaks.max()), self._rms(sources)

    def begin(self) -> None:
        """Makes the measured residual, normalised, vector 0 and the present source."""
        self._normalise(self.left, 0)

    def extend(self, number: int) -> tuple[Floats, Floats]:
        """Orthogonalises `image` to the first `number` vectors and makes it the next one.

        It is the present source as well, and has its products with the vectors, see `residual`.
        Returns these (`number`, C), and the RMS (C,) of the rest.
        """
        arguments = {"image": self.image, "number": number, "count": self._cells.count}
        for again in range(_PASSES):
            self._run("orthogonalise", again=again, **arguments)
        self._normalise(self.image, number)
        sums = self._read_sums(_FIRST + _PASSES * number)
        group_sums = sums[_FIRST:].reshape(number, -1, *sums.shape[1:])
        products = group_sums.sum(axis=(1, 3), dtype=np.float64)
        return products / self._cells.count, self._rms(sums[0])

    def _rms(self, squares: Reals) -> Floats:
        total = squares.sum(axis=1, dtype=np.float64)
        return np.asarray(np.sqrt(total / self._cells.count))

    def _normalise(self, image: Any, number: int) -> None:
        self._run(
            "normalise",
            listed=self._cells.source,
            image=image,
            number=number,
            count=self._cells.count,
        )
