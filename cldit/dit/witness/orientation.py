"""Orientation of images, by the fixed pattern of pixel gains.

The pattern of a camera's pixels relative to their neighbours is the same in references, injections
and at every background. If it correlates better with a mirrored, turned or shifted image, a program
changed that image. The shape of the spray checks the injections of one background against the
others.
"""

from collections.abc import Sequence

import numpy as np

from cldit.arrays import Floats
from cldit.dit.chance import clipped
from cldit.dit.hypotheses import TURNS
from cldit.dit.shots import AllSums
from cldit.dit.solve import DETECTION, KINDS
from cldit.dit.witness.finding import Witness, refusal
from cldit.dit.witness.patterns import neighbours

_DEVIATIONS = 8.0  # of a correlation of noise, 1 / sqrt(pixels)
_ALIKE = 0.8  # least correlation of two images of one spray


def orientation(sums: AllSums, setpoints: Sequence[float]) -> Witness | None:
    """Witness of images that differ in orientation from the references."""
    means = {key: group.mean() for key, group in sums.items()}
    patterns = {key: _pattern(mean) for key, mean in means.items()}
    total = np.sum([patterns[k, "reference"] for k in setpoints], axis=0)
    threshold = _DEVIATIONS / np.sqrt(total.size)  # none of fewer than 64 pixels
    wrong: list[str] = []
    for kind in KINDS:
        for setpoint in setpoints:
            pattern = patterns[setpoint, kind]
            expected = total - pattern if kind == "reference" else total
            change = _changed(pattern, expected, threshold=threshold, shifts=True)
            if change is not None:
                wrong.append(f"{kind}s at {setpoint:g} K are {change}")
    if not wrong:
        deltas = {k: _level(means[k, "injection"] - means[k, "reference"]) for k in setpoints}
        if len(setpoints) >= 3:
            delta_sum = np.sum(list(deltas.values()), axis=0)
            for setpoint, delta in deltas.items():
                expected = _level(delta_sum - delta)
                alike = max(_ALIKE, threshold)
                change = _changed(delta, expected, threshold=alike, shifts=False)
                if change is not None:
                    wrong.append(f"the spray at {setpoint:g} K is {change}")
    if not wrong:
        return None
    message = "images differ in orientation: " + "; ".join(wrong)
    return refusal("orientation", message, "turn these images back, or remove their backgrounds")


def _pattern(image: Floats) -> Floats:
    """Relative difference of each pixel from its four neighbours, clipped and normalised."""
    surrounding = neighbours(image)
    fine = (image - surrounding) / np.maximum(np.abs(surrounding), 1.0)
    return _level(clipped(fine, DETECTION))


def _level(image: Floats) -> Floats:
    """The image without its mean and with length 1; all 0 for a flat image."""
    flat = image - image.mean()
    size = float(np.sqrt(np.sum(flat**2)))
    return flat / size if size > 0.0 else np.zeros_like(flat)


def _changed(image: Floats, expected: Floats, *, threshold: float, shifts: bool) -> str | None:
    """Turn or shift of `image` that correlates with `expected` far better than none, in words."""
    length = float(np.sqrt(np.sum(expected**2)))
    if not length > 0.0:
        return None
    as_is = float(np.sum(image * expected)) / length
    tried = {
        turned: float(np.sum(turn(image) * expected)) / length
        for turned, turn in TURNS.items()
        if turn(image).shape == expected.shape
    }
    if shifts:
        spectrum = np.fft.rfft2(image) * np.conj(np.fft.rfft2(expected))
        alike = np.fft.irfft2(spectrum, s=image.shape) / length
        best = np.unravel_index(int(np.argmax(alike)), image.shape)
        rows, columns = (
            int(at) - size if at > size // 2 else int(at)
            for at, size in zip(best, image.shape, strict=True)
        )
        tried[f"shifted by {columns:+d} columns and {rows:+d} rows"] = float(alike[best])
    name = max(tried, key=lambda turned: tried[turned])
    if not tried[name] > max(threshold, 2.0 * abs(as_is)):
        return None
    better = (1.0 - as_is**2) / max(1.0 - tried[name] ** 2, 1e-9)
    return f"{name} (chi-square {better:.2g} times smaller than without)"
