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
from collections.abc import Iterator, Mapping, Sequence
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
_SHARES = np.linspace(0.0, 1.0, 11)  # emissivities of the fits; between them, an error of f'' / 800


@dataclass(frozen=True, kw_only=True)
class Part:
    """One contribution: (H, W) changes of T_app [K] and emissivity by the size in its `name`.

    degrees: of freedom of the estimate of that size; infinite if it is known.
    """

    name: str
    kelvin: Floats
    emissivity: Floats
    degrees: float = math.inf

    def of(self, observable: str) -> Floats:
        """Change of `T_app` [K], or of the `emissivity`."""
        return self.kelvin if observable == "T_app" else self.emissivity


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
        return np.asarray(np.sqrt(np.sum([part.kelvin**2 for part in self.parts], axis=0)))

    @property
    def emissivity(self) -> Floats:
        """Systematic standard error of the emissivity."""
        return np.asarray(np.sqrt(np.sum([part.emissivity**2 for part in self.parts], axis=0)))

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
            *((part.name, part.kelvin, part.emissivity) for part in self.parts),
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
    words = "".join(letter if letter.isalnum() or letter == "." else "_" for letter in name)
    return f"{PARTS}/{words.replace('__', '_')}_{of}"


def load_parts(folder: Path) -> tuple[tuple[Part, ...], tuple[Part, ...]]:
    """Systematic and common parts that `Budget.save` wrote; empty for maps of older versions."""
    parts = [
        Part(
            name=meta.get("name", path.stem),
            kelvin=kelvin.astype(float),
            emissivity=read_image(path.with_name(f"{path.stem[:-2]}_emissivity.tif"))[0],
        )
        for path in sorted((folder / PARTS).glob("*_K.tif"))
        for kelvin, meta in (read_image(path),)
    ]
    common = tuple(part for part in parts if part.name.startswith(COMMON))
    return tuple(part for part in parts if part not in common), common


def common_parts(maps: Maps, kelvin: Floats, emissivity: Floats) -> tuple[Part, ...]:
    """Errors of all pixels in common, (M, H, W) of T_app and emissivity, as a few of the same sum.

    They are rotated to principal components of the changes in units of the standard errors. A
    component that is small compared with the noise of all pixels together cannot be seen in the
    map of either, and is omitted. The amount of spray changes the emissivity most, T_app least.
    """
    of_K = kelvin / maps.apparent_temperature_standard_error_K
    seen = np.nan_to_num(
        np.concatenate([of_K, emissivity / maps.emissivity_standard_error], axis=1)
    )
    size, turn = np.linalg.eigh(np.einsum("ahw,bhw->ab", seen, seen))
    kept = [k for k in reversed(range(len(size))) if size[k] > 1.0]  # of one standard deviation
    return tuple(
        Part(
            name=f"{COMMON} {number}",
            kelvin=np.einsum("a,ahw->hw", turn[:, k], kelvin),
            emissivity=np.einsum("a,ahw->hw", turn[:, k], emissivity),
        )
        for number, k in enumerate(kept, start=1)
    )


def _median(image: Floats) -> float | None:
    magnitudes = np.abs(image[np.isfinite(image)])
    return float(np.median(magnitudes)) if magnitudes.size else None


def budget(
    maps: Maps,
    surroundings: Surroundings,
    *,
    curve: Curve,
    backgrounds_K: Sequence[float],
    calibration: Calibration,
    common: tuple[Part, ...] = (),
) -> Budget:
    """Error budget of the `maps` of an evaluation, with `common` errors of their pixels.

    It takes the uncertainty of the `surroundings`, the `curve` that was used, K black-body
    temperatures, and the `calibration` of the camera, whose noise weights the backgrounds.
    """
    stated = curve_boundary(surroundings, curve, backgrounds_K)
    apparent_K = maps.apparent_temperature_K.astype(float)
    emissivity = maps.emissivity.astype(float)
    radiance = curve.radiance(np.nan_to_num(apparent_K, nan=300.0))
    x = stated.leaving(np.asarray(backgrounds_K))
    through = 1.0 - emissivity
    evaluated = np.isfinite(apparent_K)
    spray = float(np.median(radiance[evaluated])) if evaluated.any() else float(x[0])
    weights = [_weight(share, x, spray, stated, calibration) for share in _SHARES]
    parts: list[Part] = []
    for name, boundary, warmer_K, changed_curve in _variations(surroundings, curve, backgrounds_K):
        leaving = boundary.leaving(np.asarray(backgrounds_K) + warmer_K)
        lines = np.array([_affine(leaving, x, weight) for weight in weights])
        a, b = lines[0]
        a_inj, b_inj = (np.interp(emissivity, _SHARES, column) for column in lines.T)
        with np.errstate(divide="ignore", invalid="ignore"):  # without spray
            changed = (radiance * emissivity + through * b_inj - b) / (a - through * a_inj)
        changed_K = changed_curve.temperature(np.maximum(np.where(evaluated, changed, 0.0), 0.0))
        parts.append(
            Part(
                name=name,
                kelvin=np.where(evaluated, changed_K - apparent_K, np.nan),
                emissivity=through * (1.0 - a_inj / a),
            )
        )
    return Budget(parts=tuple(parts), maps=maps, common=common)


