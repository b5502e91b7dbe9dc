"""Differential infrared thermography of recorded shots."""

import json
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.camera.calibration import Calibration
from cldit.camera.curve import Curve, CurveFit, fit_curve
from cldit.dit.agreement import agreeing
from cldit.dit.budget import Budget, Part, budget, common_parts
from cldit.dit.camera_of_shots import completed, defective, seeing, stated_saturation
from cldit.dit.drift_axis import drift_axis
from cldit.dit.evaluate import blocks, check_span, stack
from cldit.dit.film import check_depths, check_turns, damaged, lag, repeats
from cldit.dit.maps import Maps, Reason
from cldit.dit.outliers import Outlier, check_not_mirrored, outliers
from cldit.dit.shots import (
    Acquisition,
    AllSums,
    accumulate,
    check_shots,
    exclude,
    ignore_saturated,
)
from cldit.dit.solve import KINDS, Signals, Solution, solve
from cldit.dit.witness.examine import Examined, examine, examine_images
from cldit.dit.witness.finding import Witness, refuse
from cldit.dit.witness.levels import brightness
from cldit.dit.witness.trend import DriftTerm
from cldit.errors import EvaluationError
from cldit.io.origin import Origin, versions
from cldit.optics.response import from_plain
from cldit.optics.spectral import reference_temperature_K
from cldit.optics.windows import band_pane
from cldit.radiance.boundary import Boundary

Watch = Callable[[int, int], None]

CurveSource = Literal["planck", "fitted"]

EVALUATION = "evaluation.json"
IMPROBABLE = 1e-3  # fit_probability of one pixel in a thousand by chance
_MUCH = 0.01  # share of saturated pixels that is reported


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Maps of an evaluation, with its checks and remarks.

    fitted: the calibration curve, if fitted to the references. calibration: as used, with values
    estimated from the images. witnesses: checks of the measurement by the shots themselves
    (`cldit.dit.witness`). drifts: covariance terms that both kinds share; drift_axis: the axis of
    the drift. degrees_of_freedom: of the estimated scatter of the shots at each background; empty
    for single shots. budget: systematic errors. origin: time, command and files; None without a
    folder.
    """

    maps: Maps
    remarks: tuple[str, ...]
    outliers: tuple[Outlier, ...]
    fitted: CurveFit | None
    calibration: Calibration
    witnesses: tuple[Witness, ...] = ()
    drifts: tuple[DriftTerm, ...] = ()
    drift_axis: str = ""
    degrees_of_freedom: tuple[float, ...] = ()
    budget: Budget | None = None
    origin: Origin | None = None

    def __repr__(self) -> str:
        return f"<Evaluation: {self.maps!r}, {len(self.lines)} lines of remarks>"

    @property
    def improbable(self) -> float:
        """Share of the pixels with a `fit_probability` below 0.001."""
        chance = self.maps.fit_probability
        known = np.isfinite(chance)
        return float(np.mean(chance[known] < IMPROBABLE)) if known.any() else 0.0

    @property
    def lines(self) -> tuple[str, ...]:
        """Lines for the report: remarks, witnesses, goodness of fit, and the budget."""
        found = [*self.remarks, *(one.text for one in self.witnesses)]
        found += [self.drift_axis] if self.drift_axis else []
        if np.isfinite(self.maps.fit_probability).any():
            found.append(
                f"{100.0 * self.improbable:.2g} % of the pixels have a fit_probability below "
                f"{IMPROBABLE:g}; chance gives {100.0 * IMPROBABLE:g} %"
            )
        if self.budget is not None:
            found += self.budget.lines
        return tuple(found)

    def to_json(self) -> str:
        """Everything but the maps, as JSON."""
        return json.dumps(self.to_dict(), indent=2, allow_nan=False)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the maps, as plain data."""
        return {
            "remarks": self.remarks,
            "odd_shots": [asdict(shot) for shot in self.outliers],
            "pixels": {reason.text: count for reason, count in self.maps.count().items()},
            "calibration": self.calibration.to_dict(),
            "witnesses": [one.to_dict() for one in self.witnesses],
            "drifts": [one.to_dict() for one in self.drifts],
            "drift_axis": self.drift_axis,
            "degrees_of_freedom": self.degrees_of_freedom,
            "improbable_share": self.improbable,
            "budget": None if self.budget is None else self.budget.to_dict(),
            "curve": None
            if self.fitted is None
            else {
                "stretch": self.fitted.curve.stretch,
                "stretch_error": self.fitted.stretch_error,
                "residual_K": self.fitted.residual_K,
            },
            "versions": versions(),
            "origin": None if self.origin is None else self.origin.to_dict(),
        }


