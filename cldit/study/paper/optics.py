"""Figs. 3 and 4: refractive index, droplets, and size distributions."""

from __future__ import annotations

import numpy as np

from cldit.optics.droplets import droplet_table
from cldit.optics.liquid import liquid
from cldit.scene.sizes import Monodisperse
from cldit.show.figures.optics_figures import optics_picture
from cldit.show.report.html import Picture
from cldit.show.report.optics_summary import FIG4, scene_optics
from cldit.spray.sizes import mean_diameter_m
from cldit.study.lab import Lab
from cldit.study.page import Page, Row
from cldit.study.pictures import smaller
from cldit.study.verdict import Verdict

_UM, _N, _K = 3.4, 1.338, 0.0341  # paper
_LARGE_M = 0.49e-3


def study(lab: Lab) -> Page:
    """Tables only: nothing is traced."""
    scene = lab.shipped("gdi")
    lab.used["gdi"] = scene
    data = scene_optics(scene, cache=lab.runs.cache)
    n, k = (float(value[0]) for value in liquid("n-heptane").index(np.array([_UM]), 300.0))
    table = droplet_table(wavelength_um=_UM, n=_N, k=_K, cache=lab.runs.cache)
    extinction = table.efficiencies(np.array([2e-6, 9e-6, _LARGE_M]))[0]
    rows: list[Row] = []
    off: list[float] = []
    for each in FIG4:
        means = [
            each.sizes.diameter_um
            if isinstance(each.sizes, Monodisperse)
            else mean_diameter_m(each.sizes, high, low) * 1e6
            for high, low in ((1, 0), (3, 2))
        ]
        off += [abs(means[0] - each.d10_um), abs(means[1] - each.d32_um)]
        rows.append(
            {
                "distribution": "all of one size"
                if isinstance(each.sizes, Monodisperse)
                else f"m {each.sizes.m_um:g} µm, n {each.sizes.n:g}, p {each.sizes.p:g}",
                "D10 / µm": means[0],
                "the paper's D10 / µm": each.d10_um,
                "D32 / µm": means[1],
                "the paper's D32 / µm": each.d32_um,
            }
        )
    return Page(
        name="optics",
        title="Optics and droplets",
        figure="Figs. 3 and 4",
        text=_text(k),
        pictures={
            "optics": Picture(
                smaller(optics_picture(data)),
                "What the scene gdi uses, with the data and the paper's values.",
            )
        },
        table=rows,
        verdicts=(
            Verdict(
                claim="n of n-heptane at 3.4 µm is 1.338 (data minus paper)",
                value=n - _N,
                low=-0.03,
                high=0.03,
                why="it changes by 0.1 within the filter, and the sources' wavelengths differ by "
                "a few nanometres",
            ),
            Verdict(
                claim="k at 3.4 µm is 0.0341 (data over paper)",
                value=k / _K,
                low=0.8,
                high=1.25,
                why=f"the shipped data, which follow the sources that were found, have {k:.3g}",
            ),
            Verdict(
                claim="The extinction of large droplets is twice their cross section (0.49 mm)",
                value=float(extinction[2]),
                low=1.98,
                high=2.05,
            ),
            Verdict(
                claim="Droplets of the size of the wavelength differ (extinction efficiency at "
                "2 µm over that at 9 µm)",
                value=float(extinction[0] / extinction[1]),
                high=0.8,
            ),
            Verdict(
                claim="D10 and D32 of the four distributions (largest difference)",
                value=max(off),
                unit="µm",
                high=0.01,
            ),
        ),
    )


def _text(k: float) -> str:
    more = k > _K
    return (
        "The refractive index with the filter over it, efficiencies against droplet size, the "
        "phase function, the four size distributions, the vapour and the camera. The data's k at "
        f"{_UM} µm is {k:.3g}, {k / _K:.2f} times the paper's {_K}: with the data droplets absorb "
        f"and emit {'more' if more else 'less'} than with the paper's value, and scatter "
        f"{'less' if more else 'more'}. The paper printed n of its second and third distribution "
        "rounded; the values here give the D10 and D32 that it states."
    )
