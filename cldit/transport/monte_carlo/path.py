"""Monte Carlo path tracing, the method `path`: batches of paths until the wanted error.

This is backward Monte Carlo (Modest, Radiative Heat Transfer, ch. 21; kernels/path.cl). Every batch
is a low-discrepancy set with its own random shift (randomised quasi-Monte Carlo), so that the
scatter of batches is an unbiased estimate of the image's error.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cldit.arrays import Floats, Ints, Reals
from cldit.gpu.buffers import download, upload, zeros
from cldit.gpu.device import shares
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
    """Sums of the means (C, N) of even and of odd batches, and how many paths were ended."""

    halves: tuple[Floats, Floats]
    batches: int = 0
    ended: int = 0

    def add(self, means: Floats) -> None:
        """Adds the means (C + 1, N) of a batch, the last the numbers of ended paths."""
        self.halves[self.batches % 2][:] += means[:-1]
        self.batches += 1
        self.ended += int(means[-1].sum())

    @property
    def samples(self) -> int:
        """Paths of each pixel."""
        return self.batches * SAMPLES

    @property
    def mean(self) -> Floats:
        return (self.halves[0] + self.halves[1]) / self.batches

    @property
    def difference(self) -> Floats:
        """Half the difference of the means of even and of odd batches, equal in number."""
        return (self.halves[0] - self.halves[1]) / self.batches

    def balanced(self, boundaries: int) -> tuple[Floats, Floats]:
        """Mean and half the difference (C, N), each half divided by its energy balance.

        The sum of all that a path receives at radiance 1 is 1 on average, and most of its noise is
        that of the single components. So the quotient has the noise of T_app alone: none in a
        cavity. Its bias is that of a ratio, the relative variance of the sum over half the number
        of paths.
        """
        halves = []
        for sign in (1.0, -1.0):
            half = self.mean + sign * self.difference
            halves.append(half / (half[:boundaries].sum(axis=0) + half[-1]))
        return (halves[0] + halves[1]) / 2, (halves[0] - halves[1]) / 2


def _programs(trace_input: TraceInput) -> tuple[tuple[Program, ...], Reals]:
    """Programs of the devices, and the tables of the phase function that they sample."""
    settings, table = trace_input.settings, np.zeros(1, trace_input.settings.real)
    defines: dict[str, Define] = {
        **trace_input.defines,
        "ROULETTE": f"R({settings.tuning.path_roulette})",
        "SAMPLES": SAMPLES,
        "SCATTERINGS": settings.tuning.path_scatterings,
    }
    if settings.phase is not None:
        defines["PHASE_BINS"] = settings.phase.bins
        samples = [scattering.to_sample() for scattering in settings.phase.tables]
        table = np.concatenate(samples).astype(settings.real)
        if len(samples) > 1:
            defines["PHASE_CLASSES"] = len(samples)
    members = (trace_input.device, *trace_input.device.others)
    return tuple(build(member, "path.cl", defines) for member in members), table


def _media(trace_input: TraceInput) -> list[dict[str, Any]]:
    """Uploads medium and view to each device; returns arguments of both kernels."""
    cells, settings, real = trace_input.cells, trace_input.settings, trace_input.settings.real
    classes, order = class_shares(cells, settings.phase), settings.order
    ends = {
        "cutoff": replace(settings, cutoff=None).ending(cells, trace_input.scene),
        "order": -1 if order is None else order,
    }
    linear, view = settings.linear_coefficients, trace_input.view
    return [
        {
            **upload_medium(member, cells, view, real, linear=linear),
            **({} if classes is None else {"shares": upload(member, "size classes", classes)}),
            **ends,
        }
        for member in (trace_input.device, *trace_input.device.others)
    ]


def _scattered(trace_input: TraceInput, program: Program, medium: dict[str, Any]) -> Floats:
    """Light (P,) that the line of sight through the middle of each pixel scatters."""
    view, real = trace_input.view, trace_input.settings.real
    pixels = view.pixels[0] * view.pixels[1]
    out = zeros(trace_input.device, "scattered light", pixels, real)
    program.launch("straight", *view.tiles(program, "straight"), {"scattered": out, **medium})
    return download(trace_input.device, out, np.empty(pixels, real)).astype(np.float64)


@dataclass(frozen=True)
class _PathTracer:
    """A device's program, and the pixels whose paths it traces."""

    program: Program
    count: int
    halves: tuple[Any, Any]
    arguments: dict[str, Any]

    @classmethod
    def of(
        cls,
        trace_input: TraceInput,
        programs: Sequence[Program],
        media: Sequence[dict[str, Any]],
        *,
        table: Reals,
        pixels: Ints,
    ) -> "list[_PathTracer]":
        """One for each device that has a share of the pixels; `table` is of the phase function."""
        real, settings = trace_input.settings.real, trace_input.settings
        size = len(trace_input.cells.needs.components) + 2
        tracers = []
        divided = shares(trace_input.device, len(pixels))
        for program, medium, (device, portion) in zip(programs, media, divided, strict=True):
            if not portion:
                continue
            even, odd = (zeros(device, "means", size * len(portion), real) for _ in range(2))
            listed = pixels[portion.start : portion.stop].astype(np.int32)
            arguments = {
                "list": upload(device, "pixels", listed),
                "table": upload(device, "phase function", table),
                "sobol_columns": upload(device, "Sobol", columns()),
                "whole_pixels": int(settings.whole_pixels),
                **medium,
            }
            tracers.append(cls(program, len(portion), (even, odd), arguments))
        return tracers

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
        self.program.device.queue.flush()

    def means(self, half: int, components: int, real: type[np.floating]) -> Reals:
        """Waits for the means (C + 1, N) of the even (0) or of the odd (1) batch; the last are the
        numbers of ended paths."""
        means = np.empty((components + 1, self.count), real)
        return download(self.program.device, self.halves[half], means)


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
    trace_input.check_boundary()
    programs, table = _programs(trace_input)
    seconds = {"compile": sum(program.build_s for program in programs)}
    start = time.perf_counter()
    media = _media(trace_input)
    pixel_sample = None if draw is None else draw(_scattered(trace_input, programs[0], media[0]))
    seconds["image"] = time.perf_counter() - start

    start = time.perf_counter()
    column_count, rows = trace_input.view.pixels
    pixels = np.arange(column_count * rows) if pixel_sample is None else pixel_sample.pixels
    parts = len(trace_input.cells.needs.components) + 1
    boundaries = trace_input.cells.needs.boundaries

    def done(sums: _BatchSums) -> bool:
        """True if the samples suffice."""
        if pixel_sample is None or enough is None:
            return _accurate(trace_input, sums, pixels, report)
        mean, difference = sums.balanced(boundaries)
        return enough(pixel_sample, mean[:-1], difference[:-1])

    tracers = _PathTracer.of(trace_input, programs, media, table=table, pixels=pixels)
    sums = _sampled(trace_input, tracers, len(pixels), done)
    seconds["scattering"] = time.perf_counter() - start
    shape = (parts, rows, column_count) if pixel_sample is None else (parts, 1, len(pixels))
    image, difference = sums.halves
    if len(pixels) and pixel_sample is None:  # else no pixel was drawn
        image, difference = sums.mean, sums.difference
    elif len(pixels):
        image, difference = sums.balanced(boundaries)
    return Trace(
        closure=_balance(sums, boundaries, shape) if len(pixels) else None,
        short=_ended(trace_input, sums, len(pixels)),
        weights=weights_of(image.reshape(shape), trace_input.cells),
        weights_difference=weights_of(difference.reshape(shape), trace_input.cells),
        programs=programs,
        seconds=seconds,
        counts={
            "scattering_cells": len(trace_input.cells.address),
            "pixels": len(pixels),
            "samples": sums.samples,
        },
        precision=trace_input.settings.real.__name__,
        pixel_sample=pixel_sample,
    )


