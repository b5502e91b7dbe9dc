"""Fig. 13: ten per cent more and less absorption by the vapour."""

from __future__ import annotations

from cldit.optics.planck import band_radiance, temperature_of_radiance
from cldit.optics.response import scene_filter
from cldit.run import Run
from cldit.study.compare import change_pictures, change_rows
from cldit.study.lab import CAPTION_WALLS_K, Lab
from cldit.study.measures import Change, Phases, mean_K
from cldit.study.page import Page
from cldit.study.verdict import Verdict

_PAPER_m2_mol = 50.0  # 5e5 cm2/mol
_WALLS = {"walls.temperature_K": CAPTION_WALLS_K}


def study(lab: Lab) -> Page:
    """One spray, three absorption cross sections of its vapour."""
    reference = lab.run(lab.gdi("gdi", _WALLS))
    cases = {
        f"{share:+d} %": lab.run(
            lab.gdi(
                f"vapour{share:+d}",
                {**_WALLS, "optics.vapour_m2_mol": _PAPER_m2_mol * (1 + share / 100)},
            )
        )
        for share in (-10, 10)
    }
    phases = Phases.of(reference)
    more = Change.of(cases["+10 %"], reference)
    less = Change.of(cases["-10 %"], reference)
    why = _why(mean_K(reference, phases.both), reference)
    return Page(
        name="vapour",
        title="Vapour absorption",
        figure="Fig. 13",
        text=_text(more, less, phases),
        pictures=change_pictures(
            reference,
            cases,
            reference_name="5·10⁵ cm²/mol",
            about="0.95 ms, 0.6 MPa, 570 K, walls 450 K",
            limit_K=10.0,
        ),
        table=change_rows(reference, cases),
        verdicts=(
            Verdict(
                claim="Where rays meet vapour and droplets, 10 % more absorption changes T_app by "
                "approximately 10 K (RMS)",
                value=more.rms(phases.both),
                unit="K",
                low=5.0,
                high=15.0,
                why=why,
            ),
            Verdict(
                claim="10 % less likewise (RMS)",
                value=less.rms(phases.both),
                unit="K",
                low=5.0,
                high=15.0,
                why=why,
            ),
            Verdict(
                claim="More and less absorption change T_app in opposite directions (product of "
                "the means)",
                value=more.mean(phases.both) * less.mean(phases.both),
                unit="K²",
                high=0.0,
            ),
            Verdict(
                claim="Unchanged where there is vapour only (larger RMS of the two)",
                value=max(each.rms(phases.vapour_only) for each in (more, less)),
                unit="K",
                high=1.0,
                why="where the vapour's temperature differs along the ray, more absorption sees "
                "less deep",
            ),
        ),
    )


def _why(seen_K: float, run: Run) -> str:
    """What ten per cent more of one part of the light can do at a temperature, and what 10 K need.

    Every part of B(T_app) = sum w_j B_j / sum w_j that vapour emits grows by its absorption at
    most, and nothing else grows.
    """
    band = scene_filter(run.scene)
    light = float(band_radiance(seen_K, filter_um=band))
    needed = float(band_radiance(seen_K + 10.0, filter_um=band)) / light - 1.0
    most_K = float(temperature_of_radiance(1.1 * light, filter_um=band)) - seen_K
    return (
        f"T_app is {seen_K:.0f} K there, and 10 K more are {100 * needed:.0f} % more light. Ten "
        "per cent more absorption makes no part of the light more than ten per cent brighter, "
        f"which is {most_K:.1f} K if all of it came from thin vapour; vapour that is not thin, "
        "and droplets that it covers, leave less. The paper's branching traced one scattering "
        "order with a hundred random rays; a difference of two such pictures carries the noise of "
        "both"
    )


def _text(more: Change, less: Change, phases: Phases) -> str:
    return (
        "The same spray with ten per cent less and more absorption by its vapour. DIT takes the "
        "emissivity from the same rays, so that vapour alone keeps its temperature whatever it "
        f"absorbs: it changes by {less.rms(phases.vapour_only):.2g} and "
        f"{more.rms(phases.vapour_only):.2g} K (RMS). Where droplets stand behind vapour the "
        "mixture of the two sources changes with the share that each contributes, and T_app with "
        f"it: by {less.mean(phases.both):+.2g} and {more.mean(phases.both):+.2g} K on average, "
        f"{less.rms(phases.both):.2g} and {more.rms(phases.both):.2g} K RMS."
    )
