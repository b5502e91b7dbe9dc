"""Levels of the images: are they counts, by the black body's temperature, and of one exposure?"""

from collections.abc import Sequence

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.constants import ZERO_CELSIUS_K
from cldit.dit.camera_of_shots import SEES
from cldit.dit.chance import FEW
from cldit.dit.shots import AllSums, Sums
from cldit.dit.solve import KINDS
from cldit.dit.witness.backgrounds import clearest, slopes
from cldit.dit.witness.evidence import Evidence
from cldit.dit.witness.finding import LIMIT_K, Witness, refusal

_INJECTIONS = 3.0  # the amount of spray scatters too
_THIN = 0.9  # share of the background behind spray that cannot change the level much
_FALLS = 0.02  # of the span of levels: more than noise and drift
_ENDS = 0.03  # of the range of an integer: close to either end
_LIKE = 0.1  # relative deviation of a level from a temperature
_STEEP = (0.5, 1.5)  # change of the level by that of the temperature
_TEMPERATURES = {"K": 0.0, "degrees Celsius": ZERO_CELSIUS_K}
_FACTORS = (1.0, 10.0, 25.0, 100.0, 1000.0)  # in which programs store temperatures as integers


def brightness(
    sums: AllSums, setpoints: Sequence[float], *, bad: Mask, source: Floats
) -> Witness | None:
    """Witness of references whose levels are no counts of a camera that sees hotter backgrounds.

    Their levels look like temperatures, fall where the background is hotter, wrap around at the end
    of an integer, or are scaled to the same range in each image. `source` (K,) is the radiance of
    the backgrounds.
    """
    groups = [sums[k, "reference"] for k in setpoints]
    used = ~bad
    kelvin = np.array([group.temperature_K for group in groups])
    if not used.any() or np.any(np.diff(kelvin) <= 0.0) or np.any(np.diff(source) <= 0.0):
        return None
    change = np.abs(groups[-1].mean() - groups[0].mean())
    used &= change >= SEES * np.percentile(change[used], 95)
    means = np.array([group.mean()[used] for group in groups])
    levels = np.median(means, axis=1)
    message = (
        _temperatures(levels, kelvin, source)
        or _wrapped(means, np.array([float(group.largest[used].max()) for group in groups]))
        or _falling(levels, groups)
    )
    if not message:
        return None
    listed = ", ".join(
        f"{level:.5g} at {at:g} K" for level, at in zip(levels, setpoints, strict=True)
    )
    return refusal("levels", f"references have levels of {listed}: {message}")


def _temperatures(levels: Floats, kelvin: Floats, source: Floats) -> str:
    if len(levels) > 2 and _off_line(kelvin, levels) > _LIKE * _off_line(source, levels):
        return ""
    for unit, zero in _TEMPERATURES.items():
        for factor in _FACTORS:
            like = levels / factor + zero
            steep = np.polyfit(kelvin - kelvin[0], like, 1)[0]
            close = np.all(np.abs(like - kelvin) < _LIKE * kelvin)
            if close and _STEEP[0] < steep < _STEEP[1]:
                times = "" if factor == 1.0 else f" times {factor:g}"
                return f"these look like temperatures in {unit}{times}; export raw counts"
    return ""


def _off_line(x: Floats, y: Floats) -> float:
    line = np.polyfit(x / x.max(), y, 1)
    return float(np.sqrt(np.mean((np.polyval(line, x / x.max()) - y) ** 2)))


def _wrapped(means: Floats, largest: Floats) -> str:
    """Counts that continue at the other end of an integer of 8 to 16 bits."""
    for bits in (16, 14, 12, 10, 8):
        span = 2.0**bits
        for low in (0.0, -span / 2.0):
            top = low + span - 1.0
            at_ends = low <= means.min() < 0.0 if low else means.min() < _ENDS * span
            at_ends &= (low < 0.0 or top - _ENDS * span < largest.max()) and largest.max() <= top
            falls = np.any(np.diff(means, axis=0) < -span / 2.0, axis=0)
            if at_ends and np.mean(falls) > FEW:
                return (
                    f"counts wrap around at {bits} bits, {100.0 * np.mean(falls):.0f} % of the "
                    f"pixels ({low:g}..{top:g}); export integers without a sign, or of more bits"
                )
    return ""


def _falling(levels: Floats, groups: Sequence[Sums]) -> str:
    span = float(np.ptp(levels))
    steps = np.diff(levels)
    noise = float(np.sqrt(np.median(groups[0].variance())))
    top = {float(group.largest.max()) for group in groups}
    if len(groups) > 1 and len(top) == 1 and np.any(steps < max(_FALLS * span, noise)):
        return (
            f"images of every background end at {top.pop():g}: is each scaled to its own range "
            "(scale_factor, automatic contrast)? Export raw counts"
        )
    if np.all(steps < -_FALLS * span):
        return (
            "they fall where the background is hotter: are dark pixels stored as large numbers "
            "(MinIsWhite), or are the temperatures in reverse order?"
        )
    return ""


def levels(evidence: Evidence) -> Witness | None:
    """Witness of images of one background whose levels differ by kelvins from one to the next.

    The black body is stable during a recording, so the exposure must have changed: a camera that
    takes integration times in turns (superframing), or has automatic gain.
    """
    chosen = {"reference": np.ones(evidence.blocks, bool), "injection": clearest(evidence)}
    gain = float(np.median(evidence.gains("reference")))
    scattered: list[str] = []
    for kind in KINDS:
        blocks = chosen[kind]
        if kind == "injection" and float(np.mean(slopes(evidence)[blocks])) < _THIN:
            continue
        scatter_K = np.sqrt(evidence.jitter(kind, blocks)) / (gain * evidence.rise)
        limit_K = LIMIT_K * (_INJECTIONS if kind == "injection" else 1.0)
        scattered += [
            f"{kind}s at {setpoint:g} K by {kelvin:.2g} K"
            for setpoint, kelvin in zip(evidence.setpoints, scatter_K, strict=True)
            if kelvin > limit_K
        ]
    if not scattered:
        return None
    return refusal(
        "levels",
        f"levels scatter from image to image: {', '.join(scattered)}; are integration times taken "
        "in turns (superframing), is the gain automatic, or are files of several exposures mixed?",
        "select the images of one exposure, in a film with [first:last:step]",
    )
