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
    halves: tuple[Any, Any]
    arguments: dict[str, Any]

    @classmethod
    def of(
        cls,
        device: Device,
        program: Program,
        *,
        pixels: NDArray[np.int32],
        real: type[np.floating],
        fixed: dict[str, Any],
        components: int,
    ) -> "_PathTracer":
        """Uploads the `pixels`; `fixed` are arguments that all of them share."""
        size = (components + 1) * len(pixels)
        even, odd = (zeros(device, "means", size, real) for _ in range(2))
        listed = {"list": upload(device, "pixels", pixels)}
        return cls(device, program, len(pixels), (even, odd), {**listed, **fixed})

    def launch(self, seed: int, first: int) -> None:
        """Starts an even batch, `first`, and the next one, and does not wait for them."""
        group = min(SAMPLES, self.program.largest_group("scatter"))
        for batch, out in enumerate(self.halves, start=first):
            self.program.launch(
                "scatter",
                (self.count * group,),
                (group,),
                {
                    "means": out,
                    "count": self.count,
                    "key": np.array([seed, 0], np.uint32),
                    "batch": batch,
                    **self.arguments,
                },
            )
        self.device.queue.flush()

    def means(self, half: int, components: int, real: type[np.floating]) -> Reals:
        """Waits for the means (C + 1, N) of the even (0) or of the odd (1) batch; the last are the
        numbers of ended paths."""
        means = np.empty((components + 1, self.count), real)
        return download(self.device, self.halves[half], means)


def _balanced(mean: Floats, difference: Floats, boundaries: int) -> tuple[Floats, Floats]:
    """Mean and half the difference (C, N) of two halves, each divided by its energy balance.

    The sum of all that a path receives at radiance 1 is 1 on average, and most of its noise is that
    of the single components. So the quotient has the noise of T_app alone: none in a cavity. Its
    bias is that of a ratio, the relative variance of the sum over half the number of paths.
    """
    halves = []
    for sign in (1.0, -1.0):
        half = mean + sign * difference
        halves.append(half / (half[:boundaries].sum(axis=0) + half[-1]))
    return (halves[0] + halves[1]) / 2, (halves[0] - halves[1]) / 2


def trace_path(
    trace_input: TraceInput,
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
    cells, view = trace_input.cells, trace_input.view
    device, settings = trace_input.device, trace_input.settings
    trace_input.check_boundary()
    real = settings.real
    defines: dict[str, Define] = {
        **trace_input.defines,
        "ROULETTE": f"R({settings.tuning.path_roulette})",
        "SAMPLES": SAMPLES,
        "SCATTERINGS": settings.tuning.path_scatterings,
    }
    table = np.zeros(1, real)
    if settings.phase is not None:
        defines["PHASE_BINS"] = settings.phase.bins
        tables = settings.phase.tables
        table = np.concatenate([scattering.to_sample() for scattering in tables]).astype(real)
        if len(tables) > 1:
            defines["PHASE_CLASSES"] = len(tables)
    classes = class_shares(cells, settings.phase)
    programs = [build(member, "path.cl", defines) for member in (device, *device.others)]
    start = time.perf_counter()
    components = len(cells.needs.components) + 1  # the last: from within, see energy_balance.py
    column_count, row_count = view.pixels
    pixels = column_count * row_count

    cutoff, order = replace(settings, cutoff=None).ending(cells, trace_input.scene), settings.order

    def medium(member: Device) -> dict[str, Any]:
        shared = {} if classes is None else {"shares": upload(member, "size classes", classes)}
        arguments_of_medium = upload_medium(
            member, cells, view, real, linear=settings.linear_coefficients
        )
        return {
            **arguments_of_medium,
            **shared,
            "cutoff": cutoff,
            "order": -1 if order is None else order,
        }

    device_medium = medium(device)
    listed, shape = np.arange(pixels), (components, row_count, column_count)
    pixel_sample = None
    if draw is not None:
        out = zeros(device, "scattered light", pixels, real)
        tiles = view.tiles(programs[0], "straight")
        programs[0].launch("straight", *tiles, {"scattered": out, **device_medium})
        pixel_sample = draw(download(device, out, np.empty(pixels, real)).astype(np.float64))
        listed = pixel_sample.pixels
        shape = (components, 1, len(listed))
    seconds = {"image": time.perf_counter() - start}

    start = time.perf_counter()
    count = len(listed)
    tracers = [
        _PathTracer.of(
            member,
            program,
            pixels=listed[portion.start : portion.stop].astype(np.int32),
            real=real,
            fixed={
                "table": upload(member, "phase function", table),
                "sobol_columns": upload(member, "Sobol", columns()),
                "whole_pixels": int(settings.whole_pixels),
                **(device_medium if member is device else medium(member)),
            },
            components=components,
        )
        for program, (member, portion) in zip(programs, shares(device, count), strict=True)
        if portion
    ]
    on_background, boundaries = view.on_background(listed), cells.needs.boundaries
    even, odd = np.zeros((2, components, count))
    sums, ended = _BatchSums((even, odd)), 0
    temperature = trace_input.temperature
    while count:
        for tracer in tracers:
            tracer.launch(settings.seed, sums.batches)
        for half in range(2):
            means = np.concatenate(
                [tracer.means(half, components, real) for tracer in tracers], axis=1
            ).astype(np.float64)
            sums.add(means[:-1])
            ended += int(means[-1].sum())
        if pixel_sample is not None and enough is not None:
            balanced_mean, difference_of_halves = _balanced(sums.mean, sums.difference, boundaries)
            done = enough(pixel_sample, balanced_mean[:-1], difference_of_halves[:-1])
        else:
            error_K = temperature.error_K(sums.mean[:-1], sums.difference[:-1])
            error_K = error_K[np.isfinite(error_K) & on_background]
            error = float(np.sqrt(np.sum(error_K**2) / max(len(error_K), 1)))
            done = error <= settings.accuracy_K and sums.batches >= settings.tuning.batches
            if report is not None:
                report(f"{sums.batches * SAMPLES} samples per pixel: error {error:.2g} K")
        if done or sums.batches * SAMPLES >= settings.max_samples:
            break
    seconds["scattering"] = time.perf_counter() - start
    image, difference, closure = np.zeros((components, count)), np.zeros((components, count)), None
    paths, short = count * sums.batches * SAMPLES, ""
    if ended:
        limit = settings.tuning.path_scatterings
        short = (
            f"path tracing: {ended} of {paths} paths ended after {limit} scatterings, as if they "
            "saw the wall; allowed: a medium that absorbs more, or transport.method: source"
        )
    if count:  # else no pixel was drawn
        image, difference = sums.mean, sums.difference
        planes = image.reshape(shape)
        closure = EnergyBalance.of(
            planes[:boundaries],
            planes[-1],
            bound=1e-4,
            noise=5.0 / paths**0.5,  # 1 for one path; 0.6 was observed
        )
    if pixel_sample is not None and count:
        image, difference = _balanced(image, difference, boundaries)
    return Trace(
        closure=closure,
        short=short,
        weights=weights_of(image.reshape(shape), cells),
        weights_difference=weights_of(difference.reshape(shape), cells),
        programs=tuple(programs),
        seconds={"compile": sum(program.build_s for program in programs), **seconds},
        counts={
            "scattering_cells": len(cells.address),
            "pixels": count,
            "samples": sums.batches * SAMPLES,
        },
        precision=real.__name__,
        pixel_sample=pixel_sample,
    )
