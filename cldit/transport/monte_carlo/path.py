"""Monte Carlo path tracing, the method `path`: batches of paths until the wanted error.

This is backward Monte Carlo (Modest, Radiative Heat Transfer, ch. 21; kernels/path.cl). Every batch
is a low-discrepancy set with its own random shift (randomised quasi-Monte Carlo), so that the
scatter of batches is an unbiased estimate of the image's error.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.arrays import Floats, Reals
from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.device import Device, shares
from cldit.gpu.program import Define, Program, build
from cldit.transport.cell_phases import class_shares
from cldit.transport.energy_balance import EnergyBalance
from cldit.transport.monte_carlo.pixel_sampling import PixelSample
from cldit.transport.result import Trace, TraceInput, weights_of
from cldit.transport.sobol import columns
from cldit.transport.view import upload_medium

SAMPLES = 32  # of a batch: larger sets converge faster, more batches estimate their error better
_GROUP = 16


@dataclass
class _BatchSums:
    """Sums of the means (C, N) of even and of odd batches."""

    halves: tuple[Floats, Floats]
    batches: int = 0

    def add(self, means: Floats) -> None:
        self.halves[self.batches % 2][:] += means
        self.batches += 1

    @property
    def mean(self) -> Floats:
        return (self.halves[0] + self.halves[1]) / self.batches

    @property
    def difference(self) -> Floats:
        """Half the difference of the means of even and of odd batches, equal in number."""
        return (self.halves[0] - self.halves[1]) / self.batches


@dataclass(frozen=True)
class _PathTracer:
    """A device and the pixels whose paths it traces."""

    device: Device
    program: Program
    count: int
    out: Any
    arguments: dict[str, Any]

    @classmethod
    def of(
        cls,
        device: Device,
        program: Program,
        *,
        pixels: NDArray[np.int32],
        scattered: Reals,
        fixed: dict[str, Any],
        components: int,
    ) -> "_PathTracer":
        """Uploads the pixels' share of `scattered`; `fixed` are arguments that all pixels share."""
        return cls(
            device,
            program,
            len(pixels),
            zeros(device, "means", components * len(pixels), scattered.dtype.type),
            {
                "list": upload(device, "pixels", pixels),
                "scattered": upload(device, "scattered light", scattered[pixels]),
                **fixed,
            },
        )

    def launch(self, seed: int, batch: int) -> None:
        """Starts a batch and does not wait for it."""
        self.program.launch(
            "scatter",
            (self.count,),
            (min(_GROUP, self.program.largest_group("scatter")),),
            {
                "means": self.out,
                "count": self.count,
                "key": np.array([seed, 0], np.uint32),
                "batch": batch,
                **self.arguments,
            },
        )
        self.device.queue.flush()

    def means(self, components: int, real: type[np.floating]) -> Reals:
        """Waits for the means (C, N) of the batch."""
        return download(self.device, self.out, np.empty((components, self.count), real))


