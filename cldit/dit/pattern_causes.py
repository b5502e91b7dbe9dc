"""Causes of pixel patterns that differ, as hypotheses that are fitted to the same pixels: the
camera's correction was renewed, or images moved, or were turned."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.dit.hypotheses import Hypothesis, fitted, said

if TYPE_CHECKING:
    from cldit.dit.witness.pixels import Patterns

TURNS: dict[str, Callable[[Floats], Floats]] = {
    "upside down": lambda image: image[::-1],
    "mirrored left to right": lambda image: image[:, ::-1],
    "turned by 180 degrees": lambda image: image[::-1, ::-1],
    "with rows and columns exchanged": lambda image: image.T,
    "turned by 90 degrees": lambda image: np.rot90(image),
    "turned by 270 degrees": lambda image: np.rot90(image, 3),
    "with rows and columns exchanged and turned by 180 degrees": lambda image: image.T[::-1, ::-1],
}
_MODEL = 1.5  # largest chi-square by degree of freedom that a right cause leaves
_RENEWED = "the camera's correction (NUC) renewed {} {}"


def between_kinds(patterns: "Patterns", here: Mask, *, offsets: bool, gains: bool) -> str:
    """Text of the causes of patterns of injections that are not those of references.

    here: (h, w) pixels. offsets, gains: which of them changed beyond doubt; what is left of the
    other, as the slopes of thin spray, is no finding.
    """
    x, reference = patterns.source, patterns.high["reference"]
    change = (patterns.high["injection"] - reference)[:, here]
    each = [np.median(one[:, here], axis=1) for one in patterns.noise.values()]
    columns = {"offsets": np.ones_like(x), "gains": x}
    changed = [name for name, beyond in (("offsets", offsets), ("gains", gains)) if beyond]
    own = {
        _RENEWED.format(" and ".join(names), "between the kinds"): [columns[name] for name in names]
        for names in dict.fromkeys([*((name,) for name in changed), tuple(changed)])
    }
    turned = {
        f"injections look {text}": (np.array([turn(each) for each in reference]) - reference)[
            :, here
        ]
        for text, turn in TURNS.items()
        if turn(reference[0]).shape == here.shape
    }
    moved = {"injections look moved": [[one[:, here]] for one in _steps(reference)]}
    base = [column for name, column in columns.items() if name not in changed]
    return _said([(change, np.sum(each, axis=0))], base, own=own, moved=moved, turned=turned)


def between_backgrounds(patterns: "Patterns", here: Mask, names: Sequence[str]) -> str:
    """Text of the causes of patterns in the pixels `here` (h, w) that are not on the pixels' lines;
    names: of the backgrounds."""
    x = patterns.source
    own = {}
    for k in range(1, len(x)):
        step = np.where(np.arange(len(x)) >= k, 1.0, 0.0)
        own[_RENEWED.format("offsets", f"from {names[k]} on")] = [step]
        own[_RENEWED.format("gains", f"from {names[k]} on")] = [step * x]
    parts = [
        (patterns.high[kind][:, here], np.median(noise[:, here], axis=1))
        for kind, noise in patterns.noise.items()
    ]
    moved: dict[str, list[list[Floats]]] = {}
    for k, name in enumerate(names):
        others, alone = np.arange(len(x)) != k, (np.arange(len(x)) == k)[:, None]
        design = np.stack([x, np.ones_like(x)], axis=1)
        weight = design[k] @ np.linalg.pinv(design[others])
        steps = {
            kind: [alone * one[here] for one in _steps(np.tensordot(weight, high[others], 1))]
            for kind, high in patterns.high.items()
        }
        zero = np.zeros_like(parts[0][0])
        moved[f"images at {name} look moved"] = [
            list(both) for both in zip(*steps.values(), strict=True)
        ]
        for number, (kind, own_steps) in enumerate(steps.items()):
            moved[f"{kind}s at {name} look moved"] = [
                [zero] * number + [one] + [zero] * (1 - number) for one in own_steps
            ]
    text = _said(parts, [x, np.ones_like(x)], own=own, moved=moved, turned={})
    return text + (
        ": was the correction (NUC) renewed more than once?" if text.startswith("none") else ""
    )


def _steps(image: Floats) -> list[Floats]:
    """Differences (.., h, w) of an image that is moved by one pixel from itself, of which any move
    by less is a sum."""
    moves = [(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1) if y or x]
    return [np.roll(image, move, axis=(-2, -1)) - image for move in moves]


def _said(
    parts: Sequence[tuple[Floats, Floats]],
    base: Sequence[Floats],
    *,
    own: Mapping[str, Sequence[Floats]],
    moved: Mapping[str, Sequence[Sequence[Floats]]],
    turned: Mapping[str, Floats],
) -> str:
    """Text of the causes of patterns that the columns `base` (K,) of each pixel do not explain.

    parts: patterns (K, N) and their variances (K,). own: further columns (K,) of each pixel. moved:
    fields (K, N) of each part, with one factor each. turned: fields without one.
    """

    def left(values: Floats, variance: Floats, columns: Sequence[Floats] = ()) -> Floats:
        white = values / np.sqrt(variance)[:, None]
        if not (all_of := [*base, *columns]):
            return white
        basis = np.linalg.qr(np.array(all_of).T / np.sqrt(variance)[:, None])[0]
        return np.asarray(white - basis @ (basis.T @ white))

    def chi2(columns: Sequence[Floats] = (), less: Floats | float = 0.0) -> float:
        return float(sum(np.sum(left(one - less, var, columns) ** 2) for one, var in parts))

    (count, _), pixels = parts[0][0].shape, sum(one.shape[1] for one, _ in parts)
    degrees = pixels * (count - len(base))
    tried = [(text, chi2(columns), pixels * len(columns)) for text, columns in own.items()]
    for text, fields in moved.items():
        white = [
            np.concatenate(
                [left(one, var).ravel() for one, (_, var) in zip(each, parts, strict=True)]
            )
            for each in (*fields, [one for one, _ in parts])
        ]
        design, rest = np.array(white[:-1]).T, white[-1]
        rest = rest - design @ np.linalg.lstsq(design, rest, rcond=None)[0]
        tried.append((text, float(rest @ rest), len(fields)))
    tried += [(text, chi2(less=field), 0) for text, field in turned.items()]
    tried = [one for one in tried if one[2] < degrees]
    # Errors of the model of the noise, and odd pixels, count as chance.
    least = min((left2 / (degrees - n) for _, left2, n in tried), default=1.0)
    scale = float(np.clip(least, 1.0, _MODEL))
    causes = [Hypothesis(text, left2 / scale, n) for text, left2, n in tried]
    none = chi2() / scale
    return said(fitted(causes, none=none, degrees=degrees), none=none, tried=len(causes))
