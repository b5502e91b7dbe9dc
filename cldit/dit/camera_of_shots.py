"""The camera as its images show it: defective pixels, view of the background, calibration."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.camera.calibration import Calibration
from cldit.camera.photon_transfer import photon_transfer
from cldit.dit.shots import AllSums
from cldit.errors import EvaluationError

SEES = 0.5  # share of the strongest contrast at which a pixel sees the background


def stated_saturation(calibration: Mapping[str, Any]) -> float:
    """Level of saturation in counts, as the calibration states it."""
    try:
        return float(calibration["saturation_counts"])
    except (KeyError, TypeError, ValueError) as error:
        raise EvaluationError(
            f"calibration.saturation_counts: missing or no number ({error})"
        ) from error


def defective(sums: AllSums, named: Mask | None) -> Mask:
    """Pixels (rows, columns) that are named, or that have one value, not saturated, in all images,
    where others have noise.
    """
    groups = list(sums.values())
    value = groups[0].total / len(groups[0].ids)
    stuck, noise = ~np.any([group.full for group in groups], axis=0), False
    for group in groups:
        count = len(group.ids)
        steady = np.isclose(group.squares * count, group.total**2, rtol=1e-12, atol=0.0)
        stuck &= steady & np.isclose(group.total, count * value, rtol=1e-12, atol=0.0)
        noise = noise or not steady.all()
    bad = np.asarray(stuck if noise else np.zeros_like(stuck))
    return bad if named is None else bad | named


def seeing(sums: AllSums, setpoints: Sequence[float], bad: Mask) -> Mask:
    """Pixels with a high contrast between references of two backgrounds, never saturated."""
    cold, hot = (sums[k, "reference"].mean() for k in (setpoints[0], setpoints[-1]))
    good = np.asarray(~np.any([sums[k, "reference"].full for k in setpoints], axis=0) & ~bad)
    unsaturated = good & ~np.any([sums[k, "injection"].full for k in setpoints], axis=0)
    good = unsaturated if unsaturated.any() else good
    contrast = hot - cold
    if not good.any() or not np.percentile(contrast[good], 95) > 0.0:
        return good
    return np.asarray(good & (contrast > SEES * np.percentile(contrast[good], 95)))


def completed(stated: Mapping[str, Any], sums: AllSums, sees: Mask, seen: Floats) -> Calibration:
    """The calibration, with missing values from references that show radiances `seen` (K,)."""
    rounded = all(group.rounded for group in sums.values())
    data = {"step_counts": 1.0 if rounded else 0.0, **stated}
    groups = [group for (_, kind), group in sorted(sums.items()) if kind == "reference"]
    missing = {"counts_per_radiance", "electrons_per_count", "read_noise_electrons"} - set(data)
    if missing and not sees.any():
        raise EvaluationError(
            f"calibration: {', '.join(sorted(missing))} cannot be estimated: no pixel sees the "
            "background unsaturated"
        )
    if missing & {"electrons_per_count", "read_noise_electrons"}:
        exposures = min(len(group.ids) for group in groups)
        if exposures < 2:
            raise EvaluationError(
                "sensor: noise cannot be estimated from one reference per background; take more, "
                "or give sensor.electrons_per_count and read_noise_electrons"
            )
        several = [group for group in groups if len(group.ids) == exposures]
        data |= photon_transfer(
            np.concatenate([group.mean()[sees] for group in several]),
            np.concatenate([group.variance()[sees] for group in several]),
            exposures=exposures,
            offset_counts=data.get("offset_counts"),
            step_counts=data["step_counts"],
        )
    if "counts_per_radiance" in missing:
        means = np.array([np.mean(group.mean()[sees]) for group in groups])
        unit = float(np.max(seen))
        data["counts_per_radiance"] = float(np.polyfit(seen / unit, means, 1)[0]) / unit
        if not data["counts_per_radiance"] > 0.0:
            raise EvaluationError(
                "references: hotter backgrounds do not look brighter; check the temperatures"
            )
    return Calibration.from_dict({"offset_counts": 0.0, **data})
