"""Errors that two results have in common, which their difference does not contain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cldit.accuracy.errors import PARTS, Cause
from cldit.run import Run
from cldit.show.comparison.shown import Image, Shown

_OF_SPRAY, _OF_CELLS = ("spacing_m", "size_classes"), ("depth", "lattice_of_m")


def unshared(one: Shown, other: Shown) -> tuple[Shown, Shown, tuple[str, ...]]:
    """Both with the errors that they do not share, and the names of those that they do.

    The errors of a recording are its noise, and those of the trace that was recorded.
    """
    if one.traced is None or other.traced is None:
        return one, other, ()
    parts = _same_parts(one.traced, other.traced)
    names = {cause.name for shown in (one, other) for cause in _shared(shown, parts)}
    return _without(one, parts), _without(other, parts), tuple(sorted(names))


def _same_parts(one: Run, other: Run) -> set[str]:
    """Parts of a run (`cldit.accuracy.errors.PARTS`) that are the same in both."""
    if one is other or (one.folder is not None and one.folder == other.folder):
        return {*PARTS, ""}
    first, second = one.scene, other.scene
    plans = [run.info.plan or {} for run in (one, other)]

    def planned(keys: tuple[str, ...]) -> bool:
        return all(plans[0].get(key) == plans[1].get(key) for key in keys)

    files = [[file.sha256 for file in run.info.files] for run in (one, other)]
    spray = first.spray == second.spray and files[0] == files[1] and planned(_OF_SPRAY)
    optics = spray and first.optics == second.optics and one.quadrature == other.quadrature
    cells = spray and first.domain == second.domain and planned(_OF_CELLS)
    pixels = spray and first.camera == second.camera
    seed = optics and cells and pixels and first.transport == second.transport
    same = {"spray": spray, "optics": optics, "cells": cells, "pixels": pixels, "seed": seed}
    return {name for name, found in same.items() if found}


def _shared(shown: Shown, parts: set[str]) -> list[Cause]:
    errors = None if shown.traced is None else shown.traced.errors
    return [] if errors is None else [one for one in errors.causes if one.shared_by in parts]


def _without(shown: Shown, parts: set[str]) -> Shown:
    """A result whose error is its noise and that by the sources that are not shared."""
    run = shown.traced
    if run is None:
        return shown
    if run.errors is None:  # an old run, or one without audit
        return replace(shown, error_K=0.0) if "" in parts and shown.run is not None else shown
    left = [one for one in run.errors.causes if one.shared_by not in parts]
    square = 0.0 if shown.run is not None else (shown.error_K or 0.0) ** 2
    known = [cause for cause in left if cause.error_K is not None]
    square += sum((cause.error_K or 0.0) ** 2 for cause in known)
    map_K = shown.error_map_K
    if map_K is not None and shown.run is not None:
        each = [_map_of(run, cause, map_K) for cause in known]
        map_K = np.where(np.isfinite(map_K), np.sqrt(sum((one**2 for one in each), 0.0)), np.nan)
    return replace(
        shown,
        error_K=square**0.5,
        error_map_K=map_K,
        at_least=any(cause.error_K is None for cause in left),
    )


def _map_of(run: Run, cause: Cause, like: Image) -> Image:
    """Error of a source in each pixel; the same in all if it has no map."""
    found = run.error_maps.get(cause.name)
    even = np.full(like.shape, cause.error_K, np.float64)
    return even if found is None else np.nan_to_num(found.astype(np.float64))
