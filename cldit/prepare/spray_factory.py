"""The spray that a scene names, from whichever model or file."""

from collections.abc import Iterator
from pathlib import Path
from typing import assert_never

from cldit.gpu.device import Device
from cldit.io.progress import Watch, silent
from cldit.scene.spray import CfdSpray, ConeSpray, EmptySpray, GridSpray, LagrangianSpray
from cldit.spray.penetration import with_figures
from cldit.spray.result import Spray

AnySpray = ConeSpray | LagrangianSpray | GridSpray | CfdSpray | EmptySpray


def make_spray(
    spec: AnySpray,
    device: Device | None = None,
    *,
    cache: Path | None = None,
    watch: Watch = silent,
) -> Spray:
    """Runs the model or reads the file; the notes include figures of `cldit.spray.penetration`.

    `device` computes the models' gas and droplets, and is not used for files. `cache` is the folder
    of tables of fuel properties and computed sprays, None keeps nothing; `watch` takes the progress
    of reading a CFD case.
    """
    return with_figures(_computed(spec, device, cache, watch))


def _computed(spec: AnySpray, device: Device | None, cache: Path | None, watch: Watch) -> Spray:
    # Each model is imported when a scene names it: CFD brings VTK.
    match spec:
        case ConeSpray():
            from cldit.spray.cone.spray import make_cone

            return make_cone(spec, _computing(device))
        case LagrangianSpray():
            from cldit.spray.cache import cached_spray
            from cldit.spray.flow.simulate import simulate_times

            def computed(times_s: tuple[float, ...]) -> Iterator[Spray]:
                return (
                    result[0]
                    for result in simulate_times(spec, times_s, _computing(device), cache=cache)
                )

            return cached_spray(spec, cache, computed)
        case GridSpray():
            from cldit.spray.grid import read_grid

            return read_grid(spec)
        case CfdSpray():
            from cldit.cfd.to_spray import read_cfd

            return read_cfd(spec, watch=watch)
        case EmptySpray():
            return Spray()
        case _ as unreachable:
            assert_never(unreachable)


def _computing(device: Device | None) -> Device:
    if device is None:
        raise TypeError("this spray is computed on a device, and none is given")
    return device
