"""Errors that two results have in common, which their difference does not contain."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from functools import reduce
from types import MappingProxyType
from typing import Any

import numpy as np

from cldit.accuracy.errors import OMISSION, PARTS, Cause
from cldit.arrays import Floats, Mask
from cldit.camera.view import SensorView
from cldit.comparison.members import Members
from cldit.comparison.shown import Observable, Shown
from cldit.dit.budget import Part
from cldit.io.origin import ROOMS
from cldit.run import Run
from cldit.run.ensemble import INJECTIONS
from cldit.scene import Scene
from cldit.scene.scatter import without_scatter

_LATTICE, _CLASSES, _CELLS = ("spacing_m",), ("size_classes",), ("depth", "lattice_of_m")
_OWN = ("pixels", "seed")  # parts whose errors pixels do not share
_OBSERVABLES: tuple[Observable, Observable] = ("T_app", "emissivity")
_COMMON = 0.5**0.5  # of the error by another source, in all pixels alike


@dataclass(frozen=True)
class Unshared:
    """Two results with the errors that a difference counts, and names of those that it does not.

    shared: sources whose errors are the same in both. tested: sources by keys that omit physics in
    one alone, or otherwise in the other; the difference contains them, and no error explains them.
    code: rooms of the package whose sources differ.
    """

    baseline: Shown
    compared: Shown
    shared: tuple[str, ...] = ()
    tested: tuple[str, ...] = ()
    code: tuple[str, ...] = ()


def unshared(baseline: Shown, compared: Shown) -> Unshared:
    """Both with the errors that explain their difference.

    The errors of a recording are its noise, and those of the trace that was recorded. Compared with
    a measurement, all errors of a trace count.
    """
    if baseline.traced is None or compared.traced is None:
        return Unshared(_counted(baseline, set()), _counted(compared, set()))
    run, compared_run = baseline.traced, compared.traced
    code = _other_code(run, compared_run)
    parts = _same_parts(run, compared_run, code)
    causes = {cause for traced in (run, compared_run) for cause in _causes(traced)}
    omitted = {cause.name for cause in causes if cause.shared_by == OMISSION}
    tested = {
        cause.name
        for cause in causes
        if cause.name in omitted
        and _value(run.scene, cause.fixed) != _value(compared_run.scene, cause.fixed)
    }
    shared = {cause.name for cause in causes if cause.shared_by in parts} | omitted - tested
    other_rays = None if "" in parts else _other_rays(run, compared_run)
    sampled = {cause.name for cause in causes if cause.shared_by == "pixels" and "pixels" in parts}
    sampled = sampled if other_rays is not None else set()
    inside = dict.fromkeys(sampled, other_rays)
    shared -= sampled
    less = [
        _counted(shown, shared | tested, same="" in parts, inside=inside)
        for shown in (baseline, compared)
    ]
    names = sorted(shared)
    if other_rays is not None and not other_rays.all():
        of = f"in {np.count_nonzero(~other_rays)} of {other_rays.size} pixels"
        names += [f"{name} {of}" for name in sorted(sampled)]
    return Unshared(less[0], less[1], tuple(names), tuple(sorted(tested)), code)


def _other_code(baseline: Run, compared: Run) -> tuple[str, ...]:
    """Rooms whose sources differ; all of them if only versions or commits are known, and differ."""
    origins = [run.info.origin for run in (baseline, compared)]
    codes = [{} if origin is None else origin.code for origin in origins]
    if all(codes):
        return tuple(room for room in ROOMS if codes[0].get(room) != codes[1].get(room))
    commits = [origin and origin.commit for origin in origins]
    versions = [run.info.versions.get("cldit") for run in (baseline, compared)]
    return () if commits[0] == commits[1] and versions[0] == versions[1] else tuple(ROOMS)


def _same_parts(baseline: Run, compared: Run, code: Sequence[str] = ()) -> set[str]:
    """Parts of a run (`cldit.accuracy.errors.PARTS`) that are the same in both."""
    if baseline is compared or (baseline.folder is not None and baseline.folder == compared.folder):
        return {*PARTS, ""}
    changed = {part for room, part in ROOMS.items() if room in code}
    scene, compared_scene = baseline.scene, compared.scene
    plans = [run.info.plan or {} for run in (baseline, compared)]

    def planned(keys: tuple[str, ...]) -> bool:
        return all(plans[0].get(key) == plans[1].get(key) for key in keys)

    files = [[file.sha256 for file in run.info.files] for run in (baseline, compared)]
    same = without_scatter(scene) == without_scatter(compared_scene) and files[0] == files[1]
    same &= "spray" not in changed
    spray, classes = same and planned(_LATTICE), same and planned(_CLASSES)
    sizes = spray and classes
    optics = (
        sizes
        and scene.optics == compared_scene.optics
        and baseline.quadrature == compared.quadrature
    )
    optics &= "optics" not in changed
    cells = (
        sizes
        and scene.domain == compared_scene.domain
        and planned(_CELLS)
        and "cells" not in changed
    )
    # Pixels miss the same part of a spray, whatever its lattice is, where their rays are the same.
    pixels = same and scene.camera == compared_scene.camera and "pixels" not in changed
    same_parts = {
        "spray": spray,
        "classes": classes,
        "optics": optics,
        "cells": cells,
        "pixels": pixels,
        "seed": optics
        and cells
        and pixels
        and _other_rays(baseline, compared) is None
        and scene.transport == compared_scene.transport
        and "seed" not in changed,
    }
    return {name for name, equal in same_parts.items() if equal}


def _other_rays(baseline: Run, compared: Run) -> Mask | None:
    """Pixels (H, W) whose rays differ, or are not recorded; None if there are none."""
    if any(run.scene.camera.rays_across is not None for run in (baseline, compared)):
        return None  # those of the scene
    if (
        baseline.scene.transport.method != "source"
        or baseline.maps.reason.shape != compared.maps.reason.shape
    ):
        return None
    if baseline.rays is None or compared.rays is None:
        return None if baseline is compared else np.ones(baseline.maps.reason.shape, bool)
    different: Mask = baseline.rays != compared.rays
    return different if different.any() else None


def _value(scene: Scene, key: str) -> Any:
    """Value of a key of a scene, such as `transport.order`."""
    return reduce(getattr, key.split("."), scene)


def _causes(run: Run) -> tuple[Cause, ...]:
    return () if run.errors is None else run.errors.causes


def _counted(
    shown: Shown,
    names: Set[str],
    *,
    same: bool = False,
    inside: Mapping[str, Mask | None] = MappingProxyType({}),
) -> Shown:
    """A result whose error is its noise and that by all sources but these; `same`: of one run.

    inside: pixels (H, W) of the trace in which the error by a source counts; others in all.

    Rays and paths of a pixel are its own, so that their errors are independent. Other sources, such
    as cells, are wrong alike in whole areas of the image, of which only the size is known: half of
    their variance counts as common to all pixels, independent in T_app and in the emissivity.
    """
    run = shown.traced
    if run is None:
        return shown
    if run.errors is None or run.errors.why:  # an old run, without audit, or without T_app
        return replace(shown, error_K=0.0) if same and shown.run is not None else shown
    remaining = [cause for cause in run.errors.causes if cause.name not in names]
    stated = [cause for cause in remaining if cause.error_K is not None]
    of_noise = (0.0, 0.0) if shown.run is not None else (shown.error_K, shown.emissivity_error)
    square, square_e = ((error or 0.0) ** 2 for error in of_noise)
    square_e += sum((cause.emissivity or 0.0) ** 2 for cause in remaining)
    common, rests, stated = _of_injections(shown, run, stated)
    for cause in stated:
        counted = inside.get(cause.name)
        share = 1.0 if counted is None else float(np.mean(counted))
        square += share * (cause.error_K or 0.0) ** 2
    images = [
        {cause.name: _map_of(shown, cause, of, inside.get(cause.name)) for cause in stated}
        for of in _OBSERVABLES
    ]
    totals = list[Floats | None]()
    for of, image, rest, by_cause in zip(
        _OBSERVABLES, (shown.error_map_K, shown.emissivity_error_map), rests, images, strict=True
    ):
        if image is None:
            totals.append(None)
            continue
        noise = np.where(np.isfinite(image), 0.0 if shown.run is not None else image, np.nan)
        squares = [rest, *(part.of(of) ** 2 for part in common)]
        squares += [error**2 for error in by_cause.values()]
        totals.append(np.sqrt(sum(squares, noise**2)))
    if totals[0] is not None:
        common += tuple(_half_common(stated, images[0], images[1]))
    return replace(
        shown,
        common=shown.common + common,
        error_K=square**0.5,
        error_map_K=totals[0],
        emissivity_error=square_e**0.5,
        emissivity_error_map=totals[1],
        at_least=any(cause.error_K is None for cause in remaining),
    )


def _of_injections(
    shown: Shown, run: Run, stated: list[Cause]
) -> tuple[tuple[Part, ...], Sequence[Floats | float], list[Cause]]:
    """Errors by the injections of a run: components, the variance of the rest in T_app and in the
    emissivity, and the `stated` causes without that which these are."""
    of_run = None if shown.run is not None else shown.maps
    members = Members.of(run, recorded=of_run) if shown.error_map_K is not None else None
    common, rests = tuple[Part, ...](), tuple[Floats | float, ...]((0.0, 0.0))
    if members is None:
        return common, rests, stated
    if any(cause.name == INJECTIONS for cause in stated):
        common, rests = members.of_mean
        stated = [cause for cause in stated if cause.name != INJECTIONS]
    if shown.noisy:
        common += members.of_shots(run.scene.plan.shots)
    return common, rests, stated


def _half_common(
    stated: Sequence[Cause], kelvin: Mapping[str, Floats], emissivity: Mapping[str, Floats]
) -> Iterator[Part]:
    """The half of the variance by each source, by its name, that all pixels have in common."""
    for name in (cause.name for cause in stated if cause.shared_by not in _OWN):
        of_K, of_e = _COMMON * kelvin[name], _COMMON * emissivity[name]
        for change in ((of_K, 0.0 * of_K), (0.0 * of_K, of_e)):
            if np.any(change):
                yield Part(name=name, kelvin=change[0], emissivity=change[1])


def _map_of(shown: Shown, cause: Cause, observable: Observable, inside: Mask | None) -> Floats:
    """Error of a source in each pixel; the same in all if it has no map."""
    run = shown.traced
    assert run is not None
    maps, error = run.error_maps, cause.error_K
    if observable == "emissivity":
        maps, error = run.emissivity_error_maps, cause.emissivity
    error_map = maps.get(cause.name)
    square = np.ones(run.maps.reason.shape) if inside is None else inside.astype(np.float64)
    if error_map is not None:
        square = square * np.nan_to_num(error_map.astype(np.float64)) ** 2
    if square.shape != shown.maps.reason.shape:
        square = SensorView.from_scene(run.scene).image(square)
    return np.sqrt(square) * ((error or 0.0) if error_map is None else 1.0)