@contextmanager
def _solvable() -> Iterator[None]:
    """Turns a failure of linear algebra, on images of which no check knows, into an error."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise EvaluationError(
            f"the lines of the pixels have no solution ({error}); are the images of a camera that "
            "sees the background, unsaturated at two temperatures?"
        ) from error


@_solvable()
def evaluate_shots(
    acquisition: Acquisition,
    *,
    curve: CurveSource = "planck",
    accept: Collection[str] = (),
    progress: Watch | None = None,
) -> Evaluation:
    """DIT of recorded shots.

    Shots of one set point are averaged, without those that are damaged (`cldit.dit.film`) or
    outliers (`cldit.dit.outliers`); their groups are read a second time. One image is in memory at
    a time, so memory grows with the number of backgrounds only (48 bytes per pixel each). A
    background at which a pixel is saturated is ignored for this pixel. Standard errors: see
    `cldit.dit.solve.solve`. Missing values of counts_per_radiance and noise are estimated from the
    references.

    Args:
        acquisition: recorded shots and properties of the rig.
        curve: from Planck's law over the filter, or fitted to the references (`fit_curve`).
        accept: names of witnesses (`cldit.dit.witness.finding.ACCEPTABLE`) that do not end the
            evaluation.
        progress: called with (shots read, shots in all).

    Raises:
        EvaluationError: data are missing or inconsistent; references and injections are swapped; a
            witness is severe and not accepted.
    """
    setpoints = check_shots(acquisition.shots)
    stated_counts = stated_saturation(acquisition.calibration)
    axis = drift_axis(acquisition.shots)
    sums, ignored = accumulate(acquisition, stated_counts, progress, places=axis.places)
    check_depths(sums)
    check_turns(sums)
    lagging = lag(sums)
    broken = damaged(sums) | ({} if "repeats" in accept else repeats(sums))
    ignored += exclude(acquisition, sums, broken, needed=True)
    odd = outliers(sums)
    ignored += exclude(acquisition, sums, {shot.id: shot.text for shot in odd})
    around = acquisition.surroundings
    witnesses, saturation = examine_images(sums, setpoints, around, saturation_counts=stated_counts)
    witnesses += [] if lagging is None else [lagging]
    for group in sums.values():
        group.saturation_counts = saturation
    bad = defective(sums, acquisition.bad_pixels)
    filter_um = from_plain(acquisition.calibration["filter_um"])
    chosen = Curve(filter_um=filter_um)
    levels = brightness(sums, setpoints, bad=bad, source=chosen.radiance(setpoints))
    witnesses += [] if levels is None else [levels]
    refuse([one for one in witnesses if one.name == "levels"], accept)
    ignored += ignore_saturated(sums, bad)
    setpoints = sorted({setpoint for setpoint, _ in sums})
    sees = seeing(sums, setpoints, bad)
    fitted = None
    if curve == "fitted":
        counts = [np.mean(sums[k, "reference"].mean()[sees]) for k in setpoints]
        temperatures_K = [sums[k, "reference"].temperature_K for k in setpoints]
        fitted = fit_curve(np.array(temperatures_K), np.array(counts), filter_um=filter_um)
        chosen = fitted.curve
    middle_K = reference_temperature_K(setpoints)

    def boundary(of: Curve) -> Boundary:
        return Boundary.of(
            around,
            of.radiance,
            lambda window: band_pane(window, filter_um, reference_K=middle_K),
        )

    whole = boundary(chosen)
    sources: dict[str, Floats] = {}
    for kind in KINDS:
        means = [sums[setpoint, kind].temperature_K for setpoint in setpoints]
        sources[kind] = whole.leaving(means)
        check_span(sources[kind], means)
    refuse(witnesses, accept)
    calibration = completed(
        acquisition.calibration, sums, sees, sources["reference"] * whole.front.transmission
    )
    examined = examine(
        sums,
        setpoints,
        sees=sees,
        whole=whole,
        around=around,
        calibration=calibration,
        unfitted=None if fitted is None else boundary(Curve(filter_um=filter_um)),
    )
    witnesses += examined.witnesses
    check_not_mirrored(sums, sources)
    refuse([one for one in witnesses if one.name != "kinds"], accept)
    maps, common, degrees = _solved(
        sums,
        setpoints,
        sources,
        calibration=calibration,
        curve=chosen,
        transmission=whole.front.transmission,
        examined=examined,
    )
    backgrounds = sum(~(sums[k, "reference"].full | sums[k, "injection"].full) for k in setpoints)
    maps, wider = agreeing(maps, np.asarray(backgrounds))
    ignored += [wider] if wider else []
    if bad.any():
        maps = _without(maps, bad)
    _check_not_swapped(maps)
    refuse(witnesses, accept)
    return Evaluation(
        maps=maps,
        remarks=tuple([*ignored, *_remarks(sums, fitted)]),
        outliers=odd,
        fitted=fitted,
        calibration=calibration,
        witnesses=tuple(witnesses),
        drifts=examined.terms,
        drift_axis=axis.said(through=examined.through),
        degrees_of_freedom=degrees,
        budget=budget(
            maps,
            around,
            curve=chosen,
            backgrounds_K=[sums[k, "reference"].temperature_K for k in setpoints],
            calibration=calibration,
            common=common,
        ),
    )


def _solved(
    sums: AllSums,
    setpoints: Sequence[float],
    sources: Mapping[str, Floats],
    *,
    calibration: Calibration,
    curve: Curve,
    transmission: float,
    examined: Examined,
) -> tuple[Maps, tuple[Part, ...], tuple[float, ...]]:
    """Solves for the maps, their common errors, and the degrees of freedom of the shots' scatter.

    Offsets of camera and front window are in the lines' intercepts.
    """
    scale = calibration.counts_per_radiance * transmission
    steady = any(drift.modes.any() for drift in examined.drifts) and all(
        group.spare(steady=True) > 1.0 for group in sums.values()
    )
    injections = [sums[setpoint, "injection"] for setpoint in setpoints]
    apart = all(group.spare(steady=steady, apart=True) >= 1.0 for group in injections)

    def signals(kind: str, rows: slice) -> Signals:
        found = [sums[setpoint, kind] for setpoint in setpoints]

        def camera(signal: Floats) -> Floats:
            counts = signal * scale + calibration.offset_counts
            return calibration.variance_counts2(counts) / scale**2

        return Signals(
            source=sources[kind],
            mean=(np.stack([item.mean(rows) for item in found]) - calibration.offset_counts)
            / scale,
            camera=camera,
            exposures=np.array([item.exposures for item in found]),
            observed=np.stack([item.variance(rows, steady=steady, apart=apart) for item in found])
            / scale**2,
            spare=np.array([item.spare(steady=steady, apart=apart) for item in found]),
            apart=apart,
        )

    full = {k: sums[k, "reference"].full | sums[k, "injection"].full for k in setpoints}
    parts: list[Solution] = []
    for rows in blocks(full[setpoints[0]].shape, len(setpoints)):
        part = solve(
            signals("reference", rows),
            signals("injection", rows),
            usable=~np.stack([full[setpoint][rows] for setpoint in setpoints]),
            curve=curve,
            drifts=examined.drifts,
            systematic=examined.systematic.rows(rows),
        )
        reason = part.maps.reason
        reason[reason == Reason.TOO_FEW_BACKGROUNDS] = Reason.SATURATED
        parts.append(part)
    maps = stack([one.maps for one in parts])
    kelvin = np.concatenate([one.shared_K for one in parts], axis=1)
    emissivity = np.concatenate([one.shared_emissivity for one in parts], axis=1)
    degrees = tuple(group.spare(steady=steady, apart=apart) for group in injections)
    return maps, common_parts(maps, kelvin, emissivity), degrees if all(degrees) else ()


def _without(maps: Maps, bad: Mask) -> Maps:
    images = {
        item.name: np.where(bad, np.float32(np.nan), getattr(maps, item.name))
        for item in fields(Maps)
        if item.name != "reason"
    }
    return replace(maps, **images, reason=np.where(bad, np.uint8(Reason.BAD_PIXEL), maps.reason))


def _check_not_swapped(maps: Maps) -> None:
    """Checks that the emissivity is positive in most pixels; otherwise the kinds are swapped."""
    sure = np.maximum(5.0 * maps.emissivity_standard_error, 0.05)
    more = int(np.count_nonzero(maps.emissivity < -sure))
    less = int(np.count_nonzero(maps.emissivity > sure))
    if more > max(less, 1e-3 * maps.emissivity.size):
        raise EvaluationError(
            f"{more} pixels see more of the background in the injections than in the references "
            f"(and {less} less): are references and injections swapped?"
        )


def _remarks(sums: AllSums, fitted: CurveFit | None) -> list[str]:
    lines: list[str] = []
    if fitted is not None:
        lines.append(f"calibration curve of the references: {fitted.text}")
    for setpoint in sorted({setpoint for setpoint, _ in sums}):
        share = float(np.mean(sums[setpoint, "reference"].full | sums[setpoint, "injection"].full))
        if share > _MUCH:
            lines.append(
                f"background {setpoint:g} K: {100 * share:.0f} % of the pixels are saturated and "
                "are evaluated without it"
            )
    return lines
