"""Error budget: sensitivity of T_app and emissivity to quantities that are stated, not measured.

The lines of a pixel are straight in x, the radiance that leaves the background. With another value
of a stated quantity x becomes x', where x = a x' + b, exactly but for the filter, for which it is a
fit weighted by the camera's noise. The signals stay the same, so that

    I(T_app') = (e I(T_app) + (1 - e) b_inj - b_ref) / (a_ref - (1 - e) a_inj)
    e' = 1 - (1 - e) a_inj / a_ref                                                e: emissivity

with a and b fitted for references and for injections. If x' is linear in x they are equal, so that
I(T_app') = (I(T_app) - b) / a and the emissivity does not change. A front window cancels: it is
part of gain and offset of the pixel.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cldit.arrays import Floats
from cldit.camera.calibration import Calibration
from cldit.camera.curve import Curve
from cldit.dit.maps import Maps, Reason
from cldit.io.images import read_image, write_maps
from cldit.optics.response import edges_um
from cldit.optics.spectral import reference_temperature_K
from cldit.optics.windows import Pane, band_pane
from cldit.radiance.boundary import Boundary, Surroundings
from cldit.scene.vessel import Window

PARTS = "budget"  # folder of the parts, in that of the maps
COMMON = "common error"  # of all pixels
_MOST, _SEEN = 6, 1.0  # common errors, and their chi-square in all pixels together, at least
_SHARES = np.linspace(0.0, 1.0, 11)  # emissivities for which a and b are fitted


@dataclass(frozen=True, kw_only=True)
class Part:
    """One contribution: (H, W) changes of T_app [K] and emissivity by the size in its `name`.

    degrees: of freedom of the estimate of that size; infinite if it is known.
    """

    name: str
    kelvin: Floats
    emissivity: Floats
    degrees: float = math.inf


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Systematic contributions and the statistical error; (H, W), NaN where there is no value.

    common: parts of the statistical error that are one random number for all pixels each.
    """

    parts: tuple[Part, ...]
    maps: Maps
    common: tuple[Part, ...] = ()

    @property
    def kelvin(self) -> Floats:
        """Systematic standard error of T_app: root of the sum of squares."""
        return np.asarray(np.sqrt(np.sum([one.kelvin**2 for one in self.parts], axis=0)))

    @property
    def emissivity(self) -> Floats:
        """Systematic standard error of the emissivity."""
        return np.asarray(np.sqrt(np.sum([one.emissivity**2 for one in self.parts], axis=0)))

    @property
    def total_K(self) -> Floats:
        """Standard error of T_app, statistical and systematic."""
        return np.hypot(self.kelvin, self.maps.apparent_temperature_standard_error_K)

    @property
    def total_emissivity(self) -> Floats:
        """Standard error of the emissivity, statistical and systematic."""
        return np.hypot(self.emissivity, self.maps.emissivity_standard_error)

    def _rows(self) -> list[tuple[str, Floats, Floats]]:
        stated = self.maps
        return [
            (
                "statistical, with what the witnesses found",
                stated.apparent_temperature_standard_error_K.astype(float),
                stated.emissivity_standard_error.astype(float),
            ),
            *((one.name, one.kelvin, one.emissivity) for one in self.parts),
            ("total", self.total_K, self.total_emissivity),
        ]

    def to_dict(self) -> dict[str, Any]:
        """Medians over the evaluated pixels, by part."""
        return {
            name: {"apparent_temperature_K": _median(kelvin), "emissivity": _median(share)}
            for name, kelvin, share in self._rows()
        }

    @property
    def lines(self) -> list[str]:
        """A line for each part, with medians over the evaluated pixels; empty without any."""
        if not np.any(self.maps.reason == Reason.OK):
            return []
        title = "budget, median pixel: T_app / K, emissivity"
        return [title] + [
            f"  {name}: {_median(kelvin) or 0.0:.2g} K, {_median(share) or 0.0:.1g}"
            for name, kelvin, share in self._rows()
        ]

    @property
    def images(self) -> dict[str, tuple[Floats, str]]:
        """Systematic and total errors (H, W) and their units, by file name."""
        return {
            "apparent_temperature_systematic_error_K": (self.kelvin, "K"),
            "apparent_temperature_total_error_K": (self.total_K, "K"),
            "emissivity_systematic_error": (self.emissivity, "1"),
            "emissivity_total_error": (self.total_emissivity, "1"),
        }

    def save(self, folder: Path, *, pixel_m: tuple[float, float]) -> None:
        """Writes the errors as TIFF into `folder`, and those of each part into `folder`/budget.

        Args:
            folder: of the maps.
            pixel_m: size of a pixel.
        """
        images = dict(self.images)
        for part in (*self.parts, *self.common):
            images[part_file(part.name, "K")] = (part.kelvin, "K")
            images[part_file(part.name, "emissivity")] = (part.emissivity, "1")
        write_maps(folder, images, pixel_m=pixel_m)


