"""Estimators of a temperature, with the images that they need and the bounds that they state."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum, auto
from functools import partial
from math import pi

import numpy as np
from numpy.typing import NDArray

from cldit.camera.curve import Curve
from cldit.dit.maps import Maps
from cldit.dit.scattering import (
    LEAST_OWN,
    WALL,
    Medium,
    Scattered,
    apparent,
    fitted_shares,
    medium_of_enclosures,
    medium_temperature,
    varied_parts,
)
from cldit.optics.response import scene_filter
from cldit.radiance.weights import Weights
from cldit.scene import Scene
from tests.bench.scattering.models import LARGER, RIGHT
from tests.bench.scattering.truth import PLATES, SECOND_FILTER_UM, Traced, solid_angles
from tests.bench.scattering.two_filters import Band, one_filter, two_filters

Floats = NDArray[np.float64]
Seen = Mapping[str, Maps]

WALLS_APART_K = 50.0  # of the second wall temperature below the first
PLATE_APART_K = 100.0  # of a plate below the walls
WALL_ERROR_K = 2.0  # by which a wall temperature may be known wrongly
_SURE = 2.0  # standard errors that a bound takes
_SAUTER_UM = 9.0


@dataclass(frozen=True)
class Said:
    """Result of an estimator, (H, W) each.

    temperature_K: NaN without a result. noise_K: standard error; None if not stated. low_K, high_K:
    bounds; infinite if open.
    """

    temperature_K: Floats
    noise_K: Floats | None
    low_K: Floats
    high_K: Floats

    @classmethod
    def of(cls, temperature_K: Floats, noise_K: Floats) -> Said:
        """Result with bounds by the standard error `noise_K` (H, W)."""
        return cls(
            temperature_K, noise_K, temperature_K - _SURE * noise_K, temperature_K + _SURE * noise_K
        )

    @classmethod
    def of_medium(cls, medium: Medium) -> Said:
        """Result of a temperature of the medium with its standard error."""
        return cls.of(medium.temperature_K, medium.standard_error_K)


class Knows(Enum):
    """Inputs of an estimator beside the maps: of the rig, or a model of the spray."""

    NOTHING = auto()
    RIG = auto()
    RIG_WRONG = auto()
    MODEL = auto()
    MODEL_WRONG = auto()
    MODELS = auto()  # all of them, for a bound
    OTHER_BAND = auto()  # a model, through the other filter


@dataclass(frozen=True)
class Estimator:
    """Evaluation of the temperature of `about`: `medium` or `droplets`."""

    method: str
    needs: str
    say: Callable[[Seen], Said]
    knows: Knows
    about: str = "medium"


def seen(truth: Traced, second: Traced) -> dict[str, Maps]:
    """Plain DIT of every arrangement without noise; `second`: through the second filter."""
    walls_K = truth.scene.walls.temperature_K
    cold_K = walls_K - PLATE_APART_K
    found = {
        "as it is": truth.maps(),
        "colder walls": truth.maps({WALL: walls_K - WALLS_APART_K}),
        "all round": truth.maps(background=(WALL, *PLATES)),
        "larger disc": truth.maps(background=("ring",)),
        "second filter": second.maps(),
    }
    found |= {f"cold {name}": truth.maps({name: cold_K}) for name in PLATES}
    for patch in truth.scene.patches:
        if patch.name not in PLATES:
            warmer = {patch.name: patch.temperature_K + WALLS_APART_K}
            found[f"warmer {patch.name}"] = truth.maps(warmer)
    return found


def estimators(
    truth: Traced, models: Mapping[str, Traced], second: Mapping[str, Traced]
) -> list[Estimator]:
    """All estimators, plain DIT first."""
    return [
        *_without(truth),
        *_plates(truth),
        *_filters(truth.scene, second[RIGHT].scene),
        *_with_model(models, second),
    ]


def _without(truth: Traced) -> Iterator[Estimator]:
    curve, walls_K = truth.curve, truth.scene.walls.temperature_K

    def plain(maps: Maps) -> Said:
        temperature_K = maps.apparent_temperature_K.astype(float)
        return Said.of(temperature_K, maps.apparent_temperature_standard_error_K.astype(float))

    def away_from_walls(maps: Maps) -> Said:
        """The medium is on the other side of T_app than the walls."""
        one = plain(maps)
        warm = one.temperature_K < walls_K
        return Said(
            one.temperature_K,
            one.noise_K,
            np.where(warm, -np.inf, one.low_K),
            np.where(warm, one.high_K, np.inf),
        )

    yield Estimator("plain DIT", "nothing", lambda maps: plain(maps["as it is"]), Knows.NOTHING)
    bound = "plain DIT as a bound", "T_wall", lambda maps: away_from_walls(maps["as it is"])
    all_round = (
        "background all round",
        "walls that follow it",
        lambda maps: plain(maps["all round"]),
    )
    yield Estimator(*bound, Knows.RIG)
    yield Estimator(*all_round, Knows.RIG)
    own = [patch for patch in truth.scene.patches if patch.name not in PLATES]
    names = ["as it is", "colder walls", *(f"warmer {patch.name}" for patch in own)]

    def varied(maps: Seen, parts: list[dict[str, float]]) -> Said:
        return Said.of_medium(medium_of_enclosures([maps[name] for name in names], parts, curve))

    for error_K in (0.0, WALL_ERROR_K):
        colder_K = walls_K - WALLS_APART_K
        parts = [
            truth.enclosure(),
            truth.enclosure({WALL: colder_K + error_K}),
            *(truth.enclosure({p.name: p.temperature_K + WALLS_APART_K}) for p in own),
        ]
        needs = f"{walls_K:g} and {colder_K:g} K"
        needs += f", one {error_K:g} K off" if error_K else ""
        knows = Knows.RIG_WRONG if error_K else Knows.RIG
        yield Estimator("two walls", needs, partial(varied, parts=parts), knows)


def _plates(truth: Traced) -> Iterator[Estimator]:
    """Estimators with a part of the enclosure at another temperature, that assume the rest to
    scatter as much per sr."""
    curve, walls_K = truth.curve, truth.scene.walls.temperature_K
    wall = float(curve.radiance(walls_K))
    angles = solid_angles(truth.scene)
    whole = 4.0 * pi - angles["background"]
    third = 4.0 * pi / 3.0
    zones = {"ring": third - angles["background"], "beside": third, "before": third}

    def medium(maps: Seen, share: Floats, error: Floats) -> Said:
        share = np.clip(share, 0.0, None)
        scattered = Scattered(share=share, radiance=share * wall, share_error=error)
        return Said.of_medium(medium_temperature(maps["as it is"], scattered, curve))

    def larger(maps: Seen) -> Said:
        small, large = maps["as it is"], maps["larger disc"]
        epsilon = small.emissivity.astype(float)
        error = np.hypot(small.emissivity_standard_error, large.emissivity_standard_error)
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = whole / angles["ring"] / epsilon
            return medium(maps, factor * (epsilon - large.emissivity), factor * error)

    def plate(maps: Seen, name: str) -> tuple[Floats, Floats]:
        cold_K = walls_K - PLATE_APART_K
        parts = [truth.enclosure(plate=name), truth.enclosure({name: cold_K}, plate=name)]
        both = [maps["as it is"], maps[f"cold {name}"]]
        varied = varied_parts(parts)
        shares, _, gradients, errors = fitted_shares(both, parts, curve, varied)
        at = [one for one in parts[0] if one in varied].index(name)
        return shares[at], np.sqrt(np.tensordot(gradients[at] ** 2, errors**2, axes=1))

    def one(maps: Seen, name: str) -> Said:
        factor = whole / angles[name]
        share, error = plate(maps, name)
        return medium(maps, factor * share, factor * error)

    def three(maps: Seen) -> Said:
        found = [(zones[name] / angles[name], *plate(maps, name)) for name in PLATES]
        share = sum((factor * part for factor, part, _ in found), np.zeros(()))
        error = np.sqrt(sum(((factor * e) ** 2 for factor, _, e in found), np.zeros(())))
        return medium(maps, np.asarray(share), np.asarray(error))

    yield Estimator("two discs", "radii 1 and 1.5", larger, Knows.RIG)
    for name, place in (("beside", "beside"), ("before", "on the camera's side")):
        needs = f"{place}, {PLATE_APART_K:g} K below the walls"
        yield Estimator("cold plate", needs, partial(one, name=name), Knows.RIG)
    yield Estimator("three cold plates", "behind, beside, on the camera's side", three, Knows.RIG)


def _filters(scene: Scene, other: Scene) -> Iterator[Estimator]:
    walls_K = scene.walls.temperature_K

    def bands(maps: Seen, k: float) -> tuple[Band, Band]:
        pair = zip((scene, other), (maps["as it is"], maps["second filter"]), strict=True)
        first, last = (
            Band(
                seen,
                curve_of(one),
                one.optics.wavelength_um,
                one.optics.n,
                k * one.optics.k,
                isotropic=one.transport.phase != "mie",
            )
            for one, seen in pair
        )
        return first, last

    def known(maps: Seen, factor: float) -> Said:
        size = factor * _SAUTER_UM
        band, _ = bands(maps, 1.0)
        return Said.of(*one_filter(band, diameter_um=size, wall_temperature_K=walls_K))

    def both(maps: Seen, k: float) -> Said:
        found = two_filters(bands(maps, k), wall_temperature_K=walls_K)
        return Said(found.temperature_K, found.standard_error_K, found.low_K, found.high_K)

    low, high = SECOND_FILTER_UM
    size, wrong = f"D32 {_SAUTER_UM:g} um, n and k", f"D32 {1.2 * _SAUTER_UM:g} um (wrong)"
    needs = f"{low:g} to {high:g} um too, n and k"
    k_wrong = "k 30 % larger in both (wrong)"
    one, two = "one filter, a slab", "two filters, a slab"
    yield Estimator(one, size, partial(known, factor=1.0), Knows.RIG)
    yield Estimator(one, wrong, partial(known, factor=1.2), Knows.RIG_WRONG)
    yield Estimator(two, needs, partial(both, k=1.0), Knows.RIG)
    yield Estimator(two, k_wrong, partial(both, k=1.3), Knows.RIG_WRONG)


def curve_of(scene: Scene) -> Curve:
    """Planck's curve in a scene's filter."""
    return Curve(filter_um=scene_filter(scene))


def _with_model(models: Mapping[str, Traced], second: Mapping[str, Traced]) -> Iterator[Estimator]:
    low, high = SECOND_FILTER_UM

    def medium(maps: Seen, model: Traced, name: str) -> Said:
        return Said.of_medium(medium_temperature(maps[name], model.scattered(), model.curve))

    def droplets(maps: Seen, model: Traced) -> Said:
        radiance = droplet_radiance(
            maps["as it is"], model.weights, model.liquid_share, model.scattered(), model.curve
        )
        temperature_K = model.curve.temperature(radiance)
        _, error = apparent(maps["as it is"], model.curve)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = model.liquid_share / (1.0 - model.weights.background.astype(float))
            noise = error / share * model.curve.temperature_slope(radiance)
        return Said.of(temperature_K, noise)

    def spread(maps: Seen, each: Mapping[str, Callable[[Seen], Said]]) -> Said:
        """Range of the bounds of all models, and its middle."""
        said = [one(maps) for one in each.values()]
        low_K = np.min([one.low_K for one in said], axis=0)
        high_K = np.max([one.high_K for one in said], axis=0)
        return Said(0.5 * (low_K + high_K), None, low_K, high_K)

    shares = {name: partial(medium, model=one, name="as it is") for name, one in models.items()}
    alone = {name: partial(droplets, model=one) for name, one in models.items()}
    for method, each, about in (
        ("scattered share", shares, "medium"),
        ("droplets alone", alone, "droplets"),
    ):
        for name, say in each.items():
            knows = Knows.MODEL if name == RIGHT else Knows.MODEL_WRONG
            yield Estimator(method, f"model: {name}", say, knows, about)
        every = partial(spread, each=each)
        yield Estimator(method, "all models: a bound", every, Knows.MODELS, about)
    method = f"{low:g} to {high:g} um, scattered share"
    for name in (RIGHT, LARGER):
        say = partial(medium, model=second[name], name="second filter")
        yield Estimator(method, f"model: {name}", say, Knows.OTHER_BAND, "droplets")


def droplet_radiance(
    maps: Maps,
    spray: Weights,
    liquid_share: Floats,
    scattered: Scattered,
    curve: Curve,
) -> Floats:
    """B of the droplets, (H, W): B(T_app) minus scattered light and vapour of a model.

    The model gives weights with an unobstructed background, the weight `liquid_share` (H, W) of the
    droplets' emission, and the light that is `scattered`.
    """
    epsilon = 1.0 - spray.background.astype(float)
    radiance, _ = apparent(maps, curve)
    with np.errstate(divide="ignore", invalid="ignore"):
        own = (epsilon * (radiance - scattered.radiance) - spray.vapour) / liquid_share
    return np.where((liquid_share >= LEAST_OWN * epsilon) & (own > 0.0), own, np.nan)
