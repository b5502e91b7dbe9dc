"""The paper's question: which observable decides between models of evaporation?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from cldit.arrays import Floats
from cldit.comparison.rivals import drawn, in_band, rivals_of
from cldit.comparison.unknowns import Unknown, unknowns_of
from cldit.dit.design import temperatures_K
from cldit.dit.separation import LEVEL, NEEDED, Rivals, SeparationTest, fewest
from cldit.dit.subject import Subject
from cldit.run import Run
from cldit.scene import Scene, load_scene
from cldit.study.lab import Lab
from cldit.study.measures import Change
from cldit.study.page import Row
from cldit.study.paper.results import Results
from cldit.study.paper.variants import OTHERS, REFERENCE

_MODELS = (REFERENCE, *OTHERS)
_INJECTIONS, _BACKGROUNDS = 19, 5  # the paper's; 413 to 563 K as in Fig. 15
_SCATTER = {"spray.scatter.start_s": 30e-6, "spray.scatter.mass": 0.05}  # assumed
_BANDS = {"C-H band": None, "3.95 um": "gdi-extinction"}
_ALONE = {"T_app": (0, "T_app"), "emissivity": (0, "emissivity"), "extinction": (1, "emissivity")}
_TOGETHER = "all three"
_LEAST_EMISSIVITY = 0.05  # also of extinction, of which a few droplets make as much
_CAMPAIGNS = {False: 20, True: 6}  # of each model, by `quick`


def models(lab: Lab, campaigns: int | None = None) -> Results:
    """All pairs of four models, by three observables; and simulated campaigns of one injection.

    campaigns: of each model; None: 20, or 6 with `quick`. The runs are not audited: their errors
    are other random numbers, and cells of twice the edge.
    """
    scenes = {
        name: lab.gdi(f"models-{name}", {**_SCATTER, "spray.evaporation": name}) for name in _MODELS
    }
    count = _CAMPAIGNS[lab.quick] if campaigns is None else campaigns
    unknowns = unknowns_of(scenes[REFERENCE])
    bands = [None if name is None else load_scene(name) for name in _BANDS.values()]

    def run(scene: Scene, band: Scene | None) -> Run:
        return lab.run(scene if band is None else in_band(scene, band))

    runs = [{name: run(scene, band) for name, scene in scenes.items()} for band in bands]
    against = [{name: _rivals(lab, of[REFERENCE], of[name], unknowns) for name in _MODELS}
               for of in runs]  # fmt: skip
    low_K, high_K = (pick(scenes[REFERENCE].background.temperatures_K) for pick in (min, max))
    backgrounds = temperatures_K(low_K, high_K, _BACKGROUNDS)
    pairs = {
        (model, rival): [_pair(of[model], of[rival]) for of in against]
        for model, rival in combinations(_MODELS, 2)
    }
    tests = {pair: [rivals.test(backgrounds) for rivals in of] for pair, of in pairs.items()}
    data = [
        (name, [_seen(of[name], run(true, band)) for of, band in zip(against, bands, strict=True)])
        for number, (name, scene) in enumerate(scenes.items())
        for _, true in drawn(scene, unknowns, count, seed=10 + number)
    ]
    rng = np.random.default_rng(1)
    rows, right, wrong, asked = list[Row](), 0, 0, 0
    for pair, of in tests.items():
        joint = SeparationTest.joined(of)
        separated, excluded, count_of_pair = _confirmed(
            pair, pairs[pair], joint, data, backgrounds, rng
        )
        wrong += excluded
        if joint.distance(1) >= NEEDED:
            right, asked = right + separated, asked + count_of_pair
        row = _row(pair, of, joint, [runs[0][name] for name in pair])
        rows.append({**row, "confirmed": f"{separated} of {count_of_pair}"})
    mixing = next(unknown for unknown in unknowns if unknown.key == "spray.mixing_length")
    eddies = lab.run(runs[0][REFERENCE].scene.with_(**mixing.values(1.0)))
    return Results(
        values={
            "unknowns": ", ".join(unknown.text for unknown in unknowns),
            "confirmed": right,
            "asked": asked,
            "confirmed_share": right / asked if asked else float("nan"),
            "excluded": wrong,
            "campaigns": len(data),
            **_separated(rows),
            **_compared(runs[0], eddies),
        },
        table=rows,
        repeated=False,
    )


def _separated(rows: Sequence[Row]) -> dict[str, float]:
    """Number of separated pairs, and the largest distance by each observable."""
    largest = {
        word: max(float(row[f"{name}, sigma"]) for row in rows)
        for word, name in zip(("t_app", "emissivity", "extinction"), _ALONE, strict=True)
    }
    separated = sum(row["separated by"] != "none" for row in rows)
    return {"needed": NEEDED, "pairs": separated, "all_pairs": len(rows), **largest}


def _rivals(lab: Lab, reference: Run, rival: Run, unknowns: Sequence[Unknown]) -> Rivals:
    return rivals_of(
        reference,
        rival,
        lambda scene, _: lab.run(scene),
        unknowns=unknowns,
        least_emissivity=_LEAST_EMISSIVITY,
    )


def _row(
    pair: tuple[str, str], of: list[SeparationTest], joint: SeparationTest, runs: list[Run]
) -> Row:
    """Distances of two models by each observable, and the injections that separate them."""
    needed = {name: fewest(of[band], [observable]) for name, (band, observable) in _ALONE.items()}
    needed[_TOGETHER] = fewest(joint)
    best = min(needed, key=lambda name: needed[name] or np.inf)

    def masses(phase: str) -> str:
        return " / ".join(f"{1e6 * run.info.spray[f'{phase}_mass_kg']:.2f}" for run in runs)

    return {
        "models": " / ".join(pair),
        **{f"{phase} / mg": masses(phase) for phase in ("liquid", "vapour")},
        **{
            f"{name}, sigma": of[band].distance(_INJECTIONS, [observable])
            for name, (band, observable) in _ALONE.items()
        },
        f"{_TOGETHER}, sigma": joint.distance(_INJECTIONS),
        f"{_TOGETHER}, sigma of 1 injection": joint.distance(1),
        "separated by": "none" if needed[best] is None else best,
        "injections": str(needed[best] or "none"),
    }


def _compared(runs: Mapping[str, Run], eddies: Run) -> dict[str, float]:
    """Largest changes by a model, relative to the reference; and T_app with other `eddies`."""
    reference = runs[REFERENCE]

    def share(phase: str) -> float:
        masses = {name: run.info.spray[f"{phase}_mass_kg"] for name, run in runs.items()}
        return max(abs(mass / masses[REFERENCE] - 1.0) for mass in masses.values())

    off_K = max(Change.of(runs[name], reference).rms() for name in OTHERS)
    return {
        "pixels": reference.scene.camera.pixels[0],
        "turbulence": Change.of(eddies, reference).rms() / off_K,
        "liquid": share("liquid"),
        "vapour": share("vapour"),
    }


def _pair(model: Rivals, rival: Rivals) -> Rivals:
    """Two models, each with draws of its own, of which both are the rivals of a third."""
    draws = zip(model.draws, rival.draws, strict=True)
    return replace(
        model,
        model=model.rival,
        rival=rival.rival,
        draws=[(sizes, draw, rival_draw) for (sizes, _, draw), (_, _, rival_draw) in draws],
    )


def _seen(rivals: Rivals, run: Run) -> Subject:
    return rivals.model.of_model(run.scene, run.quadrature, run.spectral, run.reference)


def _confirmed(
    pair: tuple[str, str],
    rivals: list[Rivals],
    test: SeparationTest,
    data: list[tuple[str, list[Subject]]],
    backgrounds_K: tuple[float, ...],
    rng: np.random.Generator,
) -> tuple[int, int, int]:
    """Numbers of campaigns that exclude the wrong model alone, and the right one, and of all.

    A campaign is one injection and one reference per background with the camera's noise.
    """
    root = np.linalg.cholesky(test.noise)
    separated = excluded = count = 0
    for true, subjects in data:
        if true not in pair:
            continue
        residual: Floats = np.concatenate(
            [of.data(seen, backgrounds_K) for of, seen in zip(rivals, subjects, strict=True)]
        )
        noise = np.einsum("bij,bj->bi", root, rng.standard_normal(residual.shape))
        chances = test.p_values(residual + noise, 1)
        right = pair.index(true)
        count += 1
        excluded += chances[right] < LEVEL
        separated += chances[1 - right] < LEVEL <= chances[right]
    return separated, excluded, count
