"""Faults of laboratories, each applied to the recording of a known spray."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import shift

from cldit.arrays import Floats
from cldit.optics.planck import temperature_of_radiance
from tests.laboratory import BACKGROUNDS_K, CAMERA, FILTER_UM, Laboratory, laboratory
from tests.verify.evaluation_bias import Shot

Change = Callable[[Shot], Shot]

SHAPE = (36, 48)


def edit(made: Laboratory, change: Change) -> Laboratory:
    """The recording with every shot changed."""
    made.recorded.shots = [change(shot) for shot in made.recorded.shots]
    return made


def counts(image: Floats) -> NDArray[np.uint16]:
    """Counts of 14 bits."""
    return np.clip(np.rint(image), 0, 16383).astype(np.uint16)


def images(made: Laboratory, change: Callable[[Shot, Floats], Floats]) -> Laboratory:
    """The recording with every image changed."""
    return edit(
        made, lambda shot: replace(shot, image=counts(change(shot, shot.image.astype(float))))
    )


def renewed_offsets(made: Laboratory, seed: int, size: float, *, by: str) -> Laboratory:
    """A non-uniformity correction renewed for each kind, background, or both (`by`)."""
    rng = np.random.default_rng(seed)
    patterns: dict[Any, Floats] = {}

    def change(shot: Shot, image: Floats) -> Floats:
        key = {
            "kind": shot.kind,
            "background": shot.background_K,
            "both": (shot.kind, shot.background_K),
        }[by]
        if key not in patterns:
            patterns[key] = size * rng.standard_normal(image.shape)
        return image + patterns[key]

    return images(made, change)


def renewed_gains(made: Laboratory, seed: int, size: float) -> Laboratory:
    """A two-point correction renewed between references and injections."""
    pattern = size * np.random.default_rng(seed).standard_normal(SHAPE)
    return images(
        made, lambda shot, image: image * (1.0 + pattern) if shot.kind == "injection" else image
    )


def moved(
    made: Laboratory, background_K: float, pixels: float, *, kinds: tuple[str, ...]
) -> Laboratory:
    """Images of one background resampled at other columns."""

    def change(shot: Shot, image: Floats) -> Floats:
        if shot.background_K != background_K or shot.kind not in kinds:
            return image
        return shift(image, (0.0, pixels), order=1, mode="nearest")

    return images(made, change)


def bent(made: Laboratory, share: float) -> Laboratory:
    """A detector whose response at full scale is lower by `share`."""
    return images(made, lambda _, image: image * (1.0 - share * image / 16383.0))


def scattered(seed: int, size_K: float, *, common_K: float = 0.0, **more: Any) -> Laboratory:
    """A black body whose temperature differs from its reading at every set point."""
    rng = np.random.default_rng(1000 + seed)
    off_K = {k: common_K + size_K * rng.standard_normal() for k in BACKGROUNDS_K}
    return _clean(seed, off_K=off_K, **more)


def plate(seed: int) -> Laboratory:
    """A black body 1 K too hot at one edge and 1 K too cold at the other."""
    slope = np.linspace(-1.0, 1.0, SHAPE[1])[None, :] * np.ones(SHAPE)
    return _clean(seed, off_K={k: slope for k in BACKGROUNDS_K})


def one_swapped(made: Laboratory) -> Laboratory:
    """One reference and one injection exchanged."""
    names = {"b01_ref_02": "b01_inj_03", "b01_inj_03": "b01_ref_02"}
    found = {shot.id: shot.image for shot in made.recorded.shots}
    return edit(made, lambda shot: replace(shot, image=found[names.get(shot.id, shot.id)]))


def zero_reference(made: Laboratory) -> Laboratory:
    """A reference that was never written, with a row of telemetry."""

    def change(shot: Shot) -> Shot:
        if shot.id != "b02_ref_04":
            return shot
        image = np.zeros_like(shot.image)
        image[0] = 17
        return replace(shot, image=image)

    return edit(made, change)


def clipped(made: Laboratory, background_K: float, share: float) -> Laboratory:
    """A camera that ends at a share of the largest signal of one background."""
    level = share * max(
        float(np.percentile(shot.image, 99))
        for shot in made.recorded.shots
        if shot.background_K == background_K
    )
    return images(made, lambda _, image: np.minimum(image, level))


def superframed(made: Laboratory, share: float) -> Laboratory:
    """Integration times in turns."""

    def change(shot: Shot, image: Floats) -> Floats:
        return 300.0 + share * (image - 300.0) if int(shot.id[-2:]) % 2 else image

    return images(made, change)


def frozen(made: Laboratory) -> Laboratory:
    """A camera that repeats an image, with a row that counts."""
    found = {shot.id: shot.image for shot in made.recorded.shots}

    def change(shot: Shot) -> Shot:
        if not shot.id.startswith("b01_inj") or shot.id[-2:] < "04":
            return shot
        image = found["b01_inj_03"].copy()
        image[-1] = int(shot.id[-2:])
        return replace(shot, image=image)

    return edit(made, change)


def white_is_low(made: Laboratory) -> Laboratory:
    """Dark pixels stored as large numbers."""
    return images(made, lambda _, image: 16383.0 - image)


def wrapped(made: Laboratory) -> Laboratory:
    """Counts up to 48 000 stored as integers of 16 bits with a sign."""
    return edit(
        made, lambda shot: replace(shot, image=(shot.image.astype(int) * 8).astype(np.int16))
    )


def own_ranges(made: Laboratory) -> Laboratory:
    """Each image scaled to 0..255."""

    def change(shot: Shot) -> Shot:
        low, high = float(shot.image.min()), float(shot.image.max())
        return replace(shot, image=np.rint((shot.image - low) / (high - low) * 255.0))

    return edit(made, change)


def temperatures(made: Laboratory, *, zero_K: float = 0.0, factor: float = 1.0) -> Laboratory:
    """Images of temperatures, as programs of cameras export them."""

    def change(shot: Shot) -> Shot:
        light = np.maximum(shot.image.astype(float) - 300.0, 1.0) / CAMERA.counts_per_radiance
        kelvin = temperature_of_radiance(light / 0.85, filter_um=FILTER_UM)
        return replace(shot, image=((kelvin - zero_K) * factor).astype(np.float32))

    return edit(made, change)


def _clean(seed: int, **more: Any) -> Laboratory:
    return laboratory(seed, shape=SHAPE, references=10, shots=10, scatter=0.03 * (seed % 2), **more)


def in_units(made: Laboratory, size: float) -> Laboratory:
    """Images in a unit of so many counts, in float."""
    edit(made, lambda shot: replace(shot, image=shot.image / size))
    given = made.recorded.calibration
    made.recorded.calibration = {
        "filter_um": given["filter_um"],
        "saturation_counts": given["saturation_counts"] / size,
    }
    return made


def kinked(made: Laboratory) -> Laboratory:
    """A detector whose response is steeper by 3 % above 3000 counts."""
    return images(made, lambda _, image: image + 0.03 * np.maximum(image - 3000.0, 0.0))


def tilted(seed: int) -> Laboratory:
    """A black body that is warmer at another edge at each set point."""
    rng = np.random.default_rng(2000 + seed)
    slope = np.linspace(-1.0, 1.0, SHAPE[1])[None, :] * np.ones(SHAPE)
    return _clean(seed, off_K={k: rng.standard_normal() * slope for k in BACKGROUNDS_K})


FAULTS: dict[str, Callable[[int], Laboratory]] = {
    "clean": _clean,
    "offsets renewed between kinds, 15 counts": lambda s: renewed_offsets(
        _clean(s), s, 15.0, by="kind"
    ),
    "offsets renewed between kinds, 5 counts": lambda s: renewed_offsets(
        _clean(s), s, 5.0, by="kind"
    ),
    "offsets renewed between backgrounds, 15 counts": lambda s: renewed_offsets(
        _clean(s), s, 15.0, by="background"
    ),
    "offsets renewed at every recording, 15 counts": lambda s: renewed_offsets(
        _clean(s), s, 15.0, by="both"
    ),
    "gains renewed between kinds, 0.2 %": lambda s: renewed_gains(_clean(s), s, 0.002),
    "hottest background clipped": lambda s: clipped(_clean(s), 523.0, 0.7),
    "second background clipped everywhere": lambda s: clipped(_clean(s), 453.0, 1.02),
    "half a pixel, all images at 483 K": lambda s: moved(
        _clean(s), 483.0, 0.5, kinds=("reference", "injection")
    ),
    "half a pixel, all images at 423 K": lambda s: moved(
        _clean(s), 423.0, 0.5, kinds=("reference", "injection")
    ),
    "half a pixel, injections at 523 K": lambda s: moved(
        _clean(s), 523.0, 0.5, kinds=("injection",)
    ),
    "spray half a pixel, 453 K": lambda s: _clean(s, spray_shift={453.0: (0.0, 0.5)}),
    "black body 1 K off": lambda s: scattered(s, 0.0, common_K=1.0),
    "set points scatter by 0.3 K": lambda s: scattered(s, 0.3),
    "one set point 1 K off": lambda s: _clean(s, off_K={BACKGROUNDS_K[s % 4]: 1.0}),
    "plate +-1 K": plate,
    "detector bent by 3 %": lambda s: bent(_clean(s), 0.03),
    "detector kinked by 3 %": lambda s: kinked(_clean(s)),
    "plate tilts otherwise at each set point": tilted,
    "float in thousands of counts": lambda s: in_units(_clean(s), 1e3),
    "float in millions of counts": lambda s: in_units(_clean(s), 1e6),
    "one reference and one injection swapped": lambda s: one_swapped(_clean(s)),
    "a reference of zeros": lambda s: zero_reference(_clean(s)),
    "superframing": lambda s: superframed(_clean(s), 0.5),
    "dark pixels are large numbers": lambda s: white_is_low(_clean(s)),
    "counts wrap at 16 bits": lambda s: wrapped(_clean(s)),
    "images scaled to their own range": lambda s: own_ranges(_clean(s)),
    "temperatures in K": lambda s: temperatures(_clean(s)),
    "temperatures in degrees Celsius times 10": lambda s: temperatures(
        _clean(s), zero_K=273.15, factor=10.0
    ),
    "frozen camera with a counter": lambda s: frozen(_clean(s)),
    "offset between kinds, 20 counts": lambda s: _clean(s, offset_of_injections=20.0),
    "black body between kinds, 0.5 K": lambda s: _clean(s, blackbody_of_injections_K=0.5),
    "gain changes by 1 % at one background": lambda s: _clean(
        s, gain_from={BACKGROUNDS_K[s % 4]: 0.01}
    ),
}
