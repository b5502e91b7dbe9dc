"""Fig. 11: four distributions of droplet sizes of one Sauter mean diameter."""

from __future__ import annotations

from cldit.run import Run
from cldit.scene.sizes import Monodisperse
from cldit.show.report.optics_summary import FIG4
from cldit.study.compare import change_pictures, change_rows, tips_change_K
from cldit.study.lab import CAPTION_WALLS_K, Lab
from cldit.study.measures import Change
from cldit.study.page import Page
from cldit.study.verdict import Verdict

_WALLS = {"walls.temperature_K": CAPTION_WALLS_K}


def study(lab: Lab) -> Page:
    """The paper's four distributions, and the first with other random numbers."""
    runs: dict[str, Run] = {}
    for row in FIG4:
        values = row.sizes.model_dump()
        if isinstance(row.sizes, Monodisperse):
            name = f"all {row.sizes.diameter_um:g} µm"
        else:
            name = f"m {row.sizes.m_um:g} µm, n {row.sizes.n:.3g}, p {row.sizes.p:g}"
        title = "gdi" if not runs else f"sizes-{len(runs)}"
        runs[name] = lab.run(lab.gdi(title, {**_WALLS, "spray.droplets": values}))
    named, reference = next(iter(runs.items()))
    cases = {name: run for name, run in runs.items() if name != named}
    chance = lab.run(lab.gdi("sizes-seed", {**_WALLS, "spray.seed": 2}))
    worst = max(Change.of(run, reference).rms() for run in cases.values())
    by_chance = Change.of(chance, reference)
    widest = list(cases.values())[1]
    return Page(
        name="sizes",
        title="Droplet sizes",
        figure="Fig. 11",
        text=_text(reference, cases, by_chance.rms()),
        pictures=change_pictures(
            reference,
            {**cases, "other random numbers": chance},
            reference_name=named,
            about="0.95 ms, 0.6 MPa, 570 K, walls 450 K; D32 is 9.0 µm in all",
            limit_K=20.0,
        ),
        table=change_rows(reference, {**cases, "other random numbers": chance}),
        verdicts=(
            Verdict(
                claim="Differences are in the range ±10 K (largest RMS)",
                value=worst,
                unit="K",
                high=10.0,
                why=f"other random numbers alone make {by_chance.rms():.3g} K: where single "
                "parcels are seen, a pixel shows a droplet in one spray and vapour in the other",
            ),
            Verdict(
                claim="No general trend to higher or lower temperatures (largest mean)",
                value=max((Change.of(run, reference).mean() for run in cases.values()), key=abs),
                unit="K",
                low=-3.0,
                high=3.0,
            ),
            Verdict(
                claim="Much of it is the random initialisation of the droplets "
                "(RMS by other random numbers over the largest RMS)",
                value=by_chance.rms() / worst,
                low=0.3,
                why="more parcels than the paper's, so that chance is less",
            ),
            Verdict(
                claim="Larger droplets live longer, so that tips look colder "
                "(mean at the tips, widest distribution, by more than other random numbers make)",
                value=tips_change_K(widest, reference),
                unit="K",
                high=-abs(tips_change_K(chance, reference)),
                why="the largest droplets carry heat-absorbing liquid further, but fewer of them",
            ),
        ),
    )


def _text(reference: Run, cases: dict[str, Run], chance_K: float) -> str:
    off = sorted(Change.of(run, reference).rms() for run in cases.values())
    liquid = [run.info.spray["liquid_mass_kg"] * 1e6 for run in (reference, *cases.values())]
    return (
        "Four distributions with the Sauter mean diameter of 9 µm go through the same computed "
        "spray. The surface per mass of liquid is the same in all at the nozzle: "
        f"{min(liquid):.2f} to {max(liquid):.2f} mg are still liquid. Against the first, T_app "
        f"differs by {off[0]:.1f} to {off[-1]:.1f} K (RMS). The same distribution with other "
        f"random numbers differs by {chance_K:.1f} K, which is how much of it is chance."
    )
