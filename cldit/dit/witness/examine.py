"""All witnesses of recorded shots, and their contributions to the errors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.camera.calibration import Calibration
from cldit.dit.shots import AllSums, thumbnail
from cldit.dit.solve import KINDS, Cause, Drift, Systematic, by_amount
from cldit.dit.witness import backgrounds, drift, images
from cldit.dit.witness.backgrounds import CLEAREST, clearest, slopes
from cldit.dit.witness.evidence import Evidence, per_kelvin
from cldit.dit.witness.finding import Witness
from cldit.dit.witness.kinds import kinds
from cldit.dit.witness.levels import levels
from cldit.dit.witness.orientation import orientation
from cldit.dit.witness.pixels import Patterns, between_backgrounds, between_kinds
from cldit.dit.witness.shift import shift
from cldit.dit.witness.trend import DriftTerm, terms
from cldit.radiance.boundary import Boundary, Surroundings

_BANDS = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1)  # shares of the filter in which a spray absorbs
_THIN = 0.98  # share of the background behind thin spray


@dataclass(frozen=True, kw_only=True)
class Examined:
    """Witnesses, and errors for the fit. terms: the drifts in kelvin. through: True if a drift
    continues through breaks."""

    witnesses: tuple[Witness, ...]
    drifts: tuple[Drift, ...]
    systematic: Systematic
    terms: tuple[DriftTerm, ...] = ()
    through: bool = False


def examine_images(
    sums: AllSums, setpoints: Sequence[float], around: Surroundings, *, saturation_counts: float
) -> tuple[list[Witness], float]:
    """Witnesses that need no radiance and found something, and the level of saturation."""
    named_K = {f"background {k:g}": sums[k, "reference"].temperature_K for k in setpoints}
    named_K["walls"] = around.wall_temperature_K
    named_K |= {f"{window.side} window": window.temperature_K for window in around.windows}
    ending, saturation = images.plateau(sums, saturation_counts)
    found = [
        backgrounds.celsius(named_K),
        ending,
        images.axes(sums, setpoints),
        orientation(sums, setpoints),
    ]
    return [one for one in found if one is not None], saturation


def examine(
    sums: AllSums,
    setpoints: Sequence[float],
    *,
    sees: Mask,
    whole: Boundary,
    around: Surroundings,
    calibration: Calibration,
    unfitted: Boundary | None = None,
) -> Examined:
    """Comparisons of the shots with each other.

    whole: measurement equation in the filter. unfitted: `whole` with the filter as stated, if the
    curve was fitted to the references.
    """
    given = stated(sums, setpoints, whole=whole, around=around, calibration=calibration)
    if not Evidence.of_blocks(sees).any():
        return Examined(witnesses=(), drifts=given, systematic=Systematic())
    warm_K = [
        *setpoints,
        around.wall_temperature_K,
        around.background_surroundings_K or 0.0,
        *(window.temperature_K for window in around.windows),
    ]

    def seen_as(of: Boundary) -> Evidence:
        return Evidence.of(
            sums, setpoints, sees=sees, whole=of, calibration=calibration, warmest_K=max(warm_K)
        )

    evidence = seen_as(whole)
    scale = calibration.counts_per_radiance * whole.front.transmission
    stated_K = np.sqrt(_stated_K2(given, evidence))
    lined, off = backgrounds.references(evidence, stated_K=stated_K)
    common = drift.find(evidence, off, stated_K=stated_K)
    if common.cause and lined.stands_out and not lined.severe:
        lined = replace(lined, says=f"{lined.says}, {common.cause}")
    if unfitted is not None:
        lined = backgrounds.fitted_over(seen_as(unfitted), lined, stated_K=stated_K)
    between, systematic = kinds(evidence)
    uneven = levels(evidence)
    moved, widened = shift(
        sums,
        setpoints,
        sees=sees,
        source=evidence.source["reference"],
        counts_per_kelvin=evidence.rise * scale,
    )
    x = evidence.source["reference"]
    patterns = Patterns.of(
        sums,
        setpoints,
        sees=sees,
        source=x,
        calibration=calibration,
        amount2=evidence.scatter()[1],
    )
    lying, extra = between_backgrounds(
        patterns,
        stated=_stated_K2(given, evidence) * (evidence.rise * scale) ** 2,
        names=[f"{setpoint:g} K" for setpoint in setpoints],
    )
    clear = clearest(evidence)
    renewed = between_kinds(
        patterns,
        clear=evidence.pixels(clear),
        half=evidence.pixels(clearest(evidence, share=0.5 * CLEAREST)),
        wide=evidence.pixels(clear | (slopes(evidence) > _THIN)),
        thin=max(float(1.0 - np.mean(slopes(evidence)[clear])), 0.0),
        warmest=max(1.0, evidence.warmest / float(x.max())),
        rise_counts=evidence.rise * scale,
    )
    extra = {name: one if name == "gain" else one / scale**2 for name, one in extra.items()}
    if widened:
        spray = np.array([widened.get(k, np.zeros(sees.shape)) for k in setpoints]) / scale**2
        extra["injection"] = np.maximum(spray, extra.get("injection", 0.0))
    drifting = bool(common.drifts)
    return Examined(
        witnesses=(
            lined,
            backgrounds.injections(evidence, stated_K=stated_K),
            between,
            moved,
            *(one for one in (lying, renewed.witness, uneven) if one is not None),
        ),
        drifts=(
            *given,
            *common.drifts,
            *_amount(evidence, sums, setpoints, scale=scale, drifting=drifting),
        ),
        systematic=replace(
            systematic,
            extra=extra,
            pixel_offset=renewed.offset_counts / scale,
            pixel_gain=renewed.gain,
        ),
        terms=terms(evidence, given=given, found=common.drifts),
        through=common.through,
    )


def _amount(
    evidence: Evidence,
    sums: AllSums,
    setpoints: Sequence[float],
    *,
    scale: float,
    drifting: bool,
) -> tuple[Drift, ...]:
    """Scatter of the amount of spray between injections, an error that all pixels share.

    The change of Delta I by the amount is averaged over blocks, since it is not linear in the
    transmission. The share of the band is the one that explains most of the scatter.
    """
    source = evidence.source["reference"]
    away = source - source.mean()
    means = [np.stack([sums[k, kind].mean() for k in setpoints]) for kind in KINDS]
    contrast = [np.tensordot(away, one, 1) for one in means]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        through = np.nan_to_num(contrast[1] / contrast[0], nan=1.0)

    def pattern(band: float) -> Floats:
        """Derivative (K, B) of the injections by the amount."""
        change = by_amount(through, band=band) / scale
        blocks = [thumbnail(change * one)[evidence.chosen] for one in means[1] - means[0]]
        return np.array(blocks, float)

    found = {band: evidence.amount(pattern(band), drifting=drifting) for band in _BANDS}
    band = max(_BANDS, key=lambda one: found[one].explained)
    variance = found[band].variance
    if not variance > 0.0:
        return ()
    return (
        replace(
            drift.still("amount", len(setpoints)),
            variance=variance / evidence.number("injection"),
            each=found[band].each,
            band=band,
        ),
    )


def stated(
    sums: AllSums,
    setpoints: Sequence[float],
    *,
    whole: Boundary,
    around: Surroundings,
    calibration: Calibration,
) -> tuple[Drift, ...]:
    """Common errors above 0 that the user states, and that of the black body's readings."""
    scale = calibration.counts_per_radiance * whole.front.transmission
    groups = [sums[k, "injection"] for k in setpoints]
    backgrounds_K = np.array([group.temperature_K for group in groups])
    readings_K2 = np.array([group.temperature_variance_K2 for group in groups])
    rise = per_kelvin(whole.leaving, backgrounds_K)
    none = np.zeros(len(setpoints))
    offset2 = (around.camera_offset_error_counts / scale) ** 2
    variances: dict[Cause, Floats] = {
        "black body": rise**2 * (around.background_error_K**2 + readings_K2),
        "offset": none + offset2,
        "gain": none + around.camera_gain_error**2,
    }
    return tuple(
        replace(drift.still(cause, len(setpoints)), variance=variance)
        for cause, variance in variances.items()
        if variance.any()
    )


def _stated_K2(drifts: Sequence[Drift], evidence: Evidence) -> Floats:
    """Variance (K,) of the references due to stated errors, as kelvin^2 of the black body."""
    total = np.zeros(len(evidence.setpoints))
    signal = evidence.mean("reference").mean(axis=1)
    for one in drifts:
        factor = signal if one.cause == "gain" else 1.0
        total += one.variance * factor**2 / evidence.rise**2
    return total
