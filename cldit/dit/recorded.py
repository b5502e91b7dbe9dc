"""Differential infrared thermography of recorded shots."""

import json
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.camera.calibration import Calibration
from cldit.camera.curve import Curve, CurveFit, fit_curve
from cldit.dit.agreement import agreeing
from cldit.dit.budget import PARTS, Budget, Part, budget, common_parts, curve_boundary
from cldit.dit.camera_of_shots import completed, defective, seeing, stated_saturation
from cldit.dit.chance import FEW, IMPROBABLE
from cldit.dit.drift_axis import DriftAxis, drift_axis
from cldit.dit.evaluate import blocks, check_span, stack
from cldit.dit.film import check_depths, check_turns, damaged, lag, repeats
from cldit.dit.maps import EVALUATION, Maps, Reason
from cldit.dit.outliers import Outlier, check_not_mirrored, outliers
from cldit.dit.scattering import MEDIUM
from cldit.dit.shots import Acquisition, AllSums, accumulate, check_shots, exclude, ignore_saturated
from cldit.dit.solve import KINDS, Signals, solve
from cldit.dit.witness.examine import Examined, examine, examine_images
from cldit.dit.witness.finding import Witness, refuse
from cldit.dit.witness.levels import brightness
from cldit.dit.witness.trend import DriftTerm
from cldit.errors import EvaluationError
from cldit.io.digests import write_sealed
from cldit.io.files import written
from cldit.io.origin import Origin, versions
from cldit.optics.response import from_plain
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.radiance.boundary import Boundary

Watch = Callable[[int, int], None]

