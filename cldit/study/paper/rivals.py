"""The paper's question: would its measurement decide between models of evaporation?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cldit.accuracy.error_maps import error_maps
from cldit.arrays import Floats
from cldit.dit.design import temperatures_K
from cldit.dit.separation import NEEDED
from cldit.run import Run
from cldit.scene.scatter import member
from cldit.study.lab import Lab
from cldit.study.page import Row
from cldit.study.paper.found import Found
from cldit.study.separate import Model, rivals_of

_REFERENCE = "abramzon-sirignano"
_MODELS = ("spalding", "dukowicz", "frolov-type")
_INJECTIONS, _BACKGROUNDS = 19, 5  # the paper's; 413 to 563 K as in Fig. 15
_SCATTER = {"start_s": 30e-6, "mass": 0.05}  # assumed
_MEMBERS = 4


def models(lab: Lab) -> Found:
    """Three models against a fourth, with injections that differ and the errors of the runs.

    The runs are not audited: their errors are the changes by other random numbers, and by gas cells
    and octree cells of twice the edge.
    """
    base = lab.gdi("models")
    runs = {
        name: lab.run(lab.gdi(f"models-{name}", {"spray.evaporation": name}))
        for name in (_REFERENCE, *_MODELS)
    }
    other = lab.run(lab.gdi("models-seed", {"spray.seed": lab.seed + 1}))
    coarse = lab.run(replace(lab, coarser=2.0 * lab.coarser).gdi("models-coarse"))
    varied = base.with_(**{f"spray.scatter.{key}": value for key, value in _SCATTER.items()})
    injections = tuple(lab.run(member(varied, number)) for number in range(1, _MEMBERS + 1))
    one = runs[_REFERENCE]
    errors_K = {
        **_errors("random numbers", one, other),
        **_errors("gas grid and cells", one, coarse),
    }
    low_K, high_K = min(base.background.temperatures_K), max(base.background.temperatures_K)
    backgrounds = temperatures_K(low_K, high_K, _BACKGROUNDS)
    rows: list[Row] = []
    for name in _MODELS:
        pair = rivals_of(Model(one, injections), Model(runs[name]), errors_K=errors_K)
        exact = rivals_of(Model(one, injections), Model(runs[name]), errors_K={})
        rows.append(
            {
                "model": name,
                "RMS / K": pair.rms_K(backgrounds),
                "distance": pair.distance(backgrounds, _INJECTIONS),
                "without errors of the simulation": exact.distance(backgrounds, _INJECTIONS),
                "with 10,000 injections": pair.distance(backgrounds, 10_000),
            }
        )

    def largest(column: str) -> float:
        return max(float(row[column]) for row in rows)

    return Found(
        values={
            "needed": NEEDED,
            "most": largest("distance"),
            "exact": largest("without errors of the simulation"),
            "many": largest("with 10,000 injections"),
            "rms_K": largest("RMS / K"),
        },
        table=rows,
    )


def _errors(name: str, one: Run, other: Run) -> dict[str, Floats]:
    """Error (H, W) of T_app by a source: the local RMS of a change."""
    change_K = (other.maps.apparent_temperature_K - one.maps.apparent_temperature_K).astype(float)
    counted = one.maps.has_temperature & other.maps.has_temperature
    rms_K = float(np.sqrt(np.mean(change_K[counted] ** 2)))
    maps = error_maps({name: rms_K}, {name: np.abs(change_K)}, counted)
    return {name: np.nan_to_num(maps[name], nan=rms_K).astype(float)}
