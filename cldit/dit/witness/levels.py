"""Levels of the images of one background against each other."""

from __future__ import annotations

import numpy as np

from cldit.dit.solve import KINDS
from cldit.dit.witness.backgrounds import clearest, slopes
from cldit.dit.witness.evidence import Evidence
from cldit.dit.witness.finding import LIMIT_K, Witness

_INJECTIONS = 3.0  # the amount of spray scatters too
_THIN = 0.9  # share of the background behind spray that cannot change the level much


def levels(evidence: Evidence) -> Witness | None:
    """Witness of images of one background whose levels differ by kelvins from one to the next.

    The black body is stable during a recording, so the exposure must have changed: a camera that
    takes integration times in turns (superframing), or has automatic gain.
    """
    chosen = {"reference": np.ones(evidence.blocks, bool), "injection": clearest(evidence)}
    gain = float(np.median(evidence.gains("reference")))
    found: list[str] = []
    for kind in KINDS:
        here = chosen[kind]
        if kind == "injection" and float(np.mean(slopes(evidence)[here])) < _THIN:
            continue
        scatter_K = np.sqrt(evidence.jitter(kind, here)) / (gain * evidence.rise)
        limit_K = LIMIT_K * (_INJECTIONS if kind == "injection" else 1.0)
        found += [
            f"{kind}s at {setpoint:g} K by {kelvin:.2g} K"
            for setpoint, kelvin in zip(evidence.setpoints, scatter_K, strict=True)
            if kelvin > limit_K
        ]
    if not found:
        return None
    return Witness(
        name="levels",
        says=f"levels scatter from image to image: {', '.join(found)}; are integration times taken "
        "in turns (superframing: select the images of one with [first:last:step]), is the gain "
        "automatic, or are files of several exposures mixed?",
        stands_out=True,
        severe=True,
    )