CurveSource = Literal["planck", "fitted"]


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
        finite = np.isfinite(chance)
        return float(np.mean(chance[finite] < IMPROBABLE)) if finite.any() else 0.0

    @property
    def lines(self) -> tuple[str, ...]:
        """Lines for the report: remarks, witnesses, goodness of fit, and the budget."""
        lines = [*self.remarks, *(witness.text for witness in self.witnesses)]
        lines += [self.drift_axis] if self.drift_axis else []
        if np.isfinite(self.maps.fit_probability).any():
            lines.append(
                f"{100.0 * self.improbable:.2g} % of the pixels have a fit_probability below "
                f"{IMPROBABLE:g}; chance gives {100.0 * IMPROBABLE:g} %"
            )
        if self.budget is not None:
            lines += self.budget.lines
        return tuple(lines)

    def save(self, folder: Path, *, pixel_m: tuple[float, float]) -> None:
        """Writes the maps, the budget and the rest into `folder`, with pixels of `pixel_m`.

        The parts of the budget and the maps of a model that an earlier evaluation wrote are
        removed: this one may have others. Raises FileError and DiskFull.
        """
        earlier = (*(folder / PARTS).glob("*.tif"), *(folder / f"{name}.tif" for name in MEDIUM))
        with written(folder):
            for path in earlier:
                path.unlink(missing_ok=True)
        self.maps.save(folder, pixel_m=pixel_m)
        if self.budget is not None:
            self.budget.save(folder, pixel_m=pixel_m)
        files = [folder / f"{item.name}.tif" for item in fields(Maps)]
        write_sealed(folder / EVALUATION, self.to_dict(), [*files, *(folder / PARTS).glob("*.tif")])

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
            "witnesses": [witness.to_dict() for witness in self.witnesses],
            "drifts": [term.to_dict() for term in self.drifts],
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

    Shots of one set point are averaged, without damaged ones (`cldit.dit.film`) and outliers
    (`cldit.dit.outliers`), one image in memory at a time (48 bytes per pixel and background). A
    background at which a pixel is saturated is ignored for this pixel. Missing values of
    counts_per_radiance and noise are estimated from the references.

    Args:
        acquisition: recorded shots and properties of the rig.
        curve: from Planck's law over the filter, or fitted to the references (`fit_curve`).
        accept: names of witnesses that do not end the evaluation.
        progress: called with (shots read, shots in all).

    Returns:
        Maps (H, W), checks, remarks and calibration.

    Raises:
        EvaluationError: data are missing, inconsistent or swapped; a witness is not accepted.
    """
    shots = _read(acquisition, accept=accept, progress=progress)
    checked = _check(shots, acquisition, curve=curve, accept=accept)
    maps, common, degrees = _solved(shots, checked)
    backgrounds = sum(~shots.full(setpoint) for setpoint in shots.setpoints)
    maps, widened = agreeing(maps, np.asarray(backgrounds))
    if shots.bad.any():
        maps = _without(maps, shots.bad)
    _check_not_swapped(maps)
    refuse(checked.witnesses, accept)
    return Evaluation(
        maps=maps,
        remarks=(*shots.remarks, *([widened] if widened else []), *_remarks(shots, checked.fitted)),
        outliers=shots.outliers,
        fitted=checked.fitted,
        calibration=checked.calibration,
        witnesses=checked.witnesses,
        drifts=checked.examined.terms,
        drift_axis=shots.axis.line(through=checked.examined.through),
        degrees_of_freedom=degrees,
        budget=budget(
            maps,
            acquisition.surroundings,
            curve=checked.curve,
            backgrounds_K=shots.temperatures_K("reference"),
            calibration=checked.calibration,
            common=common,
        ),
    )


@dataclass(frozen=True, kw_only=True)
class _Shots:
    """Averaged images at K `setpoints`, without those that are damaged or outliers.

    bad: (H, W) defective pixels. remarks: on images and backgrounds that are ignored. witnesses: of
    the images alone.
    """

    sums: AllSums
    setpoints: Sequence[float]
    axis: DriftAxis
    bad: Mask
    remarks: Sequence[str]
    outliers: tuple[Outlier, ...]
    witnesses: Sequence[Witness]

    def temperatures_K(self, kind: str) -> list[float]:
        """Mean temperature of each background with this `kind`."""
        return [self.sums[setpoint, kind].temperature_K for setpoint in self.setpoints]

    def full(self, setpoint: float) -> Mask:
        """(H, W) pixels that are saturated in one image of this background or more."""
        return self.sums[setpoint, "reference"].full | self.sums[setpoint, "injection"].full


def _read(acquisition: Acquisition, *, accept: Collection[str], progress: Watch | None) -> _Shots:
    """Reads and averages the shots; refuses images that are no counts of one camera."""
    setpoints = check_shots(acquisition.shots)
    stated_counts = stated_saturation(acquisition.calibration)
    axis = drift_axis(acquisition.shots)
    sums, remarks = accumulate(acquisition, stated_counts, progress, places=axis.places)
    check_depths(sums)
    check_turns(sums)
    lagging = lag(sums)
    broken = damaged(sums) | ({} if "repeats" in accept else repeats(sums))
    remarks += exclude(acquisition, sums, broken, needed=True)
    odd = outliers(sums)
    remarks += exclude(acquisition, sums, {shot.id: shot.text for shot in odd})
    witnesses, saturation = examine_images(
        sums, setpoints, acquisition.surroundings, saturation_counts=stated_counts
    )
    for group in sums.values():
        group.saturation_counts = saturation
    bad = defective(sums, acquisition.bad_pixels)
    planck = Curve(filter_um=from_plain(acquisition.calibration["filter_um"]))
    levels = brightness(sums, setpoints, bad=bad, source=planck.radiance(setpoints))
    refuse([] if levels is None else [levels], accept)
    remarks += ignore_saturated(sums, bad)
    return _Shots(
        sums=sums,
        setpoints=sorted({setpoint for setpoint, _ in sums}),
        axis=axis,
        bad=bad,
        remarks=remarks,
        outliers=odd,
        witnesses=[*witnesses, *(item for item in (lagging, levels) if item is not None)],
    )


@dataclass(frozen=True, kw_only=True)
class _Checked:
    """Checked camera and boundary of the shots. fitted: the curve, if fitted to the references.
    sources: (K,) radiance of the background by kind."""

    curve: Curve
    fitted: CurveFit | None
    boundary: Boundary
    sources: Mapping[str, Floats]
    calibration: Calibration
    examined: Examined
    witnesses: tuple[Witness, ...]


def _check(
    shots: _Shots, acquisition: Acquisition, *, curve: CurveSource, accept: Collection[str]
) -> _Checked:
    """Compares the shots with each other; refuses what is severe and not accepted."""
    sums, setpoints = shots.sums, shots.setpoints
    sees = seeing(sums, setpoints, shots.bad)
    used = planck = Curve(filter_um=from_plain(acquisition.calibration["filter_um"]))
    fitted = None
    if curve == "fitted":
        counts = [np.mean(sums[k, "reference"].mean()[sees]) for k in setpoints]
        temperatures_K = np.array(shots.temperatures_K("reference"))
        fitted = fit_curve(temperatures_K, np.array(counts), filter_um=planck.filter_um)
        used = fitted.curve
    surroundings = acquisition.surroundings
    boundary = curve_boundary(surroundings, used, setpoints)
    sources: dict[str, Floats] = {}
    for kind in KINDS:
        means = shots.temperatures_K(kind)
        sources[kind] = boundary.leaving(means)
        check_span(sources[kind], means)
    refuse(shots.witnesses, accept)
    calibration = completed(
        acquisition.calibration, sums, sees, sources["reference"] * boundary.front.transmission
    )
    examined = examine(
        sums,
        setpoints,
        sees=sees,
        boundary=boundary,
        surroundings=surroundings,
        calibration=calibration,
        unfitted=None if fitted is None else curve_boundary(surroundings, planck, setpoints),
    )
    witnesses = (*shots.witnesses, *examined.witnesses)
    check_not_mirrored(sums, sources)
    refuse([witness for witness in witnesses if witness.name != "kinds"], accept)
    return _Checked(
        curve=used,
        fitted=fitted,
        boundary=boundary,
        sources=sources,
        calibration=calibration,
        examined=examined,
        witnesses=witnesses,
    )


def _solved(shots: _Shots, checked: _Checked) -> tuple[Maps, tuple[Part, ...], tuple[float, ...]]:
    """Solves for the maps, their common errors, and the degrees of freedom of the shots' scatter.

    Offsets of camera and front window are in the lines' intercepts.
    """
    sums, setpoints = shots.sums, shots.setpoints
    examined, calibration = checked.examined, checked.calibration
    scale = calibration.counts_per_radiance * checked.boundary.front.transmission
    steady = any(drift.modes.any() for drift in examined.drifts) and all(
        group.spare(steady=True) > 1.0 for group in sums.values()
    )
    injections = [sums[setpoint, "injection"] for setpoint in setpoints]
    common_removed = all(
        group.spare(steady=steady, common_removed=True) >= 1.0 for group in injections
    )

    def camera(signal: Floats) -> Floats:
        counts = signal * scale + calibration.offset_counts
        return calibration.variance_counts2(counts) / scale**2

    def signals(kind: str, rows: slice) -> Signals:
        groups = [sums[setpoint, kind] for setpoint in setpoints]
        mean = np.stack([group.mean(rows) for group in groups])
        observed = [
            group.variance(rows, steady=steady, common_removed=common_removed) for group in groups
        ]
        spare = [group.spare(steady=steady, common_removed=common_removed) for group in groups]
        return Signals(
            source=checked.sources[kind],
            mean=(mean - calibration.offset_counts) / scale,
            camera=camera,
            exposures=np.array([group.exposures for group in groups]),
            observed=np.stack(observed) / scale**2,
            spare=np.array(spare),
            common_removed=common_removed,
        )

    full = {setpoint: shots.full(setpoint) for setpoint in setpoints}
    parts: list[Maps] = []
    shared: list[Floats] = []
    for rows in blocks(full[setpoints[0]].shape, len(setpoints)):
        part, changes = solve(
            signals("reference", rows),
            signals("injection", rows),
            usable=~np.stack([full[setpoint][rows] for setpoint in setpoints]),
            curve=checked.curve,
            drifts=examined.drifts,
            systematic=examined.systematic.rows(rows),
        )
        part.reason[part.reason == Reason.TOO_FEW_BACKGROUNDS] = Reason.SATURATED
        parts.append(part)
        shared.append(np.where(shots.bad[rows], np.nan, changes))
    maps = stack(parts)
    degrees = tuple(
        group.spare(steady=steady, common_removed=common_removed) for group in injections
    )
    common = common_parts(maps, *np.concatenate(shared, axis=2))
    return maps, common, degrees if all(degrees) else ()


def _without(maps: Maps, bad: Mask) -> Maps:
    images = {
        item.name: np.where(bad, np.float32(np.nan), getattr(maps, item.name))
        for item in fields(Maps)
        if item.name != "reason"
    }
    return replace(maps, **images, reason=np.where(bad, np.uint8(Reason.BAD_PIXEL), maps.reason))


def _check_not_swapped(maps: Maps) -> None:
    """Checks that the emissivity is positive in most pixels; otherwise the kinds are swapped."""
    sure = np.maximum(5.0 * maps.emissivity_standard_error, VISIBLE_EMISSIVITY)
    negative = int(np.count_nonzero(maps.emissivity < -sure))
    positive = int(np.count_nonzero(maps.emissivity > sure))
    if negative > max(positive, 1e-3 * maps.emissivity.size):
        raise EvaluationError(
            f"{negative} pixels see more of the background in the injections than in the "
            f"references (and {positive} less): are references and injections swapped?"
        )


def _remarks(shots: _Shots, fitted: CurveFit | None) -> list[str]:
    lines: list[str] = []
    if fitted is not None:
        lines.append(f"calibration curve of the references: {fitted.text}")
    for setpoint in shots.setpoints:
        share = float(np.mean(shots.full(setpoint)))
        if share > FEW:
            lines.append(
                f"background {setpoint:g} K: {100 * share:.0f} % of the pixels are saturated and "
                "are evaluated without it"
            )
    return lines
