"""Fig. 12: four refractive indices across the C-H band."""

from __future__ import annotations

import numpy as np

from cldit.optics.liquid import liquid
from cldit.study.compare import change_pictures, change_rows, mean_change
from cldit.study.lab import CAPTION_WALLS_K, Lab
from cldit.study.measures import Change, Phases, root
from cldit.study.page import Page, Row
from cldit.study.verdict import Verdict

_N, _K = 1.338, 0.0341  # paper
_FILTER_UM = (3.3, 3.5)
_LIQUID_K = 370.0
_WALLS = {"walls.temperature_K": CAPTION_WALLS_K}


def pairs() -> dict[str, tuple[float, float, float]]:
    """Wavelength / um, n and k of four places of n-heptane's band, by what they show."""
    wavelength = np.linspace(*_FILTER_UM, 801)
    n, k = liquid("n-heptane").index(wavelength, _LIQUID_K)
    like = np.abs(k / _K - 1.0) < 0.1
    places = {
        "lowest k": int(np.argmin(k)),
        "k as the paper's, n furthest": int(np.argmax(np.where(like, np.abs(n - _N), -1.0))),
        "k twice the paper's": int(np.argmin(np.abs(k - 2 * _K))),
        "highest k": int(np.argmax(k)),
    }
    return {
        name: (float(wavelength[at]), float(n[at]), float(k[at])) for name, at in places.items()
    }


def study(lab: Lab) -> Page:
    """One spray, five refractive indices at one wavelength."""
    reference = lab.run(lab.gdi("gdi", _WALLS))
    runs, shown = {}, {}
    for number, (name, (_, n, k)) in enumerate(pairs().items(), start=1):
        values = {**_WALLS, "optics.n": float(f"{n:.4g}"), "optics.k": float(f"{k:.3g}")}
        run = lab.run(lab.gdi(f"index-{number}", values))
        runs[name] = run
        shown[f"n {n:.3f}, k {k:.3f}"] = run
    here, halo = root(reference), Phases.of(reference).vapour_only
    below = {name: mean_change(run, reference, here) for name, run in runs.items()}
    rows: list[Row] = []
    found = pairs().values()
    for row, (um, n, k) in zip(change_rows(reference, runs), found, strict=True):
        rows.append({**row, "wavelength / um": um, "n": n, "k": k})
    extremes = max(abs(below["lowest k"]), abs(below["highest k"]))
    return Page(
        name="index",
        title="Refractive index",
        figure="Fig. 12",
        text=_text(below, Change.of(runs["highest k"], reference).rms(halo)),
        pictures=change_pictures(
            reference,
            shown,
            reference_name=f"n {_N}, k {_K}",
            about="0.95 ms, 0.6 MPa, 570 K, walls 450 K",
            limit_K=20.0,
        ),
        table=rows,
        verdicts=(
            Verdict(
                claim="A low k makes the spray below the injector look warmer",
                value=below["lowest k"],
                unit="K",
                low=0.0,
                why="the lowest k of the data within the filter is near or above the paper's",
            ),
            Verdict(
                claim="A high k makes it look colder",
                value=below["highest k"],
                unit="K",
                high=0.0,
            ),
            Verdict(
                claim="The real part has little influence (below the injector, over that of k)",
                value=abs(below["k as the paper's, n furthest"]) / extremes,
                high=0.5,
            ),
            Verdict(
                claim="No influence where vapour governs (RMS, vapour only)",
                value=Change.of(runs["highest k"], reference).rms(halo),
                unit="K",
                high=0.5,
            ),
        ),
    )


def _text(below: dict[str, float], halo_K: float) -> str:
    said = "; ".join(f"{name} {off_K:+.1f} K" for name, off_K in below.items())
    return (
        "n and k are taken together from the shipped data of liquid n-heptane at four wavelengths "
        "of the filter, since either follows from the other by Kramers-Kronig; the droplets' "
        "temperatures and places are the same in all. The less droplets absorb, the more of the "
        "walls' light, which is warmer than they are, do they pass on. T_app below the injector "
        f"changes by: {said}. Where vapour alone is seen the highest k changes it by {halo_K:.2g} "
        "K (RMS)."
    )
