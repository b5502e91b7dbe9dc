"""Bias and errors of the evaluation on shots that were made from a known spray."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.camera.calibration import Calibration
from cldit.dit.recorded import evaluate_shots
from cldit.optics.planck import band_radiance
from cldit.radiance.boundary import Boundary, Surroundings
from cldit.scene.vessel import Window

TRUTH_K = 430.0
EMISSIVITIES = (0.05, 0.1, 0.3, 0.6, 0.9, 1.0)
_FILTER = (3.3, 3.5)
_BACKGROUNDS_K = (400.0, 440.0, 480.0, 520.0, 560.0)
_CAMERA = Calibration(
    filter_um=_FILTER,
    counts_per_radiance=1.2e-17,
    offset_counts=300.0,
    electrons_per_count=40.0,
    read_noise_electrons=200.0,
    saturation_counts=16383.0,
)
_BARE = Surroundings(wall_temperature_K=450.0)
_FULL = Surroundings(
    wall_temperature_K=450.0,
    background_emissivity=0.92,
    background_surroundings_K=310.0,
    camera_surroundings_K=296.0,
    windows=(
        Window(side="rear", material="CaF2", thickness_m=0.01, temperature_K=400.0),
        Window(side="front", material="sapphire", thickness_m=0.02, temperature_K=380.0),
    ),
)


@dataclass(frozen=True)
class TruthRow:
    """Pixels of one emissivity. bias_K, error_K: of T_app, in the mean, and as stated.

    chi2_K, chi2_emissivity: variance about the truth over the stated one; 1 is right.
    """

    surroundings: str
    emissivity: float
    bias_K: float
    error_K: float
    chi2_K: float
    emissivity_bias: float
    chi2_emissivity: float


@dataclass(frozen=True)
class _Shot:
    id: str
    kind: str
    background_setpoint_K: float
    background_K: float
    image: NDArray[np.uint16]


@dataclass
class _Recorded:
    shots: list[_Shot]
    surroundings: Surroundings
    calibration: dict[str, Any] = field(default_factory=_CAMERA.to_dict)
    bad_pixels: None = None

    def load(self, shot: _Shot) -> NDArray[np.uint16]:
        return shot.image


def truth_table(*, side: int = 64, shots: int = 40) -> list[TruthRow]:
    """`side` x `side` pixels of each emissivity, at 430 K before five backgrounds."""
    rows: list[TruthRow] = []
    for name, around in (
        ("none", _BARE),
        ("grey background, two windows, pixels that differ", _FULL),
    ):
        maps = evaluate_shots(_record(around, side, shots)).maps
        for number, epsilon in enumerate(EMISSIVITIES):
            part = slice(number * side, (number + 1) * side)
            kelvin, error, found, spread = (
                image[:, part].astype(float)
                for image in (
                    maps.apparent_temperature_K,
                    maps.apparent_temperature_standard_error_K,
                    maps.emissivity,
                    maps.emissivity_standard_error,
                )
            )
            rows.append(
                TruthRow(
                    surroundings=name,
                    emissivity=epsilon,
                    bias_K=float(np.nanmean(kelvin) - TRUTH_K),
                    error_K=float(np.nanmean(error)),
                    chi2_K=float(np.nanmean((kelvin - TRUTH_K) ** 2) / np.nanmean(error**2)),
                    emissivity_bias=float(np.mean(found) - epsilon),
                    chi2_emissivity=float(np.mean((found - epsilon) ** 2) / np.mean(spread**2)),
                )
            )
    return rows


def _record(around: Surroundings, side: int, shots: int) -> _Recorded:
    rng = np.random.default_rng(5)
    epsilon = np.repeat(EMISSIVITIES, side)[None, :] * np.ones((side, 1))
    differ = 0.0 if around is _BARE else 1.0
    gain = 1.0 + differ * 0.03 * rng.standard_normal(epsilon.shape)
    offset = differ * 20.0 * rng.standard_normal(epsilon.shape)
    whole = Boundary.in_filter(around, _FILTER, reference_K=480.0)
    own = float(band_radiance(TRUTH_K, filter_um=_FILTER))
    found: list[_Shot] = []
    for kelvin in _BACKGROUNDS_K:
        leaving = float(whole.leaving(kelvin))
        for kind, through in (("reference", np.zeros_like(epsilon)), ("injection", epsilon)):
            inside = (1.0 - through) * leaving + through * own
            mean = _CAMERA.counts_per_radiance * gain * whole.seen(inside) * 40.0
            for number in range(shots):
                electrons = rng.poisson(mean) + 200.0 * rng.standard_normal(epsilon.shape)
                counts = np.rint(_CAMERA.offset_counts + offset + electrons / 40.0)
                image = np.clip(counts, 0, 16383).astype(np.uint16)
                found.append(_Shot(f"{kind}-{kelvin:g}-{number}", kind, kelvin, kelvin, image))
    return _Recorded(found, around)
