"""Profiles of two results along a spray's axis and across it, with errors, and their difference."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cldit.arrays import Floats
from cldit.comparison.regions import Spray2D
from cldit.comparison.shown import Shown
from cldit.comparison.tested import Mode
from cldit.dit.profile import Profile, pixels_at, profile_of

_LEAST = 1e-3  # length of the mean direction of a spray that has one
_INSIDE = 1.0 - 1e-9  # of half the image, for rounding


@dataclass(frozen=True, kw_only=True)
class LineDifference:
    """Profiles of `one` and `other` at the same N points, and other minus one, (N,) each.

    title: position of the line. Distances are from the injector's tip along the axis, or from the
    axis across it. Errors are those that the two do not share. The change of T_app is NaN where the
    spray is not visible in both; errors of changes contain those that all pixels share.
    """

    title: str
    one: Profile
    other: Profile
    change_K: Floats
    change_error_K: Floats
    emissivity_change_error: Floats

    @property
    def emissivity_change(self) -> Floats:
        """Difference of the emissivities."""
        return self.other.emissivity - self.one.emissivity

    @property
    def columns(self) -> dict[str, Floats]:
        """Columns of a table by name."""
        columns = {name: getattr(self.one, name) for name in ("distance_m", "x_m", "z_m")}
        for name in _VALUES:
            columns |= {f"one_{name}": getattr(self.one, name)}
            columns |= {f"other_{name}": getattr(self.other, name)}
        changes = ("change_K", "change_error_K", "emissivity_change", "emissivity_change_error")
        return columns | {name: getattr(self, name) for name in changes}


_VALUES = (
    "apparent_temperature_K",
    "apparent_temperature_standard_error_K",
    "emissivity",
    "emissivity_standard_error",
)


def line_differences(
    seen: Sequence[Shown],
    spray: Spray2D,
    change_K: Floats,
    *,
    error_K: Floats,
    modes: Sequence[Mode],
) -> dict[str, LineDifference]:
    """Profiles `axis`, from the injector's tip, and `across`, at half the reach of the spray.

    seen: two results on the same pixels. spray: as visible in both. change_K, error_K: (H, W) of
    the second minus the first; modes: errors that all pixels share. The axis has the mean direction
    of the spray, by emissivity, or is straight down if it has none. Without a visible spray there
    are none.
    """
    visible = spray.visible
    if not visible.any():
        return {}
    weight = spray.emissivity[visible]
    far_m = np.hypot(spray.x_m, spray.z_m)
    x_m, z_m = (float(np.sum(weight * at[visible])) for at in (spray.x_m, spray.z_m))
    directed = math.hypot(x_m, z_m) > _LEAST * float(np.sum(weight * far_m[visible]))
    angle_deg = math.degrees(math.atan2(x_m, -z_m)) if directed else 0.0
    turn, away_m = math.radians(angle_deg), spray.reach_m / 2.0
    middle_m = away_m * math.sin(turn), -away_m * math.cos(turn)
    lines = {
        "axis": _both(seen, (0.0, 0.0), angle_deg, 0.0),
        "across": _both(seen, middle_m, angle_deg + 90.0, -math.inf),
    }
    titles = {
        "axis": f"along the axis, {angle_deg:.1f}° from downwards",
        "across": f"across it, {1e3 * away_m:.3g} mm from the tip",
    }
    square = sum((mode.emissivity**2 for mode in modes), np.zeros(change_K.shape))
    for shown in seen:
        common = sum((np.nan_to_num(part.emissivity) ** 2 for part in shown.common), 0.0)
        square = square + np.maximum(shown.maps.emissivity_standard_error**2 - common, 0.0)
    differences = {}
    for name, pair in lines.items():
        if pair is not None:
            line = pair[0]
            at = pixels_at(change_K.shape, seen[0].pixel_m, seen[0].centre_m, line.x_m, line.z_m)
            differences[name] = LineDifference(
                title=titles[name],
                one=pair[0],
                other=pair[1],
                change_K=np.where(visible, change_K, np.nan)[at],
                change_error_K=np.where(visible, error_K, np.nan)[at],
                emissivity_change_error=np.sqrt(square)[at],
            )
    return differences


def _both(
    seen: Sequence[Shown], through_m: tuple[float, float], angle_deg: float, least_m: float
) -> tuple[Profile, Profile] | None:
    """Profiles of two along a line, from `least_m` or where it enters; None beside the image."""
    place = {"pixel_m": seen[0].pixel_m, "centre_m": seen[0].centre_m}
    shape = seen[0].maps.emissivity.shape
    half_m = [n * p / 2.0 for n, p in zip(reversed(shape), place["pixel_m"], strict=True)]
    along = math.sin(math.radians(angle_deg)), -math.cos(math.radians(angle_deg))
    step_m = min(place["pixel_m"])
    count = int(2.0 * math.hypot(*half_m, math.dist(through_m, place["centre_m"])) / step_m)
    away_m = np.arange(-count, count + 1) * step_m
    inside = away_m >= least_m
    for start, step, centre, half in zip(through_m, along, place["centre_m"], half_m, strict=True):
        inside &= np.abs(start + away_m * step - centre) < _INSIDE * half
    if not inside.any():
        return None
    first_m = float(away_m[np.argmax(inside)])
    start_m = (through_m[0] + first_m * along[0], through_m[1] + first_m * along[1])
    profiles = []
    for shown in seen:
        warm, emissivity = _errors(shown)
        maps = replace(shown.maps, emissivity_standard_error=emissivity.astype(np.float32))
        profile = profile_of(
            maps, **place, start_m=start_m, angle_deg=angle_deg, temperature_error_K=warm
        )
        profiles.append(replace(profile, distance_m=profile.distance_m + first_m))
    return profiles[0], profiles[1]


def _errors(shown: Shown) -> tuple[Floats, Floats]:
    """Standard errors of T_app and emissivity, systematic ones too; NaN if not stated."""
    error_K = shown.error_map_K
    if error_K is None:
        stated_K = math.nan if shown.error_K is None else shown.error_K
        error_K = np.full(shown.maps.emissivity.shape, stated_K)
    emissivity = shown.maps.emissivity_standard_error.astype(np.float64)
    for part in shown.systematic:
        error_K = np.hypot(error_K, np.nan_to_num(part.kelvin))
        emissivity = np.hypot(emissivity, np.nan_to_num(part.emissivity))
    return error_K, emissivity