def part_file(name: str, of: str) -> str:
    """Path of the map of a part below the maps, without suffix; `of` is `K` or `emissivity`."""
    words = "".join(one if one.isalnum() or one == "." else "_" for one in name)
    return f"{PARTS}/{words.replace('__', '_')}_{of}"


def load_parts(folder: Path) -> tuple[tuple[Part, ...], tuple[Part, ...]]:
    """Systematic and common parts that `Budget.save` wrote; empty for maps of older versions."""
    found = [
        Part(
            name=meta.get("name", path.stem),
            kelvin=kelvin.astype(float),
            emissivity=read_image(path.with_name(f"{path.stem[:-2]}_emissivity.tif"))[0],
        )
        for path in sorted((folder / PARTS).glob("*_K.tif"))
        for kelvin, meta in (read_image(path),)
    ]
    common = tuple(one for one in found if one.name.startswith(COMMON))
    return tuple(one for one in found if one not in common), common


def common_parts(maps: Maps, kelvin: Floats, emissivity: Floats) -> tuple[Part, ...]:
    """Errors of all pixels in common, (M, H, W) of T_app and emissivity, as a few of the same sum.

    They are rotated to principal components of the changes in units of the standard error. A
    component that is small compared with the noise of all pixels together cannot be seen in the
    maps, and is omitted.
    """
    seen = np.nan_to_num(kelvin / maps.apparent_temperature_standard_error_K)
    size, turn = np.linalg.eigh(np.einsum("ahw,bhw->ab", seen, seen))
    kept = [k for k in reversed(range(len(size))) if size[k] > _SEEN][:_MOST]
    return tuple(
        Part(
            name=f"{COMMON} {number}",
            kelvin=np.einsum("a,ahw->hw", turn[:, k], kelvin),
            emissivity=np.einsum("a,ahw->hw", turn[:, k], emissivity),
        )
        for number, k in enumerate(kept, start=1)
    )


def _median(image: Floats) -> float | None:
    known = np.abs(image[np.isfinite(image)])
    return float(np.median(known)) if known.size else None


