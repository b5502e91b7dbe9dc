"""Differential infrared thermography of a trace, and parts shared with that of shots."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from functools import partial

import numpy as np

from cldit.arrays import Floats
from cldit.camera.calibration import Calibration
from cldit.camera.curve import Curve
from cldit.camera.sensor import SensorModel
from cldit.dit.maps import Maps, Reason
from cldit.dit.solve import Signals, solve
from cldit.errors import EvaluationError
from cldit.optics.response import Filter
from cldit.optics.spectral import Quadrature, SpectralNode, reference_temperature_K
from cldit.radiance.boundary import Boundary, Surroundings, camera_radiance, camera_radiances
from cldit.radiance.weights import Weights
from cldit.scene import Scene

_BLOCK = 1 << 16  # pixels times backgrounds solved at once: 20 MB, twice as fast as 16 times that
_TOGETHER = 2  # blocks at a time, one a thread: 40 MB


def check_span(source: Floats, temperatures_K: Sequence[float]) -> None:
    """Checks that backgrounds differ in temperature and in radiance `source` (K,)."""
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


def blocks(shape: tuple[int, int], backgrounds: int) -> Iterator[slice]:
    """Slices of rows of an image, with as many rows as memory allows for `backgrounds`."""
    rows = max(1, _BLOCK // (backgrounds * max(shape[1], 1)))
    for begin in range(0, shape[0], rows):
        yield slice(begin, begin + rows)


def stack(parts: list[Maps]) -> Maps:
    """Maps of the parts, one below the other."""
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
    """DIT of a trace: exact signals, with the errors of a camera.

    Args:
        weights: trace (H, W) of the spray, or one for each of `nodes`.
        reference: trace of the same scene without it, the same in all nodes.
        background_temperatures_K: (K,) at least two that differ.
        surroundings: walls, windows and patches around the spray.
        filter_um: edges of the filter.
        nodes: spectral nodes of the traces; None: one trace for the whole filter.
        sensor: its noise at each ray gives the standard errors; None: 0. Saturation is ignored.
        shots, references: exposures per background.

    Returns:
        Maps (H, W) of T_app [K], emissivity, their standard errors and reasons.

    Raises:
        EvaluationError: fewer than two different backgrounds, or traces of different shape.
    """
    traces = [weights] if isinstance(weights, Weights) else list(weights)
    _check(traces, reference, shots, references)
    temperatures = list(background_temperatures_K)
    middle_K = reference_temperature_K(temperatures)
    boundary = Boundary.in_filter(surroundings, filter_um, reference_K=middle_K)
    parts = [boundary]
    if nodes is not None:
        parts = [Boundary.of(surroundings, node.radiance, node.pane) for node in nodes]
    source = boundary.leaving(temperatures)
    check_span(source, temperatures)
    camera = partial(_variance, None if sensor is None else sensor.calibration(), boundary)

    def signals(traced: Sequence[Weights], rows: slice, exposures: int) -> Signals:
        cut = [node_weights.map(lambda image: image[rows]) for node_weights in traced]
        seen = camera_radiances(cut, parts, backgrounds_K=temperatures)
        return Signals(
            source=source,
            mean=boundary.inside(seen),
            camera=camera,
            exposures=np.full(len(source), float(exposures)),
        )

    def solved(rows: slice) -> Maps:
        bare = signals([reference] * len(parts), rows, references)
        spray = signals(traces, rows, shots)
        usable = np.ones(bare.mean.shape, dtype=bool)
        return solve(bare, spray, usable=usable, curve=Curve(filter_um=filter_um), exact=True)[0]

    with ThreadPoolExecutor(_TOGETHER) as pool:
        return stack(list(pool.map(solved, blocks(reference.background.shape, len(source)))))


def _check(traces: Sequence[Weights], reference: Weights, *exposures: int) -> None:
    shape = reference.background.shape
    for trace in traces:
        if trace.background.shape != shape:
            raise EvaluationError(
                f"the trace has {trace.background.shape} pixels, the one without spray {shape}"
            )
    if min(exposures) < 1:
        shots, references = exposures
        raise EvaluationError(f"{shots} shots and {references} references; at least one each")


def _variance(calibration: Calibration | None, boundary: Boundary, inside: Floats) -> Floats:
    """Variance, radiance^2, of one exposure to the radiance `inside`; 0 without a camera."""
    if calibration is None:
        return np.zeros_like(inside)
    variance = calibration.variance_counts2(calibration.counts(boundary.seen(inside)))
    return np.asarray(
        variance / (calibration.counts_per_radiance * boundary.front.transmission) ** 2
    )


def sensor_of(
    scene: Scene, quadrature: Quadrature, seen: tuple[tuple[Weights, ...], Weights]
) -> SensorModel:
    """The scene's sensor, set so that its hottest background does not saturate it.

    `seen` are the weights of the nodes with spray, and the one without.
    """
    sensor = SensorModel.from_scene(scene)
    if scene.camera.sensor.integration_time_s is not None:
        return sensor
    surroundings = Surroundings.from_scene(scene)
    bands = [Boundary.of(surroundings, node.radiance, node.pane) for node in quadrature.nodes]
    hottest = max(scene.background.temperatures_K)
    spray, reference = seen
    images = [
        camera_radiance(weights, bands, background_K=hottest)
        for weights in (spray, [reference] * len(bands))
    ]
    return sensor.exposed_for(max(float(image.max()) for image in images))


def evaluated(
    scene: Scene,
    quadrature: Quadrature,
    spectral: tuple[Weights, ...],
    reference: Weights,
    sensor: SensorModel,
) -> Maps:
    """DIT of a trace without noise; for a single background, empty maps with the reason.

    `spectral` are the weights (H, W) of each node of `quadrature`, `reference` those without spray;
    the standard errors are those of the sensor's noise.
    """
    if len(set(scene.background.temperatures_K)) < 2:
        return Maps.unevaluated(reference.background.shape, Reason.TOO_FEW_BACKGROUNDS)
    return evaluate_radiance(
        spectral,
        reference,
        background_temperatures_K=scene.background.temperatures_K,
        surroundings=Surroundings.from_scene(scene),
        filter_um=quadrature.filter_um,
        nodes=quadrature.nodes if len(spectral) > 1 else None,
        sensor=sensor,
        shots=scene.plan.shots,
        references=scene.plan.references,
    )
