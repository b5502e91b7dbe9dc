"""A laboratory's shots of a known spray, in memory, with the faults that laboratories have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter, shift

from cldit.acquisition.plan import Plan
from cldit.arrays import Floats
from cldit.camera.calibration import Calibration
from cldit.optics.planck import band_radiance
from cldit.radiance.boundary import Boundary, Surroundings
from cldit.scene.vessel import Window
from tests.verify.evaluation_bias import Recorded, Shot

FILTER_UM = (3.3, 3.5)
BACKGROUNDS_K = (423.0, 453.0, 483.0, 523.0)
CAMERA = Calibration(
    filter_um=FILTER_UM,
    counts_per_radiance=2.4e-17,
    offset_counts=300.0,
    electrons_per_count=40.0,
    read_noise_electrons=200.0,
    saturation_counts=16383.0,
)
AROUND = Surroundings(
    wall_temperature_K=415.0,
    background_emissivity=0.95,
    camera_surroundings_K=300.0,
    windows=(
        Window(side="front", material="CaF2", thickness_m=0.01, temperature_K=380.0),
        Window(side="rear", material="CaF2", thickness_m=0.01, temperature_K=415.0),
    ),
)
_INTERVAL_s = 2.0  # between two shots


@dataclass(frozen=True, kw_only=True)
class Drifts:
    """Of an interval between shots: offset in counts, gain relative; of a minute: black body in
    kelvin, from the first shot before each background on."""

    offset_counts: float = 0.0
    gain: float = 0.0
    blackbody_K: float = 0.0


@dataclass(frozen=True)
class Laboratory:
    """The recording, and the truth (h, w) of it."""

    recorded: Recorded
    emissivity: Floats
    kelvin: Floats


def spray(shape: tuple[int, int], rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Emissivity and temperature (h, w) of a plume that leaves a part of the picture free."""
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    along = rows / shape[0]
    across = (columns / shape[1] - 0.45 - 0.05 * rng.standard_normal()) / (0.05 + 0.13 * along)
    length = 0.75 + 0.05 * rng.standard_normal()
    end = 1.0 / (1.0 + np.exp((along - length) / 0.03))
    emissivity = (0.85 - 0.5 * along) * np.exp(-0.5 * across**2) * end
    return emissivity, 390.0 + 40.0 * along + 10.0 * np.tanh(np.abs(across))


def laboratory(
    seed: int,
    *,
    backgrounds_K: Sequence[float] = BACKGROUNDS_K,
    shape: tuple[int, int] = (48, 64),
    references: int = 8,
    shots: int = 8,
    scatter: float = 0.03,
    patch_pixels: float | None = None,
    interleave: bool = True,
    drifts: Drifts | None = None,
    waits: Sequence[float] = (),
    timed: bool = False,
    offset_of_injections: float = 0.0,
    blackbody_of_injections_K: float = 0.0,
    off_K: dict[float, Any] | None = None,
    gain_from: dict[float, float] | None = None,
    spray_shift: dict[float, tuple[float, float]] | None = None,
    plume: bool = True,
) -> Laboratory:
    """Records a spray.

    Args:
        seed: of spray, pixels and noise.
        backgrounds_K: set points, in the order in which they are visited.
        shape: rows, columns.
        references, shots: before each background.
        scatter: of the amount of spray from shot to shot, in all of the picture and in a smooth
            field. patch_pixels: in patches of this size alone; None: in both.
        interleave: kinds alternate as in a plan; else all references come first.
        drifts: of camera and black body, from the first shot to the last.
        waits: for the black body, in intervals: between two backgrounds, in turns.
        timed: shots tell when they were taken.
        offset_of_injections: counts by which the camera differs.
        blackbody_of_injections_K: kelvin by which the black body is warmer with injections.
        off_K: kelvin (or an image of them) by which it is warmer than said, by set point.
        gain_from: relative change of the gain by set point.
        spray_shift: rows and columns by which the camera sees the spray elsewhere, by set point.
        plume: False: no spray at all.
    """
    rng = np.random.default_rng(seed)
    emissivity, kelvin = spray(shape, rng)
    if not plume:
        emissivity = np.zeros(shape)
    depth = -np.log1p(-emissivity)
    own = band_radiance(kelvin, filter_um=FILTER_UM)
    gain = 1.0 + 0.03 * rng.standard_normal(shape)
    dark = 20.0 * rng.standard_normal(shape)
    whole = Boundary.in_filter(AROUND, FILTER_UM, reference_K=480.0)
    drifts = drifts or Drifts()
    plan = Plan(
        backgrounds_K=tuple(backgrounds_K),
        references=references,
        shots=shots,
        interleave=interleave,
        order="given",
    )
    found: list[Shot] = []
    for number, step in enumerate(plan.steps()):
        since = number % (references + shots)
        taken = number + sum(waits[k % len(waits)] for k in range(step.background) if waits)
        real_K = step.background_K + (off_K or {}).get(step.background_K, 0.0)
        real_K += drifts.blackbody_K * _INTERVAL_s / 60.0 * since
        offset = drifts.offset_counts * taken
        amount = np.zeros(shape)
        if step.kind == "injection":
            real_K += blackbody_of_injections_K
            offset += offset_of_injections
            amount = 1.0 + scatter * _amount(shape, rng, patch_pixels)
        through = np.exp(-depth * amount)
        moved = (spray_shift or {}).get(step.background_K, (0, 0))
        through, emitted = (shift(one, moved, order=1, mode="nearest") for one in (through, own))
        inside = through * whole.leaving(real_K) + (1.0 - through) * emitted
        bright = (
            gain
            * (1.0 + drifts.gain * taken)
            * (1.0 + (gain_from or {}).get(step.background_K, 0.0))
        )
        electrons = CAMERA.counts_per_radiance * bright * whole.seen(inside) * 40.0
        noisy = rng.poisson(electrons) + 200.0 * rng.standard_normal(shape)
        counts = np.rint(CAMERA.offset_counts + dark + offset + noisy / 40.0)
        image = np.clip(counts, 0, 16383).astype(np.uint16)
        time_s = _INTERVAL_s * taken if timed else None
        found.append(Shot(step.id, step.kind, step.background_K, step.background_K, image, time_s))
    return Laboratory(
        Recorded(found, AROUND, CAMERA.to_dict()), emissivity=emissivity, kelvin=kelvin
    )


def _amount(shape: tuple[int, int], rng: np.random.Generator, patch_pixels: float | None) -> Floats:
    """(h, w) of variance 1 in patches; or of variance 2, half of it in all of the picture."""
    smooth = min(shape) / 6.0 if patch_pixels is None else patch_pixels
    field = gaussian_filter(rng.standard_normal(shape), smooth, mode="wrap")
    field /= np.sqrt(np.mean(field**2))
    return np.asarray(field + rng.standard_normal() if patch_pixels is None else field)
