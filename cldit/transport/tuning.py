"""Numbers that steer a trace: the trade-off of each, and the measurement that shows it."""

from dataclasses import dataclass, field
from typing import Any

ABLATION = "python -m tests.bench ablation"
DECIDED = "docs/benchmarks/decided.md"
ERROR = "python -m tests.bench error"
STABILITY = "python -m tests.bench stability"


def _number(value: Any, trades: str, shown_by: str) -> Any:
    return field(default=value, metadata={"trades": trades, "shown_by": shown_by})


@dataclass(frozen=True)
class Tuning:
    """Numbers of a trace, see `TraceSettings.tuning`.

    A field's metadata has `trades`, the effects of a larger or smaller value, and `shown_by`, the
    command or page that shows them. Optical depths are those of a cell's edge.

    The error that a number leaves is in the source `trace` of the stated error, which the audit by
    `path` measures, unless the comment of its group says otherwise. The paths of the final gather
    end by their weight alone, whatever the brightness of the sources beyond; the audit measures
    that error, too. The only such number of `path` itself is `neglected`.
    """

    # Ordinates and tolerance for an accuracy (settings_for).
    ordinates: int = _number(64, "for 0.1 K: error of the ordinates, time", ERROR)
    ordinates_phase: int = _number(80, "likewise with a phase function", ERROR)
    tolerance: float = _number(6e-4, "of the source for 0.1 K: iterations, its error", DECIDED)
    tolerance_most: float = _number(3e-4, "largest tolerance for any accuracy", DECIDED)

    # Iteration to a residual, a weight. The defect correction removes what solver_rough leaves; the
    # numbers of vectors and iterations change the time alone.
    solver_share: float = _number(1 / 8, "ordinates of GMRES: time, remaining defect", ABLATION)
    solver_fewest: int = _number(16, "its fewest: the error of 8 in slabs is 0.1 %", ERROR)
    solver_rough: float = _number(1e-2, "RMS error before the defect correction", DECIDED)
    solver_peak: float = _number(2e-4, "largest residual of a cell: iterations", STABILITY)
    krylov: int = _number(80, "vectors before a restart: memory, iterations", DECIDED)
    krylov_bytes: float = _number(1e9, "of these vectors, beyond the first twelve", DECIDED)
    iterations: int = _number(600, "after which a source is refused", STABILITY)
    defect_ordinates: int = _number(8, "of the check of the sweeps' energy balance", STABILITY)

    # Linear sources of the solver, for diffusion through thick cells (gradients.py).
    diffusion_least: float = _number(0.1, "depth from which diffusion matters", ABLATION)
    diffusion_most: float = _number(20.0, "largest depth at which the solver ends", STABILITY)
    diffusion_coalbedo: float = _number(0.1, "largest coalbedo of such cells", STABILITY)
    diffusion_lengths: float = _number(1.7, "their largest depth in diffusion lengths", STABILITY)
    linear_lengths: float = _number(3.0, "the same for cells that are then linear", STABILITY)
    alike: float = _number(2.0, "largest ratio of depths for extrapolated gradients", STABILITY)

    # Moment source.
    linear_depth: float = _number(
        0.15, "depth from which sources are linear: bias, noise", ABLATION
    )
    delta_m: bool = _number(True, "delta-M method: bias, ordinates", ABLATION)
    blurred_boundary: bool = _number(True, "boundary blurred by the forward peak: bias", ABLATION)
    moment_share: int = _number(2, "ordinates of moment sweeps: bias, time", ABLATION)

    # Ends of rays, where no cutoff is given. A hundredth of accuracy_K adds 5e-5 of the stated RMS
    # error in quadrature, and is therefore no source; by the temperatures of all that emits.
    neglected: float = _number(0.01, "of accuracy_K, by the light beyond: error, time", ERROR)
    # Likewise a hundredth of an emissivity's error of 0.01.
    neglected_emissivity: float = _number(1e-4, "largest transmission: its error, time", ERROR)

    # Extinction within cells.
    linear_coefficients: bool = _number(True, "linear in cells: blocks, memory", ABLATION)

    # Final sweeps.
    lean: float = _number(0.6, "density of ordinates on the camera's side", ABLATION)
    spatial_from: int = _number(48, "ordinates from which the sweeps find gradients", ABLATION)
    spatial_from_phase: int = _number(256, "likewise with a phase function", ABLATION)
    gradient_depth: float = _number(4.0, "depth up to which such gradients are used", ABLATION)

    # Final gather.
    thick_depth: float = _number(0.5, "depth from which cells are gathered: bias, time", ABLATION)
    thick_depth_phase: float = _number(0.22, "likewise with a phase function", ABLATION)
    path_depth: float = _number(2.0, "depth from which paths continue in a cell", ABLATION)
    path_depth_at_K: float = _number(0.05, "accuracy of that depth; deeper for coarser", ERROR)
    path_albedo: float = _number(0.8, "albedo from which paths continue at any depth", ABLATION)
    path_twice: float = _number(0.3, "smallest albedo^2 depth for it, over path_depth", ABLATION)
    margin: int = _number(1, "cells around thick ones that segments cross", ABLATION)
    end_weight: float = _number(0.03, "weight below which paths end: time, bias", ABLATION)
    least_transmission: float = _number(0.03, "at which segments end, per K of accuracy", ERROR)
    segments: int = _number(128, "largest number in a path: time, bias", STABILITY)
    diffuse_depth: float = _number(2.0, "depth from which sweeps have no diffusion", STABILITY)
    diffuse_coalbedo: float = _number(0.2, "their largest coalbedo, of isotropic parts", STABILITY)
    diffuse_segments: int = _number(2**15, "largest number in a path there: time, bias", STABILITY)
    diffuse_end_weight: float = _number(0.001, "weight left to the sweeps' source there", STABILITY)
    first_samples: int = _number(16, "per pixel in the first round, a power of two", ERROR)
    growth: int = _number(8, "largest factor of samples from round to round", ERROR)
    paths: float = _number(1e8, "largest number in an image: core-minutes", ERROR)
    path_segments: float = _number(1e8, "largest number in an image: core-minutes", STABILITY)
    noise_tile: int = _number(12, "pixels along a tile whose noise is estimated", ERROR)
    # Half of accuracy_K is a quarter of its square; the halves of the image state it.
    noise_share: float = _number(0.5, "of accuracy_K, allowed for the noise of paths", ERROR)
    noise_bright: float = _number(
        3.0, "ratio of noise with walls as warm as the medium to the scene's", ERROR
    )

    # Path tracing, which is unbiased, and the audit that it makes. One standard error of the audit
    # is added to its estimate: a tenth of accuracy_K adds 0.5 % to an error of accuracy_K.
    path_roulette: float = _number(0.4, "weight below which its paths may end", ERROR)
    path_scatterings: int = _number(2**20, "after which a path is ended: time, bias", STABILITY)
    batches: int = _number(4, "fewest batches of samples for an error estimate", ERROR)
    audit_pixels: int = _number(500, "error of the audit, time", ERROR)
    audit_samples_least: int = _number(128, "per pixel: error of the audit, time", ERROR)
    audit_samples_most: int = _number(2048, "per pixel: error of the audit, time", ERROR)
    audit_share: float = _number(0.1, "of accuracy_K, its standard error: error, time", ERROR)
    audit_even: float = _number(0.1, "uniform share of the inclusion probabilities", ERROR)
    audit_pixels_least: int = _number(16, "fewest pixels of a useful audit", STABILITY)
    audit_scatterings: float = _number(2e7, "of an audit, in total: its error, time", STABILITY)

    # Sampling error within pixels.
    subpixels: int = _number(256, "pixels of many rays: error of the estimate, time", ERROR)

    # Energy balance: a larger departure ends the run with an error.
    closure: float = _number(1e-3, "error of the balance in single precision", STABILITY)
