"""Fig. 13: ten per cent more and less absorption by the vapour."""

from __future__ import annotations

from cldit.study.compare import change_pictures, change_rows
from cldit.study.lab import Lab
from cldit.study.measures import Change, Phases
from cldit.study.page import Page
from cldit.study.verdict import Verdict

_PAPER_m2_mol = 50.0  # 5e5 cm2/mol


def study(lab: Lab) -> Page:
    """One spray, three absorption cross sections of its vapour."""
    reference = lab.run(lab.gdi("gdi"))
    cases = {
        f"{share:+d} %": lab.run(
            lab.gdi(
                f"vapour{share:+d}", {"optics.vapour_m2_mol": _PAPER_m2_mol * (1 + share / 100)}
            )
        )
        for share in (-10, 10)
    }
    phases = Phases.of(reference)
    more = Change.of(cases["+10 %"], reference)
    less = Change.of(cases["-10 %"], reference)
    return Page(
        name="vapour",
        title="Vapour absorption",
        figure="Fig. 13",
        text=_TEXT,
        pictures=change_pictures(
            reference,
            cases,
            named="5·10⁵ cm²/mol",
            about="0.95 ms, 0.6 MPa, 570 K, walls 455 K",
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
                why=_WHY,
            ),
            Verdict(
                claim="10 % less likewise (RMS)",
                value=less.rms(phases.both),
                unit="K",
                low=5.0,
                high=15.0,
                why=_WHY,
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


_WHY = (
    "T_app is a mean of source temperatures between the wet droplets and the gas, each weighted by "
    "its share of the light; a tenth more of one share moves that mean by less than a tenth of "
    "what lies between the two, and these differ by some 100 K only where little vapour lies "
    "before cold droplets. The paper's branching traced one scattering order with a hundred random "
    "rays; a difference of two such pictures carries the noise of both"
)
_TEXT = (
    "The same spray with ten per cent less and more absorption by its vapour. DIT takes the "
    "emissivity from the same rays, so that vapour alone keeps its temperature whatever it "
    "absorbs. Where droplets stand behind vapour the mixture of the two sources changes with the "
    "share that each contributes, and T_app with it."
)
