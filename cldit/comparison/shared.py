"""Errors that two results have in common, which their difference does not contain."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any

import numpy as np

from cldit.accuracy.errors import OMISSION, PARTS, Cause
from cldit.comparison.members import Members
from cldit.comparison.shown import Image, Shown
from cldit.dit.budget import Part
from cldit.io.origin import ROOMS
from cldit.run import Run
from cldit.run.ensemble import INJECTIONS
from cldit.scene import Scene
from cldit.scene.scatter import without_scatter

_LATTICE, _CLASSES, _CELLS = ("spacing_m",), ("size_classes",), ("depth", "lattice_of_m")


@dataclass(frozen=True)
class Unshared:
    """Two results with the errors that a difference counts, and names of those that it does not.

    shared: sources whose errors are the same in both. tested: sources by keys that omit physics in
    one alone, or otherwise in the other; the difference contains them, and no error explains them.
    code: rooms of the package whose sources differ.
    """

    one: Shown
    other: Shown
    shared: tuple[str, ...] = ()
    tested: tuple[str, ...] = ()
    code: tuple[str, ...] = ()


def unshared(one: Shown, other: Shown) -> Unshared:
    """Both with the errors that explain their difference.

    The errors of a recording are its noise, and those of the trace that was recorded. Compared with
    a measurement, all errors of a trace count.
    """
    if one.traced is None or other.traced is None:
        return Unshared(one, other)
    first, second = one.traced, other.traced
    code = _other_code(first, second)
    parts = _same_parts(first, second, code)
    causes = {cause for run in (first, second) for cause in _causes(run)}
    omitted = {one.name for one in causes if one.shared_by == OMISSION}
    tested = {
        one.name
        for one in causes
        if one.name in omitted and _value(first.scene, one.fixed) != _value(second.scene, one.fixed)
    }
    shared = {one.name for one in causes if one.shared_by in parts} | omitted - tested
    less = [_without(each, shared | tested, same="" in parts) for each in (one, other)]
    return Unshared(less[0], less[1], tuple(sorted(shared)), tuple(sorted(tested)), code)


def _other_code(one: Run, other: Run) -> tuple[str, ...]:
    """Rooms whose sources differ; all of them if only versions or commits are known, and differ."""
    origins = [run.info.origin for run in (one, other)]
    codes = [{} if origin is None else origin.code for origin in origins]
    if all(codes):
        return tuple(room for room in ROOMS if codes[0].get(room) != codes[1].get(room))
    commits = [origin and origin.commit for origin in origins]
    versions = [run.info.versions.get("cldit") for run in (one, other)]
    return () if commits[0] == commits[1] and versions[0] == versions[1] else tuple(ROOMS)


def _same_parts(one: Run, other: Run, code: Sequence[str] = ()) -> set[str]:
    """Parts of a run (`cldit.accuracy.errors.PARTS`) that are the same in both."""
    if one is other or (one.folder is not None and one.folder == other.folder):
        return {*PARTS, ""}
    changed = {part for room, part in ROOMS.items() if room in code}
    first, second = one.scene, other.scene
    plans = [run.info.plan or {} for run in (one, other)]

    def planned(keys: tuple[str, ...]) -> bool:
        return all(plans[0].get(key) == plans[1].get(key) for key in keys)

    files = [[file.sha256 for file in run.info.files] for run in (one, other)]
    same = without_scatter(first) == without_scatter(second) and files[0] == files[1]
    same &= "spray" not in changed
    spray, classes = same and planned(_LATTICE), same and planned(_CLASSES)
    both = spray and classes
    optics = both and first.optics == second.optics and one.quadrature == other.quadrature
    optics &= "optics" not in changed
    cells = both and first.domain == second.domain and planned(_CELLS) and "cells" not in changed
    # Pixels miss the same part of a spray, whatever its lattice is, by the same rays.
    pixels = same and first.camera == second.camera and "pixels" not in changed
    pixels &= one.info.rays == other.info.rays
    pixels &= bool(one.info.rays) or not _rays_chosen(first)
    found = {
        "spray": spray,
        "classes": classes,
        "optics": optics,
        "cells": cells,
        "pixels": pixels,
        "seed": optics
        and cells
        and pixels
        and first.transport == second.transport
        and "seed" not in changed,
    }
    return {name for name, each in found.items() if each}


def _rays_chosen(scene: Scene) -> bool:
    """True if a trace chooses the rays of each pixel by its image."""
    return scene.camera.rays_across is None and scene.transport.method == "source"


def _value(scene: Scene, key: str) -> Any:
    """Value of a key of a scene, such as `transport.order`."""
    return reduce(getattr, key.split("."), scene)


def _causes(run: Run) -> tuple[Cause, ...]:
    return () if run.errors is None else run.errors.causes


def _without(shown: Shown, names: Set[str], *, same: bool) -> Shown:
    """A result whose error is its noise and that by all sources but these; `same`: of one run."""
    run = shown.traced
    assert run is not None
    if run.errors is None or run.errors.why:  # an old run, without audit, or without T_app
        return replace(shown, error_K=0.0) if same and shown.run is not None else shown
    left = [one for one in run.errors.causes if one.name not in names]
    known = [cause for cause in left if cause.error_K is not None]
    of_run = None if shown.run is not None else shown.maps
    members = Members.of(run, recorded=of_run) if shown.error_map_K is not None else None
    more: tuple[Part, ...] = ()
    rest: list[Image] = []
    if members is not None:
        if any(cause.name == INJECTIONS for cause in known):
            of_mean = members.of_mean
            more, rest = of_mean.parts, [of_mean.rest_K2]
            known = [cause for cause in known if cause.name != INJECTIONS]
        if shown.noisy:
            more += members.of_shots(run.scene.plan.shots)
    square = 0.0 if shown.run is not None else (shown.error_K or 0.0) ** 2
    square += sum((cause.error_K or 0.0) ** 2 for cause in known)
    map_K = shown.error_map_K
    if map_K is not None:
        noise_K = np.where(np.isfinite(map_K), 0.0 if shown.run is not None else map_K, np.nan)
        rest += [_map_of(shown, cause, map_K) ** 2 for cause in known]
        rest += [part.kelvin**2 for part in more]
        map_K = np.sqrt(sum(rest, noise_K**2))
    return replace(
        shown,
        common=shown.common + more,
        error_K=square**0.5,
        error_map_K=map_K,
        at_least=any(cause.error_K is None for cause in left),
    )


def _map_of(shown: Shown, cause: Cause, like: Image) -> Image:
    """Error of a source in each pixel; the same in all of a recording, or if it has no map."""
    found = None if shown.run is None else shown.run.error_maps.get(cause.name)
    even = np.full(like.shape, cause.error_K, np.float64)
    return even if found is None else np.nan_to_num(found.astype(np.float64))
