"""Fig. 10: the background all round, and walls from 0 K up, from one trace."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cldit.optics.planck import band_radiance, temperature_of_radiance
from cldit.radiance.weights import Weights
from cldit.run import Run, reevaluated
from cldit.show.report.html import Picture
from cldit.study.grid import changed
from cldit.study.lab import Lab
from cldit.study.measures import Phases, droplets_K, mean_emissivity, mean_K, root
from cldit.study.page import Page
from cldit.study.pictures import maps_figure
from cldit.study.verdict import Verdict

_WALLS_K = (0.0, 300.0, 380.0, 455.0, 570.0)


def all_round(run: Run) -> Run:
    """The same trace with the background on all of the enclosure: walls count as background."""

    def joined(weights: Weights) -> Weights:
        every = sum(weights.patches.values(), weights.background + weights.wall)
        return replace(weights, background=every, wall=np.zeros_like(every), patches={})

    parts = tuple(joined(each) for each in run.spectral)
    return reevaluated(replace(run, spectral=parts, reference=joined(run.reference)), run.scene)


def study(lab: Lab) -> Page:
    """One trace before every wall."""
    run = lab.run(lab.gdi("gdi"))
    cases = {"all round": all_round(run)}
    for wall_K in _WALLS_K:
        scene = changed(run.scene, {"walls.temperature_K": wall_K})
        cases[f"walls {wall_K:g} K"] = reevaluated(run, scene)
    droplets = droplets_K(lab.spray(run.scene), within_m=10e-3)
    halo = Phases.of(run).vapour_only
    below = {name: mean_K(case, root(case)) for name, case in cases.items()}
    around = {name: mean_K(case, halo) for name, case in cases.items()}
    first, cold, hot = below["all round"], below["walls 0 K"], below["walls 570 K"]
    nearest = min((below_K - droplets for below_K in below.values()), key=abs)
    return Page(
        name="walls",
        title="Wall temperature",
        figure="Fig. 10",
        text=_text(below, cases, around),
        pictures={
            "maps": Picture(
                maps_figure(cases, title="walls of different temperature, one trace"),
                "The background all round, then walls of constant temperature. "
                "0.95 ms after start of injection, 0.6 MPa, 570 K.",
            )
        },
        table=[
            {
                "case": name,
                "T_app below the nozzle / K": below[name],
                "emissivity below the nozzle": mean_emissivity(case, root(case)),
                "T_app of vapour alone / K": around[name],
                "droplets below the nozzle / K": droplets,
            }
            for name, case in cases.items()
        ],
        verdicts=(
            Verdict(
                claim="Background all round: emissivity well below unity at the injector's tip",
                value=mean_emissivity(cases["all round"], root(cases["all round"])),
                high=0.9,
                why="the droplets absorb what they scatter only in part, but many times",
            ),
            Verdict(
                claim="Where there is vapour only, T_app does not depend on the walls "
                "(largest change from 0 to 570 K)",
                value=abs(around["walls 570 K"] - around["walls 0 K"]),
                unit="K",
                high=1.0,
            ),
            Verdict(
                claim="No wall shows the droplets' temperature below the nozzle (nearest case)",
                value=abs(nearest),
                unit="K",
                low=10.0,
                why="walls near the droplets' own temperature do show it: what droplets scatter "
                "then looks like what they emit",
            ),
            Verdict(
                claim="Not even walls of 0 K do (T_app below the nozzle minus the droplets')",
                value=abs(cold - droplets),
                unit="K",
                low=10.0,
            ),
            Verdict(
                claim="Cold walls: slightly lower T_app below the nozzle than all round",
                value=cold - first,
                unit="K",
                high=0.0,
            ),
            Verdict(
                claim="Hot walls raise T_app at the root dramatically (570 K against all round)",
                value=hot - first,
                unit="K",
                low=30.0,
            ),
            Verdict(
                claim="A droplet at 400 K that scatters as much as it absorbs, walls at 300 K: "
                "T_app is 6 % low",
                value=_one_droplet(run),
                unit="%",
                low=5.5,
                high=6.5,
            ),
        ),
    )


def _one_droplet(run: Run) -> float:
    band = run.quadrature.filter_um
    half = float(np.mean(band_radiance([400.0, 300.0], filter_um=band)))
    seen = float(temperature_of_radiance(half, filter_um=band))
    return 100.0 * (1.0 - seen / 400.0)


def _text(below: Mapping[str, float], cases: Mapping[str, Run], around: Mapping[str, float]) -> str:
    seen = {name: mean_emissivity(run, root(run)) for name, run in cases.items()}
    return (
        "Transfer is linear in its sources: the trace gives each pixel's share of background and "
        "walls, and all panels come from one trace. In the first the background surrounds the "
        "spray, so that what droplets scatter counts as transmitted: the emissivity below the "
        f"nozzle is that of absorption alone, {seen['all round']:.2f}, and T_app there, "
        f"{below['all round']:.0f} K, a mean of all that emits. Before walls of constant "
        "temperature all that is scattered counts as extinct and the walls' light as emitted: the "
        f"emissivity is {seen['walls 0 K']:.2f}, and T_app goes from {below['walls 0 K']:.0f} K "
        f"before walls of 0 K, which add nothing, to {below['walls 570 K']:.0f} K before walls of "
        f"570 K. Vapour alone does not scatter and is seen at {around['walls 0 K']:.1f} and "
        f"{around['walls 570 K']:.1f} K before the same walls."
    )
