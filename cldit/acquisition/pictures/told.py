"""What files say of their pictures: when each was taken, and how long it was exposed.

Only what a format defines is read: headers of Telops' films, OME-XML, Exif's exposure and original
time, NeXus' NXdetector. TIFF's own date (tag 306) is that of the file, which an export makes anew.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from cldit.acquisition.pictures.columns import read_numbers
from cldit.acquisition.pictures.source import Told, moment_s
from cldit.errors import EvaluationError

_SAME = 0.01  # relative: registers of cameras round their exposure
_SAME_s = 1.0  # clocks that show whole seconds


def _number_or_moment(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return moment_s(text)


def read_times(
    folder: Path, given: Sequence[float] | str, *, where: str, count: int
) -> list[float]:
    """Times in seconds, in the order of the pictures.

    Args:
        folder: where relative paths start.
        given: seconds of one clock; or `log.csv::column`, which may hold dates in ISO 8601; or
            `run.nxs::/entry/time`.
        where: which pictures, for messages.
        count: how many pictures there are.

    Returns:
        One a picture, rising.

    Raises:
        EvaluationError: unreadable, another number than pictures, or not rising.
    """
    found = read_numbers(
        folder,
        given,
        column="time_s",
        allowed="seconds, or a date as 2026-01-31T12:00:00",
        convert=_number_or_moment,
    )
    if len(found) != count:
        raise EvaluationError(
            f"{where}: {count} pictures and {len(found)} times ({given}); allowed is one each"
        )
    for number, (before, after) in enumerate(pairwise(found), start=1):
        if not after > before:
            raise EvaluationError(
                f"{where}: time {number} is {after:.10g} s after {before:.10g} s ({given}); they "
                "must rise in the order of the pictures"
            )
    if not all(math.isfinite(one) for one in found):
        raise EvaluationError(f"{where}: times that are not finite ({given})")
    return found


def check_exposures(told: Iterable[tuple[str, Told]], stated_s: float | None) -> float | None:
    """The one exposure of all pictures that tell theirs, in seconds; None where none does.

    Args:
        told: of each picture, after the words that name it.
        stated_s: `integration_time_s` of the YAML.

    Raises:
        EvaluationError: two that differ.
    """
    known = [(name, one.integration_time_s) for name, one in told if one.integration_time_s]
    if not known:
        return None
    name, first_s = known[0]
    if stated_s is not None and abs(first_s - stated_s) > _SAME * stated_s:
        raise EvaluationError(
            f"{name}: exposed for {1e6 * first_s:g} us by its file; integration_time_s says "
            f"{1e6 * stated_s:g} us: correct it, or take the right files"
        )
    for other, exposed_s in known[1:]:
        if abs(exposed_s - first_s) > _SAME * first_s:
            raise EvaluationError(
                f"{other}: exposed for {1e6 * exposed_s:g} us by its file, {name} for "
                f"{1e6 * first_s:g} us; references and injections need one exposure"
            )
    return first_s


def check_times(told: Iterable[tuple[str, Told, float | None]]) -> None:
    """Times of the YAML against those of the files: both may start anywhere.

    Args:
        told: of each picture, after the words that name it, and its time by the YAML [s].

    Raises:
        EvaluationError: they are more than a second apart from each other in one than in the other.
    """
    apart = [
        (name, stated_s - one.time_s)
        for name, one, stated_s in told
        if one.time_s is not None and stated_s is not None
    ]
    for name, gap_s in apart[1:]:
        if abs(gap_s - apart[0][1]) > _SAME_s:
            raise EvaluationError(
                f"{name}: {gap_s - apart[0][1]:+.3g} s later after {apart[0][0]} by measured.yaml "
                "than by the files; leave the times out of the YAML, or correct them"
            )


def told_lines(told: Sequence[tuple[Told, float | None]]) -> list[str]:
    """What is known of exposures and times of all pictures, a line each.

    Args:
        told: of each picture, and its time as the evaluation takes it [s].

    Returns:
        None of those of which nothing is known.
    """
    lines = []
    exposed = [one.integration_time_s for one, _ in told if one.integration_time_s]
    if exposed:
        lines.append(f"exposure {1e6 * exposed[0]:g} us, by {len(exposed)} of {len(told)} pictures")
    times = [time_s for _, time_s in told if time_s is not None]
    if times:
        lines.append(f"times of {len(times)} of {len(told)} pictures, over {np.ptp(times):.4g} s")
    return lines