def budget(
    maps: Maps,
    around: Surroundings,
    *,
    curve: Curve,
    backgrounds_K: Sequence[float],
    calibration: Calibration,
    common: tuple[Part, ...] = (),
) -> Budget:
    """Error budget of the `maps` of an evaluation, with `common` errors of their pixels.

    It takes the uncertainty of the setup `around`, the `curve` that was used, K black-body
    temperatures, and the `calibration` of the camera, whose noise weights the backgrounds.
    """
    unsure = around.uncertainty
    stated = _boundary(around, curve, backgrounds_K)
    middle_um = float(np.mean(edges_um(curve.filter_um)))
    less = max(around.background_emissivity - unsure.background_emissivity, 1e-3)
    change_um = unsure.filter_um / middle_um
    stretched = replace(curve, stretch=curve.stretch * (1.0 + change_um))

    def other(
        name: str,
        around: Surroundings = around,
        *,
        curve: Curve = curve,
        dimmed: dict[str, float] | None = None,
        warmer_K: float = 0.0,
    ) -> tuple[str, Boundary, Curve, float]:
        return name, _boundary(around, curve, backgrounds_K, dimmed=dimmed), curve, warmer_K

    changed = [
        *(
            other(f"black body's {name} by {kelvin:g} K", warmer_K=kelvin)
            for name, kelvin in (
                ("calibration", unsure.background_calibration_K),
                ("uniformity", unsure.background_uniformity_K),
            )
        ),
        other(
            f"background emissivity by {around.background_emissivity - less:g}",
            replace(around, background_emissivity=less),
        ),
        other(
            f"walls by {unsure.wall_temperature_K:g} K",
            replace(
                around, wall_temperature_K=around.wall_temperature_K + unsure.wall_temperature_K
            ),
        ),
        other(f"filter by {unsure.filter_um:g} um", curve=stretched),
    ]
    for window in around.windows:
        kelvin = window.temperature_K + unsure.window_temperature_K
        warmer = window.model_copy(update={"temperature_K": kelvin})
        windows = tuple(warmer if one is window else one for one in around.windows)
        changed += [
            other(
                f"{window.side} window by {unsure.window_temperature_K:g} K",
                replace(around, windows=windows),
            ),
            other(
                f"{window.side} window's transmission by {unsure.window_transmission:g}",
                dimmed={window.side: unsure.window_transmission},
            ),
        ]
    apparent_K = maps.apparent_temperature_K.astype(float)
    emissivity = maps.emissivity.astype(float)
    radiance = curve.radiance(np.nan_to_num(apparent_K, nan=300.0))
    x = stated.leaving(np.asarray(backgrounds_K))
    through = 1.0 - emissivity
    known = np.isfinite(apparent_K)
    spray = float(np.median(radiance[known])) if known.any() else float(x[0])
    parts: list[Part] = []
    for name, boundary, changed_curve, warmer_K in changed:
        leaving = boundary.leaving(np.asarray(backgrounds_K) + warmer_K)
        lines = np.array(
            [
                _affine(leaving, x, _weight(share, x, spray, stated, calibration))
                for share in _SHARES
            ]
        )
        a, b = lines[0]
        a_inj, b_inj = (np.interp(emissivity, _SHARES, column) for column in lines.T)
        with np.errstate(divide="ignore", invalid="ignore"):  # without spray
            own = (radiance * emissivity + through * b_inj - b) / (a - through * a_inj)
        other_K = changed_curve.temperature(np.maximum(np.where(known, own, 0.0), 0.0))
        parts.append(
            Part(
                name=name,
                kelvin=np.where(known, other_K - apparent_K, np.nan),
                emissivity=through * (1.0 - a_inj / a),
            )
        )
    return Budget(parts=tuple(parts), maps=maps, common=common)


def _boundary(
    around: Surroundings,
    curve: Curve,
    backgrounds_K: Sequence[float],
    *,
    dimmed: dict[str, float] | None = None,
) -> Boundary:
    """Measurement equation, with the transmission of windows reduced by `dimmed`, by side."""
    middle_K = reference_temperature_K(list(backgrounds_K))

    def pane(window: Window) -> Pane:
        shares = band_pane(window, curve.filter_um, reference_K=middle_K)
        less = (dimmed or {}).get(window.side, 0.0)
        return replace(shares, transmission=shares.transmission - less)

    return Boundary.of(around, curve.radiance, pane)


def _weight(
    emissivity: float, x: Floats, own: float, stated: Boundary, calibration: Calibration
) -> Floats:
    """Inverse variance (K,) of the camera for a spray of this emissivity and radiance."""
    seen = stated.seen((1.0 - emissivity) * x + emissivity * own)
    return np.asarray(1.0 / calibration.variance_counts2(calibration.counts(seen)))


def _affine(other: Floats, x: Floats, weight: Floats) -> tuple[float, float]:
    """a and b of x = a x' + b, by weighted least squares over the backgrounds."""
    unit = float(np.max(np.abs(x)))
    a, b = np.polyfit(other / unit, x / unit, 1, w=np.sqrt(weight))
    if not math.isfinite(a):
        return 1.0, 0.0
    return float(a), float(b) * unit
