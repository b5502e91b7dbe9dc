"""Scenes on coarser cells."""

from cldit.scene.schema import Scene
from cldit.scene.spray import ConeSpray, LagrangianSpray


def coarsened(scene: Scene, factor: float) -> Scene:
    """The scene with octree, gas cells and lattice `factor` times as wide."""
    if factor == 1.0:
        return scene
    widths = {"domain.leaf_edge_m": scene.domain.leaf_edge_m}
    if isinstance(scene.spray, LagrangianSpray):
        widths["spray.box.spacing_m"] = scene.spray.box.cell_m
    elif isinstance(scene.spray, ConeSpray):
        widths["spray.spacing_m"] = scene.spray.lattice_m
    return scene.with_(
        **{key: factor * width for key, width in widths.items() if width is not None}
    )
