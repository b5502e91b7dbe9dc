"""All witnesses of recorded shots, and their contributions to the errors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.camera.calibration import Calibration
from cldit.dit.shots import AllSums, thumbnail
from cldit.dit.solve import KINDS, Cause, Drift, Systematic, by_amount
from cldit.dit.witness import backgrounds, drift, images
from cldit.dit.witness.backgrounds import CLEAREST, THIN, clearest, slopes
from cldit.dit.witness.evidence import Evidence, per_kelvin
from cldit.dit.witness.finding import Witness
from cldit.dit.witness.kinds import kinds
from cldit.dit.witness.levels import levels
from cldit.dit.witness.orientation import orientation
from cldit.dit.witness.patterns import Patterns
from cldit.dit.witness.pixels import between_backgrounds, between_kinds
from cldit.dit.witness.shift import shift
from cldit.dit.witness.trend import DriftTerm, terms, unit
from cldit.radiance.boundary import Boundary, Surroundings

_BANDS = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1)  # shares of the filter in which a spray absorbs


@dataclass(frozen=True, kw_only=True)
class Examined:
    """Witnesses, and errors for the fit. terms: drifts, K. through: drifts go through breaks."""

    witnesses: tuple[Witness, ...]
    drifts: tuple[Drift, ...]
    systematic: Systematic
    terms: tuple[DriftTerm, ...] = ()
    through: bool = False


def examine_images(
    sums: AllSums,
    setpoints: Sequence[float],
    surroundings: Surroundings,
    *,
    saturation_counts: float,
) -> tuple[list[Witness], float]:
    """Witnesses that need no radiance and found something, and the level of saturation."""
    named_K = {f"background {k:g}": sums[k, "reference"].temperature_K for k in setpoints}
    named_K["walls"] = surroundings.wall_temperature_K
    named_K |= {f"{window.side} window": window.temperature_K for window in surroundings.windows}
    ending, saturation = images.plateau(sums, saturation_counts)
    witnesses = [
        backgrounds.celsius(named_K),
        ending,
        images.axes(sums, setpoints),
        orientation(sums, setpoints),
    ]
    return [witness for witness in witnesses if witness is not None], saturation


def examine(
    sums: AllSums,
    setpoints: Sequence[float],
    *,
    sees: Mask,
    boundary: Boundary,
    surroundings: Surroundings,
    calibration: Calibration,
    unfitted: Boundary | None = None,
) -> Examined:
    """Comparisons of the shots with each other.

    boundary: measurement equation in the filter. unfitted: the same with the filter as stated, if
    the curve was fitted to the references.
    """
    stated_drifts = stated(
        sums, setpoints, boundary=boundary, surroundings=surroundings, calibration=calibration
    )
    if not Evidence.of_blocks(sees).any():
        return Examined(witnesses=(), drifts=stated_drifts, systematic=Systematic())
    warm_K = [
        *setpoints,
        surroundings.wall_temperature_K,
        surroundings.background_surroundings_K or 0.0,
        *(window.temperature_K for window in surroundings.windows),
    ]
    seen_as = partial(
        Evidence.of, sums, setpoints, sees=sees, calibration=calibration, warmest_K=max(warm_K)
    )
    evidence = seen_as(boundary=boundary)
    scale = calibration.counts_per_radiance * boundary.front.transmission
    stated_K2 = _stated_K2(stated_drifts, evidence)
    stated_K = np.sqrt(stated_K2)
    lined, off = backgrounds.references(evidence, stated_K=stated_K)
    drifts, cause, through = drift.find(evidence, off, stated_K=stated_K)
    if cause and lined.stands_out and not lined.severe:
        lined = replace(lined, says=f"{lined.says}, {cause}")
    if unfitted is not None:
        lined = backgrounds.fitted_over(seen_as(boundary=unfitted), lined, stated_K=stated_K)
    between, systematic = kinds(evidence)
    x, counts_per_kelvin = evidence.source["reference"], evidence.rise * scale
    moved, of_shift = shift(
        sums, setpoints, sees=sees, source=x, counts_per_kelvin=counts_per_kelvin
    )
    patterns = Patterns.of(
        sums, setpoints, sees=sees, source=x, calibration=calibration, amount2=evidence.scatter()[1]
    )
    of_pixels, systematic = _of_pixels(
        evidence, patterns, systematic, stated_K2=stated_K2, scale=scale, of_shift=of_shift
    )
    amount = _amount(evidence, sums, setpoints, scale=scale, drifting=bool(drifts))
    injections = backgrounds.injections(evidence, stated_K=stated_K)
    witnesses = (lined, injections, between, moved, *of_pixels, levels(evidence))
    return Examined(
        witnesses=tuple(witness for witness in witnesses if witness is not None),
        drifts=(*stated_drifts, *drifts, *amount),
        systematic=systematic,
        terms=terms(evidence, stated=stated_drifts, estimated=drifts),
        through=through,
    )


def _of_pixels(
    evidence: Evidence,
    patterns: Patterns,
    systematic: Systematic,
    *,
    stated_K2: Floats,
    scale: float,
    of_shift: Floats | None,
) -> tuple[tuple[Witness | None, Witness | None], Systematic]:
    """Witnesses of patterns of single pixels, between backgrounds and between the kinds, and the
    `systematic` errors with those of pixels, and variances `of_shift` (K, h, w) in counts^2."""
    of_lines, counts2 = between_backgrounds(
        patterns,
        stated=stated_K2 * (evidence.rise * scale) ** 2,
        names=[f"{setpoint:g} K" for setpoint in evidence.setpoints],
    )
    extra = {name: v if name == "gain" else v / scale**2 for name, v in counts2.items()}
    if of_shift is not None:
        extra["injection"] = np.maximum(of_shift / scale**2, extra.get("injection", 0.0))
    clear, slope = clearest(evidence), slopes(evidence)
    renewed, offset_counts, gain = between_kinds(
        patterns,
        clear=evidence.pixels(clear),
        half=evidence.pixels(clearest(evidence, share=0.5 * CLEAREST)),
        wide=evidence.pixels(clear | (slope > 1.0 - THIN)),
        thin=max(float(1.0 - np.mean(slope[clear])), 0.0),
        warmest=max(1.0, evidence.warmest / float(evidence.source["reference"].max())),
        rise_counts=evidence.rise * scale,
    )
    return (of_lines, renewed), replace(
        systematic, extra=extra, pixel_offset=offset_counts / scale, pixel_gain=gain
    )


def _amount(
    evidence: Evidence, sums: AllSums, setpoints: Sequence[float], *, scale: float, drifting: bool
) -> tuple[Drift, ...]:
    """Scatter of the amount of spray between injections, an error that all pixels share.

    The change of Delta I by the amount is averaged over blocks, since it is not linear in the
    transmission. The share of the band is the one that explains most of the scatter.
    """
    source = evidence.source["reference"]
    centred = source - source.mean()
    means = [np.stack([sums[k, kind].mean() for k in setpoints]) for kind in KINDS]
    contrast = [np.tensordot(centred, mean, 1) for mean in means]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        through = np.nan_to_num(contrast[1] / contrast[0], nan=1.0)

    def pattern(band: float) -> Floats:
        """Derivative (K, B) of the injections by the amount."""
        change = by_amount(through, band=band) / scale
        blocks = [thumbnail(change * delta)[evidence.chosen] for delta in means[1] - means[0]]
        return np.array(blocks, float)

    amounts = {band: evidence.amount(pattern(band), drifting=drifting) for band in _BANDS}
    band = max(_BANDS, key=lambda share: amounts[share].explained)
    variance = amounts[band].variance
    if not variance > 0.0:
        return ()
    variances, scatter = variance / evidence.number("injection"), amounts[band].shot_variance
    return (Drift(cause="amount", variance=variances, scatter=scatter, band=band),)


def stated(
    sums: AllSums,
    setpoints: Sequence[float],
    *,
    boundary: Boundary,
    surroundings: Surroundings,
    calibration: Calibration,
) -> tuple[Drift, ...]:
    """Common errors above 0 that the user states, and those of the black body's readings.

    The readings with references are others than those with injections, so that their errors do not
    cancel where the spray is transparent.
    """
    scale = calibration.counts_per_radiance * boundary.front.transmission
    groups = {kind: [sums[k, kind] for k in setpoints] for kind in KINDS}
    backgrounds_K = np.array([group.temperature_K for group in groups["injection"]])
    rise = per_kelvin(boundary.leaving, backgrounds_K)
    none = np.zeros(len(setpoints))
    offset2 = (surroundings.camera_offset_error_counts / scale) ** 2
    variances: dict[Cause, Floats] = {
        "black body": (rise * surroundings.background_error_K) ** 2,
        "offset": none + offset2,
        "gain": none + surroundings.camera_gain_error**2,
    }
    drifts = [Drift(cause=cause, variance=variance) for cause, variance in variances.items()]
    for kind, of_kind in groups.items():
        readings_K2 = np.array([group.temperature_variance_K2 for group in of_kind])
        drifts.append(
            Drift(
                cause="black body",
                variance=rise**2 * readings_K2,
                in_reference=kind == "reference",
                in_injection=kind == "injection",
            )
        )
    return tuple(error for error in drifts if error.variance.any())


def _stated_K2(drifts: Sequence[Drift], evidence: Evidence) -> Floats:
    """Variance (K,) of the references due to stated errors, as kelvin^2 of the black body."""
    squares = (
        error.variance * unit(evidence, error.cause) ** 2 / evidence.rise**2
        for error in drifts
        if error.in_reference
    )
    return sum(squares, np.zeros(len(evidence.setpoints)))
