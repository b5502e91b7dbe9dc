"""Differential infrared thermography of a trace and of recorded shots."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from cldit.camera.calibration import Calibration
from cldit.camera.sensor import SensorModel
from cldit.dit.maps import Maps, Reason
from cldit.dit.shots import Acquisition, accumulate, check_shots
from cldit.dit.solve import Signals, solve
from cldit.errors import EvaluationError
from cldit.optics.response import Filter
from cldit.optics.spectral import SpectralNode, reference_temperature_K
from cldit.radiance.boundary import Boundary, Surroundings, picture
from cldit.radiance.weights import Weights

Floats = NDArray[np.float64]

_BLOCK = 1 << 20  # pixels times backgrounds solved at once: some 100 MB


def _check_span(source: Floats, temperatures_K: Sequence[float]) -> None:
    if len(set(temperatures_K)) < 2:
        raise EvaluationError(
            f"backgrounds: {sorted(set(temperatures_K))} K; the evaluation needs at least two "
            "different temperatures"
        )
    # Written so that NaN fails.
    if not np.ptp(source) > 1e-9 * np.max(np.abs(source)):
        raise EvaluationError(
            f"backgrounds: {', '.join(f'{t:g}' for t in temperatures_K)} K give the same "
            "radiance; the evaluation needs at least two that differ"
        )


def _blocks(shape: tuple[int, int], backgrounds: int) -> Iterator[slice]:
    rows = max(1, _BLOCK // (backgrounds * max(shape[1], 1)))
    for begin in range(0, shape[0], rows):
        yield slice(begin, begin + rows)


def _rows(weights: Weights, rows: slice) -> Weights:
    return weights.map(lambda image: image[rows])


def _stack(parts: list[Maps]) -> Maps:
    return Maps(
        **{
            item.name: np.concatenate([getattr(p, item.name) for p in parts])
            for item in fields(Maps)
        }
    )


def evaluate_radiance(
    weights: Weights | Sequence[Weights],
    reference: Weights,
    *,
    background_temperatures_K: Sequence[float],
    surroundings: Surroundings,
    filter_um: Filter,
    nodes: Sequence[SpectralNode] | None = None,
    sensor: SensorModel | None,
    shots: int,
    references: int,
) -> Maps:
    """DIT of a trace: exact signals, with the errors that a camera would have.

    Args:
        weights: trace (H, W) of the spray, or one for each of `nodes`.
        reference: trace of the same scene without it, the same in all nodes.
        nodes: parts of the filter that were traced on their own; None: one trace stands for all.
        sensor: its noise, taken for a sensor pixel at each ray, gives the standard errors (and the
            weights of the backgrounds); without it they are 0. Saturation is not regarded.
        shots, references: exposures before each background.

    Raises:
        EvaluationError: fewer than two different backgrounds, or traces of different shape.
    """
    traces = [weights] if isinstance(weights, Weights) else list(weights)
    shape = reference.background.shape
    for trace in traces:
        if trace.background.shape != shape:
            raise EvaluationError(
                f"the trace has {trace.background.shape} pixels, the one without spray {shape}"
            )
    if shots < 1 or references < 1:
        raise EvaluationError(f"{shots} shots and {references} references; at least one each")
    temperatures = list(background_temperatures_K)
    reference_K = reference_temperature_K(temperatures)
    whole = Boundary.in_filter(surroundings, filter_um, reference_K=reference_K)
    parts = (
        [whole] if nodes is None else [Boundary.of(surroundings, n.radiance, n.pane) for n in nodes]
    )
    source = whole.leaving(temperatures)
    _check_span(source, temperatures)
    calibration = None if sensor is None else sensor.calibration()

    def signals(traced: Sequence[Weights], rows: slice, exposures: int) -> Signals:
        cut = [_rows(one, rows) for one in traced]
        seen = np.stack([picture(cut, parts, background_K=kelvin) for kelvin in temperatures])
        camera = np.zeros_like(seen)
        if calibration is not None:
            variance = calibration.variance_counts2(calibration.counts(np.nan_to_num(seen)))
            camera = variance / (calibration.counts_per_radiance * whole.front.transmission) ** 2
        return Signals(
            source=source,
            mean=whole.inside(seen),
            camera=camera,
            exposures=np.full(len(source), float(exposures)),
        )

    return _stack(
        [
            solve(
                signals([reference] * len(parts), rows, references),
                signals(traces, rows, shots),
                usable=np.ones((len(source), *reference.background[rows].shape), dtype=bool),
                filter_um=filter_um,
            )
            for rows in _blocks(shape, len(source))
        ]
    )


def evaluate_acquisition(
    acquisition: Acquisition, *, progress: Callable[[int, int], None] | None = None
) -> Maps:
    """DIT of recorded shots.

    Shots of one set point are averaged; one picture is held at a time, so that memory grows with
    the number of backgrounds only (34 bytes a pixel each). A background before which a pixel was
    saturated is left out for this pixel. Standard errors: see `cldit.dit.solve.solve`.

    Args:
        progress: called with (shots read, shots in all).

    Raises:
        EvaluationError: what is missing or does not fit; references and injections swapped.
    """
    calibration = Calibration.from_dict(acquisition.calibration)
    setpoints = check_shots(acquisition.shots)
    sums = accumulate(acquisition, calibration.saturation_counts, progress)
    whole = Boundary.in_filter(
        acquisition.surroundings,
        calibration.filter_um,
        reference_K=reference_temperature_K(setpoints),
    )

    def signals(kind: str, rows: slice) -> Signals:
        found = [sums[setpoint, kind] for setpoint in setpoints]
        mean = np.stack([item.mean(rows) for item in found])
        scale = (calibration.counts_per_radiance * whole.front.transmission) ** -2
        return Signals(
            source=sources[kind],
            mean=whole.inside(calibration.radiance(mean)),
            camera=calibration.variance_counts2(mean) * scale,
            exposures=np.array([float(item.exposures) for item in found]),
            observed=np.stack([item.variance(rows) for item in found]) * scale,
        )

    sources: dict[str, Floats] = {}
    for kind in ("reference", "injection"):
        means = [float(np.mean(sums[setpoint, kind].temperatures_K)) for setpoint in setpoints]
        sources[kind] = whole.leaving(means)
        _check_span(sources[kind], means)
    full = {
        setpoint: sums[setpoint, "reference"].full | sums[setpoint, "injection"].full
        for setpoint in setpoints
    }
    parts: list[Maps] = []
    for rows in _blocks(sums[setpoints[0], "reference"].total.shape, len(setpoints)):
        usable = ~np.stack([full[setpoint][rows] for setpoint in setpoints])
        part = solve(
            signals("reference", rows),
            signals("injection", rows),
            usable=usable,
            filter_um=calibration.filter_um,
        )
        part.reason[part.reason == Reason.TOO_FEW_BACKGROUNDS] = Reason.SATURATED
        parts.append(part)
    maps = _stack(parts)
    if acquisition.bad_pixels is not None:
        maps = _without(maps, acquisition.bad_pixels)
    _check_not_swapped(maps)
    return maps


def _without(maps: Maps, bad: NDArray[np.bool_]) -> Maps:
    images = {
        item.name: np.where(bad, np.float32(np.nan), getattr(maps, item.name))
        for item in fields(Maps)
        if item.name != "reason"
    }
    reason = np.where(bad, np.uint8(Reason.BAD_PIXEL), maps.reason)
    return Maps(**images, reason=reason)


def _check_not_swapped(maps: Maps) -> None:
    """A spray takes from the background; where more comes through, the kinds are swapped."""
    sure = np.maximum(5.0 * maps.emissivity_standard_error, 0.05)
    more = int(np.count_nonzero(maps.emissivity < -sure))
    less = int(np.count_nonzero(maps.emissivity > sure))
    if more > max(less, 1e-3 * maps.emissivity.size):
        raise EvaluationError(
            f"{more} pixels see more of the background in the injections than in the references "
            f"(and {less} less): are references and injections swapped?"
        )