def _variations(
    surroundings: Surroundings, curve: Curve, backgrounds_K: Sequence[float]
) -> Iterator[tuple[str, Boundary, float, Curve]]:
    """Names of quantities; boundary, excess [K] of the black body, and curve with each one changed
    by its uncertainty."""
    unsure = surroundings.uncertainty

    def boundary(**changes: Any) -> Boundary:
        return curve_boundary(replace(surroundings, **changes), curve, backgrounds_K)

    for cause, kelvin in (
        ("calibration", unsure.background_calibration_K),
        ("uniformity", unsure.background_uniformity_K),
    ):
        yield f"black body's {cause} by {kelvin:g} K", boundary(), kelvin, curve
    lower = max(surroundings.background_emissivity - unsure.background_emissivity, 1e-3)
    name = f"background emissivity by {surroundings.background_emissivity - lower:g}"
    yield name, boundary(background_emissivity=lower), 0.0, curve
    wall_K = surroundings.wall_temperature_K + unsure.wall_temperature_K
    name = f"walls by {unsure.wall_temperature_K:g} K"
    yield name, boundary(wall_temperature_K=wall_K), 0.0, curve
    change_um = unsure.filter_um / float(np.mean(edges_um(curve.filter_um)))
    wider = replace(curve, stretch=curve.stretch * (1.0 + change_um))
    name = f"filter by {unsure.filter_um:g} um"
    yield name, curve_boundary(surroundings, wider, backgrounds_K), 0.0, wider
    for window in surroundings.windows:
        kelvin = window.temperature_K + unsure.window_temperature_K
        warmer = window.model_copy(update={"temperature_K": kelvin})
        windows = tuple(warmer if pane is window else pane for pane in surroundings.windows)
        name = f"{window.side} window by {unsure.window_temperature_K:g} K"
        yield name, boundary(windows=windows), 0.0, curve
        dimmed: dict[str, float] = {window.side: unsure.window_transmission}
        name = f"{window.side} window's transmission by {unsure.window_transmission:g}"
        yield name, curve_boundary(surroundings, curve, backgrounds_K, dimmed=dimmed), 0.0, curve


def curve_boundary(
    surroundings: Surroundings,
    curve: Curve,
    backgrounds_K: Sequence[float],
    *,
    dimmed: Mapping[str, float] | None = None,
) -> Boundary:
    """Measurement equation by the `curve`; `dimmed`: loss of the windows, by side."""
    middle_K = reference_temperature_K(list(backgrounds_K))

    def pane(window: Window) -> Pane:
        shares = band_pane(window, curve.filter_um, reference_K=middle_K)
        dimming = (dimmed or {}).get(window.side, 0.0)
        return replace(shares, transmission=shares.transmission - dimming)

    return Boundary.of(surroundings, curve.radiance, pane)


def _weight(
    emissivity: float, x: Floats, spray_radiance: float, stated: Boundary, calibration: Calibration
) -> Floats:
    """Inverse variance (K,) of the camera for a spray of this emissivity and radiance."""
    seen = stated.seen((1.0 - emissivity) * x + emissivity * spray_radiance)
    return np.asarray(1.0 / calibration.variance_counts2(calibration.counts(seen)))


def _affine(changed_x: Floats, x: Floats, weight: Floats) -> tuple[float, float]:
    """a and b of x = a x' + b, by weighted least squares over the backgrounds."""
    unit = float(np.max(np.abs(x)))
    a, b = np.polyfit(changed_x / unit, x / unit, 1, w=np.sqrt(weight))
    if not math.isfinite(a):
        return 1.0, 0.0
    return float(a), float(b) * unit
