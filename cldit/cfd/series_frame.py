"""One nozzle and one axis for all times of a case, so that its pictures lie on each other."""

from __future__ import annotations

from collections.abc import Sequence

from cldit.cfd.formats import find_format, read_case
from cldit.cfd.orientation import Frame, find_frame
from cldit.errors import SprayError
from cldit.io.progress import Watch, silent
from cldit.scene.spray import CfdSpray

_EXACT_m = 1e-4  # a nozzle that is known so well is taken without a look at further times
_TRIED = (1.0, 0.5, 0.25, 0.75, 0.0)  # places in the row of times, in this order


def with_one_frame(
    spec: CfdSpray, times: Sequence[float], *, watch: Watch = silent
) -> tuple[CfdSpray, tuple[str, ...]]:
    """The case with nozzle and axis fixed, as they are found at the time that tells them best.

    Args:
        spec: the case.
        times: all that it has, rising.
        watch: told how far the reading is.

    Returns:
        The case, and remarks on where nozzle and axis come from; unchanged, where they are given or
        the file is cldit's own.

    Raises:
        SprayError: they cannot be told at any of the times tried.
    """
    if find_format(spec) == "cldit" or (spec.nozzle_m is not None and spec.axis is not None):
        return spec, ()
    best: Frame | None = None
    problem: SprayError | None = None
    for at in dict.fromkeys(round(place * (len(times) - 1)) for place in _TRIED):
        here = spec.model_copy(update={"time_s": times[at]})
        try:
            frame = find_frame(here, read_case(here, watch))
        except SprayError as error:
            problem = problem or error
            continue
        if best is None or frame.error_m < best.error_m:
            best = frame
        if best.error_m <= _EXACT_m:
            break
    if best is None:
        assert problem is not None
        raise problem
    nozzle_m, axis = (tuple(map(float, each)) for each in (best.nozzle_m, best.axis))
    return spec.model_copy(update={"nozzle_m": nozzle_m, "axis": axis}), best.remarks
