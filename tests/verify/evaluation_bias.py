"""Shots in memory of a known spray, for tests of the evaluation."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.camera.calibration import Calibration
from cldit.optics.planck import band_radiance
from cldit.radiance.boundary import Boundary, Surroundings
from cldit.scene.vessel import Window

TRUTH_K = 430.0
EMISSIVITIES = (0.05, 0.1, 0.3, 0.6, 0.9, 1.0)
FILTER_UM = (3.3, 3.5)
BACKGROUNDS_K = (400.0, 440.0, 480.0, 520.0, 560.0)
CAMERA = Calibration(
    filter_um=FILTER_UM,
    counts_per_radiance=1.2e-17,
    offset_counts=300.0,
    electrons_per_count=40.0,
    read_noise_electrons=200.0,
    saturation_counts=16383.0,
)
BARE = Surroundings(wall_temperature_K=450.0)
FULL = Surroundings(
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
class Shot:
    """A picture (rows, columns), as the evaluation wants its shots."""

    id: str
    kind: str
    background_setpoint_K: float
    background_K: float
    image: NDArray[Any]
    time_s: float | None = None


@dataclass
class Recorded:
    """Shots in memory, as the evaluation wants a recording; bad_pixels: (rows, columns) or None."""

    shots: list[Shot]
    surroundings: Surroundings
    calibration: dict[str, Any] = field(default_factory=CAMERA.to_dict)
    bad_pixels: NDArray[np.bool_] | None = None

    def load(self, shot: Shot) -> NDArray[Any]:
        """The picture of a shot, (rows, columns)."""
        return shot.image


def record(
    around: Surroundings = BARE,
    *,
    side: int = 48,
    shots: int = 40,
    pattern: bool = False,
    background_error_K: float = 0.0,
    filter_um: tuple[float, float] = FILTER_UM,
    seed: int = 5,
) -> Recorded:
    """Records blocks of pixels in a row, one of `EMISSIVITIES` each, at `TRUTH_K`.

    A count is 40 electrons, read noise 200; counts are rounded, and clipped to the camera's.
    """
    rng = np.random.default_rng(seed)
    epsilon = np.repeat(EMISSIVITIES, side)[None, :] * np.ones((side, 1))
    gain = 1.0 + 0.03 * rng.standard_normal(epsilon.shape) if pattern else np.ones_like(epsilon)
    offset = 20.0 * rng.standard_normal(epsilon.shape) if pattern else np.zeros_like(epsilon)
    whole = Boundary.in_filter(around, filter_um, reference_K=480.0)
    own = float(band_radiance(TRUTH_K, filter_um=filter_um))
    found: list[Shot] = []
    for background_K in BACKGROUNDS_K:
        real_K = background_K + background_error_K * rng.standard_normal(epsilon.shape)
        leaving = whole.leaving(real_K)
        for kind in ("reference", "injection"):
            inside = leaving
            if kind == "injection":
                inside = (1.0 - epsilon) * leaving + epsilon * own
            light = CAMERA.counts_per_radiance * gain * whole.seen(inside)
            electrons = light * CAMERA.electrons_per_count
            for number in range(shots):
                noisy = rng.poisson(electrons) + 200.0 * rng.standard_normal(epsilon.shape)
                counts = np.rint(CAMERA.offset_counts + offset + noisy / 40.0)
                image = np.clip(counts, 0, 16383).astype(np.uint16)
                found.append(
                    Shot(
                        f"{background_K:g}-{kind}-{number}", kind, background_K, background_K, image
                    )
                )
    return Recorded(found, around)