def _balance(sums: _BatchSums, boundaries: int, shape: tuple[int, ...]) -> EnergyBalance:
    """Energy balance of the paths' mean, as an image of this shape."""
    planes = sums.mean.reshape(shape)
    paths = planes[-1].size * sums.samples
    return EnergyBalance.of(
        planes[:boundaries],
        planes[-1],
        bound=1e-4,
        noise=5.0 / paths**0.5,  # 1 for one path; 0.6 was observed
    )


def _sampled(
    trace_input: TraceInput,
    tracers: list[_PathTracer],
    pixels: int,
    done: Callable[[_BatchSums], bool],
) -> _BatchSums:
    """Sums of pairs of batches of paths until they are `done`, or `max_samples` are reached."""
    settings = trace_input.settings
    components = len(trace_input.cells.needs.components) + 1  # the last: from within
    even, odd = np.zeros((2, components, pixels))
    sums = _BatchSums((even, odd))
    while tracers:
        for tracer in tracers:
            tracer.launch(settings.seed, sums.batches)
        for half in range(2):
            parts = [tracer.means(half, components, settings.real) for tracer in tracers]
            sums.add(np.concatenate(parts, axis=1).astype(np.float64))
        if done(sums) or sums.samples >= settings.max_samples:
            break
    return sums


def _accurate(
    trace_input: TraceInput,
    sums: _BatchSums,
    pixels: Ints,
    report: Callable[[str], None] | None,
) -> bool:
    """True if the noise of T_app in front of the background is the wanted one."""
    settings = trace_input.settings
    error_K = trace_input.temperature.error_K(sums.mean[:-1], sums.difference[:-1])
    error_K = error_K[np.isfinite(error_K) & trace_input.view.on_background(pixels)]
    error = float(np.sqrt(np.sum(error_K**2) / max(len(error_K), 1)))
    if report is not None:
        report(f"{sums.samples} samples per pixel: error {error:.2g} K")
    return error <= settings.accuracy_K and sums.batches >= settings.tuning.batches


def _ended(trace_input: TraceInput, sums: _BatchSums, pixels: int) -> str:
    """Remark on paths that were ended by their number of scatterings; empty if none was."""
    if not sums.ended:
        return ""
    return (
        f"path tracing: {sums.ended} of {pixels * sums.samples} paths ended after "
        f"{trace_input.settings.tuning.path_scatterings} scatterings, as if they saw the wall; "
        "allowed: a medium that absorbs more, or transport.method: source"
    )