def trace_path(
    given: TraceInput,
    report: Callable[[str], None] | None,
    *,
    draw: Callable[[Floats], PixelSample] | None = None,
    enough: Callable[[PixelSample, Floats, Floats], bool] | None = None,
) -> Trace:
    """Weights by path tracing; raises as `trace`.

    draw: chooses the pixels to trace from the light scattered on the line of sight of each (P,).
    Images then are one row of these pixels, and the noise is theirs. enough: ends the trace if
    true, in place of the noise; receives the drawn pixels, their weights (C, N), and half the
    difference of two halves of the samples.
    """
    cells, view, device, settings = given.cells, given.view, given.device, given.settings
    given.check_boundary()
    real = settings.real
    defines: dict[str, Define] = {
        **given.defines,
        "CUTOFF": replace(settings, cutoff=None).ending(cells, given.scene),
        "ROULETTE": f"R({settings.tuning.path_roulette})",
        "SAMPLES": SAMPLES,
    }
    if settings.order is not None:
        defines["ORDER"] = settings.order
    table = np.zeros(1, real)
    if settings.phase is not None:
        defines["PHASE_BINS"] = settings.phase.bins
        tables = settings.phase.tables
        table = np.concatenate([one.to_sample() for one in tables]).astype(real)
        if len(tables) > 1:
            defines["PHASE_CLASSES"] = len(tables)
    classes = class_shares(cells, settings.phase)
    programs = [build(one, "path.cl", defines) for one in (device, *device.others)]
    start = time.perf_counter()
    components = len(cells.needs.components) + 1  # the last: from within, see energy_balance.py
    column_count, row_count = view.pixels
    pixels = column_count * row_count

    def medium(one: Device) -> dict[str, Any]:
        shared = {} if classes is None else {"shares": upload(one, "size classes", classes)}
        whole = upload_medium(one, cells, view, real, linear=settings.linear_coefficients)
        return {**whole, **shared}

    first = medium(device)
    out = zeros(device, "image", components * pixels, real)
    all_scattered = zeros(device, "scattered light", pixels, real)
    programs[0].launch(
        "straight",
        *view.tiles(programs[0], "straight"),
        {"weights": out, "scattered": all_scattered, **first},
    )
    image = download(device, out, np.empty((components, pixels), real))
    scattered = download(device, all_scattered, np.empty(pixels, real))
    listed = np.flatnonzero(scattered > 0)
    shape = (components, row_count, column_count)
    pixel_sample = None if draw is None else draw(scattered.astype(np.float64))
    if pixel_sample is not None:
        listed = pixel_sample.pixels
        image, shape = image[:, listed], (components, 1, len(listed))
    image = image.astype(np.float64)
    place = listed if pixel_sample is None else np.arange(len(listed))  # in the image
    seconds = {"image": time.perf_counter() - start}

    start = time.perf_counter()
    count = len(listed)
    tracers = [
        _PathTracer.of(
            one,
            program,
            pixels=listed[mine.start : mine.stop].astype(np.int32),
            scattered=scattered,
            fixed={
                "table": upload(one, "phase function", table),
                "sobol_columns": upload(one, "Sobol", columns()),
                **(first if one is device else medium(one)),
            },
            components=components,
        )
        for program, (one, mine) in zip(programs, shares(device, count), strict=True)
        if mine
    ]
    before = view.on_background(listed)
    rest = np.delete(np.arange(image.shape[1]), place)  # empty if pixels were drawn
    other = int(np.count_nonzero(view.has_temperature(1.0 - image[0, rest], rest)))
    even, odd = np.zeros((2, components, count))
    sums = _BatchSums((even, odd))
    temperature = given.temperature
    while count:
        for tracer in tracers:
            tracer.launch(settings.seed, sums.batches)
        means = [tracer.means(components, real) for tracer in tracers]
        sums.add(np.concatenate(means, axis=1).astype(np.float64))
        if sums.batches % 2 or sums.batches < settings.tuning.batches:
            continue
        if pixel_sample is not None and enough is not None:
            found = (image[:, place] + sums.mean)[:-1]
            done = enough(pixel_sample, found, sums.difference[:-1])
            if done or sums.batches * SAMPLES >= settings.max_samples:
                break
            continue
        error_K = temperature.error_K((image[:, place] + sums.mean)[:-1], sums.difference[:-1])
        error_K = error_K[np.isfinite(error_K) & before]
        error = float(np.sqrt(np.sum(error_K**2) / max(len(error_K) + other, 1)))
        if report is not None:
            report(f"{sums.batches * SAMPLES} samples per pixel: error {error:.2g} K")
        if error <= settings.accuracy_K or sums.batches * SAMPLES >= settings.max_samples:
            break
    seconds["scattering"] = time.perf_counter() - start
    difference = np.zeros_like(image)
    if count:
        image[:, place] += sums.mean
        difference[:, place] = sums.difference
    planes = image.reshape(shape)
    closure = None
    if planes.size:  # else no pixel was drawn
        paths = count * sums.batches * SAMPLES
        closure = EnergyBalance.of(
            planes[: cells.needs.boundaries],
            planes[-1],
            bound=1e-4,
            noise=5.0 / paths**0.5 if paths else 0.0,  # 1 for one path; 0.6 was observed
        )
    return Trace(
        closure=closure,
        weights=weights_of(planes, cells),
        weights_difference=weights_of(difference.reshape(shape), cells),
        programs=tuple(programs),
        seconds={"compile": sum(program.build_s for program in programs), **seconds},
        counts={
            "scattering_cells": len(cells.address),
            "scattering_pixels": count,
            "samples": sums.batches * SAMPLES,
        },
        precision=real.__name__,
        pixel_sample=pixel_sample,
    )
