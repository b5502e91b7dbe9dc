"""The medium of a stored run, made again from its scene and checked against the run's record.

A run folder contains weights, not cells, which are as large as memory and rarely asked for. Scene
and resolution (`plan` of run.json) determine the cells. They are compared with the record of the
run: checksums of its files, figures of its spray, nodes, leaves, and integrals of absorption and
scattering.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from cldit.accuracy.node_traces import node_settings
from cldit.accuracy.resolution import Resolution
from cldit.errors import RunFolderError
from cldit.gpu.device import Device
from cldit.medium.octree import Octree
from cldit.prepare.medium import prepare
from cldit.prepare.spray_factory import make_spray
from cldit.prepare.stages import Say, Stages
from cldit.run.result import Run
from cldit.run.spectral import SpectralInfo
from cldit.scene import Scene
from cldit.spray.result import Spray
from cldit.transport.trace import TraceSettings

# Of sums over fields in float32, whose values each machine rounds to 6e-8: 160 roundings.
_ALIKE = 1e-5


@dataclass(frozen=True)
class Rebuilt:
    """The medium of one node.

    scene: of the run. number: of the node. tree: its octree; settings: of its trace. spray: before
    its parcels are deposited. remarks: on what could not be checked.
    """

    scene: Scene
    number: int
    tree: Octree
    settings: TraceSettings
    spray: Spray
    remarks: tuple[str, ...]


def rebuilt(
    run: Run, device: Device, cache: Path, *, node: int | None = None, say: Say | None = None
) -> Rebuilt:
    """The medium of a run at one of its nodes.

    node: number of the node; None: the one with most of the light.
    """
    number = _node(run, node)
    if run.info.plan is None:
        raise RunFolderError(f"{_name(run)}: run.json holds no plan; run the scene again")
    try:
        resolution = Resolution.from_dict(run.info.plan)
    except KeyError as error:
        raise RunFolderError(f"{_name(run)}: run.json: plan is damaged ({error})") from error
    scene = run.scene.with_(**{"optics.compare_paper": False})
    _check_files(run)
    stages = Stages(say)
    spec = resolution.spray(scene)
    spray = make_spray(spec or scene.spray, device, cache=cache)
    _check_figures(run, "spray", run.info.spray, spray.notes)
    prepared = prepare(
        scene,
        device,
        stages,
        cache,
        spray,
        spec=spec,
        cube_m=resolution.cube_m,
        spectral_K=resolution.spectral_K,
    )
    medium = prepared.grown(None if resolution.cube_m is not None else resolution.depth)
    quadrature = medium.properties.chosen.quadrature
    nodes = SpectralInfo.of(quadrature, (), None).nodes
    for number_, (stored, remade) in enumerate(zip(_nodes(run), nodes, strict=False)):
        pairs = [{"wavelength_um": um, "share": share} for um, share in (stored, remade)]
        _check_figures(run, f"node {number_}", pairs[0], pairs[1])
    if len(_nodes(run)) != len(nodes):
        raise _not_reproduced(run, "nodes", len(_nodes(run)), len(nodes))
    remarks = tuple(_check_octree(run, medium.integrals, stages))
    settings = node_settings(
        scene,
        quadrature,
        medium.properties.phases,
        tolerance_K=resolution.ordinates_K,
        more_ordinates=resolution.more_ordinates,
    )[number]
    precision: Literal["float32", "float64"] = (
        "float64" if run.info.precision == "float64" else "float32"
    )
    return Rebuilt(
        scene=scene,
        number=number,
        tree=medium.trees[number],
        settings=replace(settings, precision=precision),
        spray=spray,
        remarks=remarks,
    )


def _name(run: Run) -> str:
    return run.scene.name if run.folder is None else str(run.folder)


def _nodes(run: Run) -> tuple[tuple[float, float], ...]:
    return () if run.info.spectral is None else run.info.spectral.nodes


def _node(run: Run, node: int | None) -> int:
    nodes = _nodes(run)
    if not nodes:
        raise RunFolderError(f"{_name(run)}: run.json names no wavelengths; run the scene again")
    if node is None:
        return max(range(len(nodes)), key=lambda number: nodes[number][1])
    if not 0 <= node < len(nodes):
        raise RunFolderError(f"{_name(run)}: has no node {node}; allowed: 0..{len(nodes) - 1}")
    return node


def _check_files(run: Run) -> None:
    """Raises RunFolderError if a file of the spray has changed."""
    for read in run.info.files:
        if change := read.change:
            raise RunFolderError(
                f"{_name(run)}: its spray was read from {read.path}, which {change}; restore it, "
                "or run the scene again"
            )


def _check_figures(
    run: Run, quantity: str, stored: Mapping[str, float], remade: Mapping[str, float]
) -> None:
    for name, value in stored.items():
        remade_value = remade.get(name, math.nan)
        if not math.isclose(remade_value, value, rel_tol=_ALIKE):
            raise _not_reproduced(run, f"{quantity}: {name}", value, remade_value)


def _not_reproduced(run: Run, quantity: str, stored: object, remade: object) -> RunFolderError:
    return RunFolderError(
        f"{_name(run)}: cannot be made again as it was ({quantity}: {stored} in run.json, now "
        f"{remade}): it was run by another version of cldit, or from a spray that was given in "
        "Python; run the scene again, and export that run"
    )


def _check_octree(
    run: Run, integrals: tuple[Mapping[str, float], ...], stages: Stages
) -> Iterator[str]:
    """Checks the octrees; yields remarks on what could not be checked."""
    stored, remade = (
        [stage.note for stage in done if stage.name == "octree"]
        for done in (run.info.stages, stages.done)
    )
    if stored and stored[-1] != remade[-1]:
        raise _not_reproduced(run, "octree", stored[-1], remade[-1])
    if not run.info.integrals:
        yield "the run was made before integrals of its medium were kept: they are not checked"
    for number, (stored_m2, remade_m2) in enumerate(
        zip(run.info.integrals, integrals, strict=False)
    ):
        _check_figures(run, f"octree of node {number}", stored_m2, remade_m2)
