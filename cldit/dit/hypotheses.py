"""Causes of a finding as hypotheses: each is fitted, and the best is named if it fits.

Causes of pixel patterns that differ are fitted to the same pixels: the camera's correction was
renewed, or images moved, or were turned.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtri, ndtr

from cldit.arrays import Floats, Mask
from cldit.constants import ZERO_CELSIUS_K
from cldit.dit.chance import REMAINING
from cldit.dit.solve import DETECTION
from cldit.dit.witness.patterns import Patterns

_CHANCE = 1e-4  # probability of a larger chi-square, up to which a cause fits

UNITS: dict[str, Callable[[Floats], Floats]] = {
    "degrees Celsius: they fit with 273.15 added": lambda at: at + ZERO_CELSIUS_K,
    "degrees F that were taken for K": lambda at: (at - 32.0) / 1.8 + ZERO_CELSIUS_K,
    "degrees F that were taken for degrees Celsius": lambda at: (
        (at - ZERO_CELSIUS_K - 32.0) / 1.8 + ZERO_CELSIUS_K
    ),
    "degrees Celsius that were taken for degrees F": lambda at: (
        (at - ZERO_CELSIUS_K) * 1.8 + 32.0 + ZERO_CELSIUS_K
    ),
    "K that were taken for degrees Celsius": lambda at: at - ZERO_CELSIUS_K,
}
TURNS: dict[str, Callable[[Floats], Floats]] = {
    "upside down": lambda image: image[::-1],
    "mirrored left to right": lambda image: image[:, ::-1],
    "turned by 180 degrees": lambda image: image[::-1, ::-1],
    "with rows and columns exchanged": lambda image: image.T,
    "turned by 90 degrees": lambda image: np.rot90(image),
    "turned by 270 degrees": lambda image: np.rot90(image, 3),
    "with rows and columns exchanged and turned by 180 degrees": lambda image: image.T[::-1, ::-1],
}
_MODEL = 1.5  # largest reduced chi-square of a right cause: the noise may be 22 % larger
_RENEWED = "the camera's correction (NUC) renewed {} {}"


@dataclass(frozen=True)
class Hypothesis:
    """A cause in words, the chi-square that remains, and the number of unknowns. severe: T_app
    would be wrong by more than any stated error."""

    text: str
    chi2: float
    unknowns: int
    severe: bool = False

    @property
    def score(self) -> float:
        """Chi-square, and what the unknowns gain by chance."""
        return self.chi2 + _by_chance(self.unknowns)


def _by_chance(unknowns: int) -> float:
    return float(chdtri(unknowns, 2.0 * ndtr(-DETECTION))) if unknowns else 0.0


def fitted(candidates: Sequence[Hypothesis], *, none: float, degrees: int) -> list[Hypothesis]:
    """Causes that fit, the best first, then those within chance of it.

    none: chi-square without a cause, of so many `degrees` of freedom.
    """

    def fits(cause: Hypothesis) -> bool:
        remaining = degrees - cause.unknowns
        return cause.chi2 <= max(
            REMAINING**2 * none, float(chdtri(remaining, _CHANCE)) if remaining > 0 else 0.0
        )

    good = sorted((cause for cause in candidates if fits(cause)), key=lambda cause: cause.score)
    if not good:
        return []
    # Errors of the model count as chance, too.
    scale = max(1.0, good[0].chi2 / max(degrees - good[0].unknowns, 1))
    return [cause for cause in good if cause.score < good[0].score + _by_chance(1) * scale]


def describe(causes: Sequence[Hypothesis], *, none: float, tried: int) -> str:
    """Text of the causes that fit: by how much the best is better, and those within chance."""
    if not causes:
        return f"none of {tried} causes fits"
    better = none / max(causes[0].chi2, 1.0)
    message = f"{causes[0].text} (chi-square {better:.2g} times smaller than without)"
    alternatives = list(dict.fromkeys(cause.text for cause in causes[1:]))
    return f"{message}; within chance: {', or '.join(alternatives)}" if alternatives else message


def line_chi2(x: Floats, y: Floats, variance: Floats, *extra: Floats) -> float:
    """Chi-square of points (K,) about their line over `x`, with further columns (K,)."""
    columns = np.array([x, np.ones_like(x), *extra]).T / np.sqrt(variance)[:, None]
    size = np.sqrt(np.sum(columns**2, axis=0))
    values = y / np.sqrt(variance)
    rest = values - columns / size @ np.linalg.lstsq(columns / size, values, rcond=None)[0]
    return float(rest @ rest)


def between_kinds(patterns: Patterns, selected: Mask, *, offsets: bool, gains: bool) -> str:
    """Text of the causes of patterns of injections that are not those of references.

    selected: (h, w) pixels. offsets, gains: which of them changed beyond doubt; the rest of the
    other, as the slopes of thin spray, is no finding.
    """
    x, reference = patterns.source, patterns.high["reference"]
    change = (patterns.high["injection"] - reference)[:, selected]
    variances = [np.median(noise[:, selected], axis=1) for noise in patterns.noise.values()]
    columns = {"offsets": np.ones_like(x), "gains": x}
    changed = [name for name, beyond in (("offsets", offsets), ("gains", gains)) if beyond]
    per_pixel = {
        _RENEWED.format(" and ".join(names), "between the kinds"): [columns[name] for name in names]
        for names in dict.fromkeys([*((name,) for name in changed), tuple(changed)])
    }
    turned = {
        f"injections look {orientation}": (
            np.array([turn(image) for image in reference]) - reference
        )[:, selected]
        for orientation, turn in TURNS.items()
        if turn(reference[0]).shape == selected.shape
    }
    moved = {"injections look moved": [[step[:, selected]] for step in _steps(reference)]}
    base = [column for name, column in columns.items() if name not in changed]
    return _describe(
        [(change, np.sum(variances, axis=0))], base, per_pixel=per_pixel, moved=moved, turned=turned
    )


def between_backgrounds(patterns: Patterns, selected: Mask, names: Sequence[str]) -> str:
    """Text of the causes of patterns in `selected` pixels (h, w) that are not on the pixels' lines;
    names: of the backgrounds."""
    x = patterns.source
    per_pixel = {}
    for k in range(1, len(x)):
        step = np.where(np.arange(len(x)) >= k, 1.0, 0.0)
        per_pixel[_RENEWED.format("offsets", f"from {names[k]} on")] = [step]
        per_pixel[_RENEWED.format("gains", f"from {names[k]} on")] = [step * x]
    parts = [
        (patterns.high[kind][:, selected], np.median(noise[:, selected], axis=1))
        for kind, noise in patterns.noise.items()
    ]
    moved: dict[str, list[list[Floats]]] = {}
    for k, name in enumerate(names):
        remaining, mask = np.arange(len(x)) != k, (np.arange(len(x)) == k)[:, None]
        design = np.stack([x, np.ones_like(x)], axis=1)
        weight = design[k] @ np.linalg.pinv(design[remaining])
        steps = {
            kind: [mask * g[selected] for g in _steps(np.tensordot(weight, high[remaining], 1))]
            for kind, high in patterns.high.items()
        }
        zero = np.zeros_like(parts[0][0])
        moved[f"images at {name} look moved"] = [
            list(pair) for pair in zip(*steps.values(), strict=True)
        ]
        for number, (kind, own_steps) in enumerate(steps.items()):
            moved[f"{kind}s at {name} look moved"] = [
                [zero] * number + [g] + [zero] * (1 - number) for g in own_steps
            ]
    message = _describe(parts, [x, np.ones_like(x)], per_pixel=per_pixel, moved=moved, turned={})
    return message + (
        ": was the correction (NUC) renewed more than once?" if message.startswith("none") else ""
    )


def _steps(image: Floats) -> list[Floats]:
    """Differences (.., h, w) of an image that is moved by one pixel from itself, of which any move
    by less is a sum."""
    moves = [(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1) if y or x]
    return [np.roll(image, move, axis=(-2, -1)) - image for move in moves]


def _describe(
    parts: Sequence[tuple[Floats, Floats]],
    base: Sequence[Floats],
    *,
    per_pixel: Mapping[str, Sequence[Floats]],
    moved: Mapping[str, Sequence[Sequence[Floats]]],
    turned: Mapping[str, Floats],
) -> str:
    """Text of the causes of patterns that the columns `base` (K,) of each pixel do not explain.

    parts: patterns (K, N) and their variances (K,). per_pixel: further columns (K,) of each pixel.
    moved: fields (K, N) of each part, with one factor each. turned: fields without one.
    """

    def residuals(values: Floats, variance: Floats, columns: Sequence[Floats] = ()) -> Floats:
        white = values / np.sqrt(variance)[:, None]
        if not (all_columns := [*base, *columns]):
            return white
        basis = np.linalg.qr(np.array(all_columns).T / np.sqrt(variance)[:, None])[0]
        return np.asarray(white - basis @ (basis.T @ white))

    def chi2(columns: Sequence[Floats] = (), field: Floats | float = 0.0) -> float:
        return float(
            sum(
                np.sum(residuals(values - field, variance, columns) ** 2)
                for values, variance in parts
            )
        )

    (count, _), pixels = parts[0][0].shape, sum(values.shape[1] for values, _ in parts)
    degrees = pixels * (count - len(base))
    tried = [
        Hypothesis(cause, chi2(columns), pixels * len(columns))
        for cause, columns in per_pixel.items()
    ]
    for cause, fields in moved.items():
        white = [
            np.concatenate(
                [
                    residuals(values, variance).ravel()
                    for values, (_, variance) in zip(of_parts, parts, strict=True)
                ]
            )
            for of_parts in (*fields, [values for values, _ in parts])
        ]
        design, rest = np.array(white[:-1]).T, white[-1]
        rest = rest - design @ np.linalg.lstsq(design, rest, rcond=None)[0]
        tried.append(Hypothesis(cause, float(rest @ rest), len(fields)))
    tried += [Hypothesis(cause, chi2(field=field), 0) for cause, field in turned.items()]
    tried = [h for h in tried if h.unknowns < degrees]
    # Errors of the model of the noise, and odd pixels, count as chance.
    smallest = min((h.chi2 / (degrees - h.unknowns) for h in tried), default=1.0)
    scale = float(np.clip(smallest, 1.0, _MODEL))
    causes = [replace(h, chi2=h.chi2 / scale) for h in tried]
    none = chi2() / scale
    return describe(fitted(causes, none=none, degrees=degrees), none=none, tried=len(causes))
