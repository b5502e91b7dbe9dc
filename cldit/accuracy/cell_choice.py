"""Choice of the cells by a few coarse traces, each of which costs an eighth of the next."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from cldit.accuracy.image_pair import ImagePair
from cldit.accuracy.resolution import too_many
from cldit.accuracy.richardson import error_at, predicted_error
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.errors import MediumError, SprayError, TransportError

_FINEST = 12  # 4096 cells along an edge
_SAFE = 0.92  # of the tolerance, which predicted errors aim at
_ORDER, _LEAST = 1.4, 0.35  # highest order of a prediction, and how much smaller cells may be
_CLOSE = 1.1  # of the tolerance: a coarse trace of the image's own cells costs as much as that
_ACROSS = 32  # cells across the image, of the coarsest trace
_ALL_HALVINGS = (
    f"the cube is halved {_FINEST} times at most; allowed: a smaller domain.edge_m, or a larger "
    "transport.accuracy_K"
)


@dataclass(frozen=True)
class Cells:
    """The chosen cells.

    depth: number of times that the cube is halved. error_K: found or predicted; None: unknown.
    limited: why it is not halved more often, if the tolerance needs it; else empty. less: edge of
    the chosen cells over that of `depth`, where any edge is possible.
    """

    depth: int
    error_K: float | None
    limited: str = ""
    less: float = 1.0


def coarse_depths(tracer: VariantTracer) -> range:
    """Numbers of halvings for coarse traces: the first is the coarsest to try."""
    across = tracer.scene.camera.field_m
    depth = max(3, math.ceil(math.log2(_ACROSS * tracer.prepared.cube.edge_m / max(across))))
    return range(min(depth, _FINEST - 3), _FINEST - 2)


def choose_cells(
    tracer: VariantTracer, allowed_K: Callable[[ImagePair], float], say: Callable[[str], None]
) -> Cells | None:
    """The largest cells within the tolerance; None if no pixel has a T_app.

    `allowed_K` is the error that the cells may have, by an image of theirs. The search ends
    when the error that is predicted for the next finer cells is small enough, so that these are
    traced once, for the image of the run.

    Raises:
        SprayError: the cone suits none of the coarse lattices.
        TransportError: cells reach behind a patch, however small.
        MediumError: not even coarse cells fit the memory.
    """
    cube = tracer.prepared.cube
    coarse = coarse_depths(tracer)
    depth, traced = coarse[0], 0
    while traced < 2:
        say(f"coarse trace: cells of {1e3 * cube.at(depth).cell_m:.3g} mm")
        try:
            tracer.level(depth)
            traced += 1
        except (SprayError, TransportError):  # as in `error_at`
            if depth >= coarse[-1]:
                raise
            traced = 0
        depth += 1
    while True:
        say(f"coarse trace: cells of {1e3 * cube.at(depth).cell_m:.3g} mm")
        try:
            found = error_at(tracer, depth)
        except MediumError:
            before = error_at(tracer, depth - 1)
            error_K = None if before is None else before.difference.error_K
            return Cells(depth - 1, error_K, too_many(cube.at(depth).cell_m))
        except SprayError:
            # The finest lattice that suits the cone lies between: the run finds it, step by step.
            return Cells(depth, predicted_error(tracer, depth)[0])
        if found is None or found.difference.error_K is None:
            return None
        error_K, tolerance_K = found.difference.error_K, allowed_K(tracer.level(depth))
        if (found.bound_K or 0.0) > _CLOSE * tolerance_K and depth < _FINEST:
            depth += 1  # outside the asymptotic range: finer cells tell the order
            continue
        # Coarse cells overestimate the order: it is limited for the prediction of the next.
        less = (_SAFE * tolerance_K / error_K) ** (1.0 / min(found.order, _ORDER))
        if tracer.prepared.on_lattice and less >= _LEAST:
            return Cells(depth, _SAFE * tolerance_K, less=min(less, 1.0))
        if error_K <= tolerance_K:
            return Cells(depth, error_K)
        if depth == _FINEST:
            return Cells(depth, error_K, _ALL_HALVINGS)
        predicted_K = error_K / 2**found.order
        if predicted_K <= _CLOSE * tolerance_K:
            return Cells(depth + 1, predicted_K)
        if depth + 1 == _FINEST:
            return Cells(depth + 1, predicted_K, _ALL_HALVINGS)
        depth += 1
