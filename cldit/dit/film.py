"""Whole images: one check over all readers, on the counts as they were read.

With a camera's noise, no row of an image is equal to the same row of another one, and none has one
value over an eighth of its width. A row that does was lost on its way or is that of an older image,
whatever file it came from. Bits and steps of the counts are compared as well, and the kind of each
image with the others of its background.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from cldit.arrays import Floats, Mask
from cldit.dit.chance import DEVIATIONS, IMPROBABLE, NEARLY_ALL
from cldit.dit.fingerprint import EIGHTH, Fingerprint
from cldit.dit.shots import AllSums, Sums, thumbnail_edges
from cldit.dit.solve import KINDS
from cldit.dit.witness.finding import Witness
from cldit.errors import EvaluationError

_LEAST_LAG = 0.002  # of the image before, that is worth a warning
_EXPLAINED = 0.8  # least share of the squares that two kinds of images explain


def damaged(sums: AllSums) -> dict[str, str]:
    """Images with lost lines, or with rows of an older image: what is wrong, by id."""
    groups = [sums[key] for key in sorted(sums, key=lambda at: (at[0], at[1] == "injection"))]
    frames = [frame for group in groups for frame in group.frames]
    ids = [name for group in groups for name in group.ids]
    variances = [float(np.median(group.variance())) for group in groups]
    noise = np.sqrt(min((variance for variance in variances if variance > 0.0), default=0.0))
    if not noise > 0.0:  # a simulation without noise, or single images
        return {}
    high, wide = groups[0].total.shape
    alike = min(0.9, 0.3 / noise) if all(group.rounded for group in groups) else 1e-3
    # pixels of a row with which chance reports IMPROBABLE rows in a whole recording
    fewest = np.log(IMPROBABLE / (len(ids) * high * wide)) / np.log(alike)
    rows = np.stack([frame.rows for frame in frames])
    owner = np.tile(np.arange(len(ids))[:, None], high)
    for row in range(high // EIGHTH, high - high // EIGHTH):
        _, first_image, inverse = np.unique(rows[:, row], return_index=True, return_inverse=True)
        owner[:, row] = first_image[inverse]
    old = owner != np.arange(len(ids))[:, None]
    lost = np.stack([frame.runs for frame in frames]) >= max(fewest, EIGHTH, wide // EIGHTH)
    old &= ~lost & (old.mean(axis=0) < NEARLY_ALL)
    old &= np.stack([frame.free for frame in frames]) >= fewest
    lost &= lost.mean(axis=0) < NEARLY_ALL
    lost &= np.concatenate([_deviates(group, float(noise)) for group in groups])
    messages: dict[str, str] = {}
    for number, name in enumerate(ids):
        if lost[number].any():
            messages[name] = f"shot {name}: lost lines: {_listed(lost[number])} have one value"
        elif old[number].any() and old[number].sum() < high - 2 * (high // EIGHTH):
            source = ids[np.bincount(owner[number, old[number]]).argmax()]
            messages[name] = (
                f"shot {name}: half-old frame: {_listed(old[number])} are those of {source}"
            )
    return messages


def _deviates(group: Sums, noise: float) -> Mask:
    """Rows (n, h) in whose blocks images differ from their median by more than the noise."""
    small = np.array(group.thumbnails)
    off = np.abs(small - np.median(small, axis=0)).max(axis=2)
    high = group.total.shape[0]
    block = np.searchsorted(thumbnail_edges(high), np.arange(high), side="right") - 1
    return np.asarray(
        off[:, block] > DEVIATIONS * noise / np.sqrt(group.total.size / small[0].size)
    )


def _listed(rows: Mask) -> str:
    numbers = np.flatnonzero(rows)
    if numbers.size > 2 and np.ptp(numbers) == numbers.size - 1:
        return f"rows {numbers[0]} to {numbers[-1]}"
    remainder = f", .. ({numbers.size} of {rows.size})" if numbers.size > 2 else ""
    return f"rows {', '.join(map(str, numbers[:2]))}{remainder}"


def check_depths(sums: AllSums) -> None:
    """Raises EvaluationError if some images have 8 bits and others more, or counts in other steps:
    they are not in one unit.
    """
    frames = [(kind, name, frame) for (_, kind), group in sorted(sums.items(), reverse=True)
              for name, frame in zip(group.ids, group.frames, strict=True)]  # fmt: skip
    for template, values in (
        ("{} bits", [frame.bits for *_, frame in frames]),
        ("counts in steps of {}", [frame.step for *_, frame in frames]),
    ):
        examples = {value: frames[values.index(value)] for value in dict.fromkeys(values) if value}
        if len(examples) < 2 or (template == "{} bits" and min(examples) > 8):
            continue
        listed = [
            f"{_whose(kind, value, values, frames)} {template.format(value)} (first {name})"
            for value, (kind, name, _) in examples.items()
        ]
        raise EvaluationError(
            f"mixed depths: {', '.join(listed)}; export all images with one depth and alignment"
        )


def _whose(
    kind: str, value: int, values: Sequence[int], frames: Sequence[tuple[str, str, Fingerprint]]
) -> str:
    """Subject of a sentence: one whole kind, or some images."""
    same = [k for (k, *_), v in zip(frames, values, strict=True) if v == value]
    entire = {k for k in same} == {kind} and len(same) == sum(k == kind for k, *_ in frames)
    return f"{kind}s have" if entire else f"{len(same)} images have"


def repeats(sums: AllSums) -> dict[str, str]:
    """Images that repeat another one, impossible with noise: what is wrong, by id. Of those of one
    group, the first is good; flat images are no repeats."""
    same: dict[bytes, list[tuple[tuple[float, str], str]]] = {}
    for key, group in sorted(sums.items()):
        for name, frame in zip(group.ids, group.frames, strict=True):
            if not frame.flat:
                same.setdefault(frame.digest, []).append((key, name))
    messages: dict[str, str] = {}
    for images in same.values():
        across_groups = len({key for key, _ in images}) > 1
        for _, name in images if across_groups else images[1:]:
            twin = next(image_id for _, image_id in images if image_id != name)
            messages[name] = f"shot {name}: repeats {twin}: a frozen camera, or a copied file"
    return messages


def lag(sums: AllSums) -> Witness | None:
    """Witness of references that contain a part of the injection before."""
    product, square, rest, count = 0.0, 0.0, 0.0, 0
    for setpoint in sorted({setpoint for setpoint, _ in sums}):
        taken = sorted(
            (place.at, kind, number)
            for kind in KINDS
            for number, place in enumerate(sums[setpoint, kind].places)
        )
        pairs = [
            (sums[setpoint, "reference"].thumbnails[number], sums[setpoint, previous].thumbnails[n])
            for (_, previous, n), (_, kind, number) in pairwise(taken)
            if kind == "reference"
        ]
        if len(pairs) > 2:
            image, earlier = (
                np.array(stack, float).reshape(len(pairs), -1) for stack in zip(*pairs, strict=True)
            )
            mean = image.mean(axis=0)
            common = np.linalg.qr(np.array([np.ones_like(mean), mean]).T)[0]  # of drifts
            off, change = (
                deviation - deviation @ common @ common.T
                for deviation in (image - mean, earlier - earlier.mean(axis=0))
            )
            product += float(np.sum(off * change))
            square += float(np.sum(change**2))
            rest, count = rest + float(np.sum(off**2)), count + off.size
    if not square > 0.0:
        return None
    share, noise = product / square, np.sqrt(rest / count / square)
    if share < max(DEVIATIONS * noise, _LEAST_LAG):
        return None
    return Witness(
        name="repeats",
        says=f"images contain {100.0 * share:.2g} % of the image before (lag): emissivities are "
        "too low by about that; leave more time between images, or take the kinds in blocks",
        stands_out=True,
    )


def check_turns(sums: AllSums) -> None:
    """Raises EvaluationError if images of both kinds were exchanged from one image on, as after a
    dropped frame of a film that takes the kinds in turns.
    """
    for setpoint in sorted({setpoint for setpoint, _ in sums}):
        groups = [sums[setpoint, kind] for kind in KINDS]
        steps = [_step(np.array(group.thumbnails, float)) for group in groups]
        if steps[0] is None or steps[1] is None:
            continue
        (reference_at, change), (injection_at, opposite) = steps[0], steps[1]
        squares = float(np.sum(change**2) + np.sum(opposite**2))
        if float(np.sum((change + opposite) ** 2)) < (1.0 - _EXPLAINED) * squares:
            raise EvaluationError(
                f"background {setpoint:g} K: from {groups[0].ids[reference_at]} and "
                f"{groups[1].ids[injection_at]} on, references and injections are exchanged: a "
                "dropped frame in a film that takes them in turns; select the parts before and "
                "after it"
            )


def _step(images: Floats) -> tuple[int, Floats] | None:
    """Number of the image at which a sequence (n, ..) changes, and the change; None if nothing
    explains its squares."""
    deviations = images - images.mean(axis=0)
    best: tuple[float, int] = (0.0, 0)
    for number in range(1, len(images)):
        early, late = deviations[:number].mean(axis=0), deviations[number:].mean(axis=0)
        gained = number * np.sum(early**2) + (len(images) - number) * np.sum(late**2)
        best = max(best, (float(gained), number))
    if best[0] < _EXPLAINED * float(np.sum(deviations**2)) or not best[1]:
        return None
    return best[1], images[best[1] :].mean(axis=0) - images[: best[1]].mean(axis=0)
