"""Trace: weights per pixel from the octree and the scene's geometry, by the scene's method.

`source` (source_iteration.py), the default, solves for the source of every scattering cell. `path`
(monte_carlo/path.py) is unbiased Monte Carlo path tracing, the reference for the others.
`branching` (branching.py) is the paper's method, for comparison.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from cldit.arrays import Ints
from cldit.errors import NotConvergedError, TransportError
from cldit.gpu.device import Device
from cldit.medium.octree import Octree
from cldit.optics.scene_phase import named_phase
from cldit.scene.schema import Scene
from cldit.transport.branching import trace_branching
from cldit.transport.monte_carlo.audit import audited
from cldit.transport.monte_carlo.path import trace_path
from cldit.transport.monte_carlo.pixel_sampling import PixelSample
from cldit.transport.phase import ScatteringTable
from cldit.transport.result import Trace, TraceInput, TraceSettings
from cldit.transport.source_iteration import trace_source
from cldit.transport.tuning import Tuning

__all__ = ["Trace", "TraceSettings", "settings_for", "trace", "trace_each"]


def settings_for(
    scene: Scene, mie: ScatteringTable | None = None, *, tolerance_K: float | None = None
) -> TraceSettings:
    """Settings for an RMS error of T_app: `tolerance_K`, or None: `transport.accuracy_K`.

    With n = `transport.directions`, the final sweeps have 3 n ordinates and the defect correction
    n / 2. For accuracies below 0.1 K thinner cells are gathered too. `mie` is the mean phase
    function of the droplets, for a scene whose phase is `mie` or not given; None is isotropic.
    """
    spec, tuning = scene.transport, Tuning()
    accuracy_K = spec.accuracy_K if tolerance_K is None else tolerance_K
    finer = 0.1 / accuracy_K
    phase = mie
    if spec.phase is not None and not (named := named_phase(spec.phase)).mie:
        phase = None if named.cumulative is None else ScatteringTable.of(named.cumulative)
    ordinates, thick = tuning.ordinates, tuning.thick_depth
    if phase is not None:
        ordinates, thick = tuning.ordinates_phase, tuning.thick_depth_phase
    directions_default = int(np.clip(8 * round(ordinates // 8 * finer), 16, 512))
    directions = spec.directions or directions_default
    deeper = float(np.clip(accuracy_K / tuning.path_depth_at_K, 1.0, 3.0))
    return TraceSettings(
        directions=max(8, directions // 2),
        final_directions=3 * directions,
        tolerance=float(np.clip(tuning.tolerance / finer, 1e-6, tuning.tolerance_most)),
        order=spec.order,
        cutoff=spec.cutoff,
        precision=spec.precision,
        seed=spec.seed,
        method=spec.method,
        accuracy_K=accuracy_K,
        max_samples=spec.max_samples,
        phase=phase,
        gather=spec.gather,
        audit=spec.audit,
        # The coefficients of a user's grid are exact: uniform in each voxel.
        linear_coefficients=tuning.linear_coefficients and scene.spray.model != "grid",
        whole_pixels=spec.audit and scene.camera.rays_across is None,
        path_depth=tuning.path_depth * deeper ** (2 / 3),
        thick_depth=thick / max(finer, 1.0) ** (1 / 3),
        tuning=tuning,
    )


def trace_each(
    trees: list[Octree],
    scene: Scene,
    device: Device,
    settings: Sequence[TraceSettings],
    *,
    report: Callable[[str], None] | None,
    known: Trace | None = None,
) -> list[Trace]:
    """Traces the tree of each wavelength with its settings; raises as `trace`.

    The list of trees is emptied during the traces, to keep few of them in memory. `known` as in
    `trace`, at the wavelength that chooses rays.
    """
    total = len(trees)
    traces: list[Trace] = []
    # The wavelength that chooses rays comes first, the others have the same.
    leading = next(
        (n for n, wavelength in enumerate(settings) if wavelength.rays_K is not None),
        0,
    )
    trees.insert(0, trees.pop(leading))
    ordered = [settings[leading], *settings[:leading], *settings[leading + 1 :]]
    for number in range(total):
        if report is not None and total > 1:
            report(f"wavelength {number + 1} of {total}")
        # All wavelengths are audited in the same pixels, where their errors add as in the image.
        sample = next(
            (earlier.audit.sample for earlier in traces if earlier.audit is not None),
            None,
        )
        traced = trace(
            trees.pop(0),
            scene,
            device,
            ordered[number],
            report=report,
            audit_sample=sample,
            rays=traces[0].rays if traces else None,
            known=None if traces else known,
        )
        traces.append(traced)
    traces.insert(leading, traces.pop(0))
    return traces


def trace(
    tree: Octree,
    scene: Scene,
    device: Device,
    settings: TraceSettings,
    *,
    report: Callable[[str], None] | None = None,
    audit_sample: PixelSample | None = None,
    pixels: Ints | None = None,
    rays: Ints | None = None,
    known: Trace | None = None,
) -> Trace:
    """Weights of every pixel.

    With method `source` and precision `auto`, a source that single precision cannot resolve
    (optically thick and nearly conservative media) is solved again in double precision if the
    device has it, see `Trace.precision`. If nothing scatters, all methods are the same.

    Args:
        audit_sample: pixels to audit; None: they are drawn from the trace.
        pixels: (N,) flat numbers of the pixels to trace, by `source` without audit, `subpixels` and
            chosen rays; images then have one row. None: all.
        rays: (H, W) rays across each pixel; None: the scene's number, or chosen by `rays_K`.
        known: result of this trace without its audit, which is added; None: there is none.
    """
    if settings.precision == "float64" and not device.info.float64:
        raise TransportError(
            f"transport.precision: float64 is not available on {device.info.name}; allowed: float32"
        )
    if (scene.camera.rays_across or 1) != 1 and settings.method != "source":
        raise TransportError(
            f"camera.rays_per_pixel: {scene.camera.rays_per_pixel} with method {settings.method}, "
            "whose samples go through any place of a pixel (auto) or its middle (1); allowed: 1 or "
            "auto, or method source"
        )
    if scene.camera.lens is not None and settings.method != "source":
        raise TransportError(
            f"camera.lens: given with method {settings.method}, whose samples go through the "
            "middle of the lens; allowed: method source, or no lens"
        )
    single = replace(settings, precision="float32") if settings.precision == "auto" else settings
    if known is not None:
        single = replace(
            settings, precision="float64" if known.precision == "float64" else "float32"
        )
        return audited(TraceInput.of(tree, scene, device, single), known, audit_sample)
    trace_input = TraceInput.of(tree, scene, device, single)
    if trace_input.cells.needs.scattering and settings.method != "source":
        return (trace_path if settings.method == "path" else trace_branching)(trace_input, report)
    try:
        result = trace_source(trace_input, report, pixels, rays)
    except NotConvergedError:
        if settings.precision != "auto" or not device.info.float64:
            raise
        if report is not None:
            report("single precision does not resolve this source; repeating in double precision")
        trace_input = replace(trace_input, settings=replace(settings, precision="float64"))
        result = trace_source(trace_input, report, pixels, rays)
    return audited(trace_input, result, audit_sample)
