"""Error of the cells of an octree, against finer cells.

    python -m tests.bench cell_error gdi-cone --halvings 7
    python -m tests.bench cell_error droplets-only --halvings 6 --pixels 64

The cells have an edge h; the references have h / 2, h / 4, and so on.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

from cldit.accuracy.allocation import Allocation
from cldit.accuracy.image_pair import ImageDifference, ImagePair
from cldit.accuracy.problem import Problem
from cldit.accuracy.resolution import Resolution
from cldit.accuracy.variant_tracer import VariantTracer
from cldit.bench.case import changed, clocked
from cldit.gpu.device import open_device
from cldit.io.caches import default_cache
from cldit.medium.octree import Octree
from cldit.medium.resolution import on_grid
from cldit.prepare.stages import Stages
from cldit.scene import load_scene
from cldit.transport.trace import trace


def tracer_of(name: str, pixels: int, accuracy_K: float) -> VariantTracer:
    """The tracer of a scene's coarse images."""
    scene = changed(
        load_scene(name),
        camera={"pixels": [pixels] * 2},
        transport={"accuracy_K": accuracy_K},
        optics={"compare_paper": False},
    )
    problem = Problem(scene, open_device(), Stages(None), default_cache(), None)
    asked_K = Allocation.of(scene, accuracy_K)["trace"]
    first = Resolution.first(scene, ordinates_K=asked_K, spectral_K=scene.optics.bound_K)
    return problem.tracer(first)[1]


def tree_at(tracer: VariantTracer, depth: int) -> Octree:
    """The medium on cells of a cube that is halved `depth` times, a cone on the first lattice."""
    frame = tracer.prepared.cube.at(depth)
    if tracer.prepared.on_lattice:
        frame = on_grid(frame, tracer.prepared.sources, voxel_m=frame.cell_m) or frame
    return tracer.prepared.octrees(frame, [tracer.prepared.sources])[0]


def main() -> None:
    """A row for each image, with its difference from the reference."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("--pixels", type=int, default=40)
    parser.add_argument("--halvings", type=int, required=True, help="of the cube, for h")
    parser.add_argument("--finer", type=int, default=2, help="halvings of h for the reference")
    parser.add_argument("--accuracy", type=float, default=0.5, help="of ordinates and paths, K")
    given = parser.parse_args()
    tracer = tracer_of(given.scene, given.pixels, given.accuracy)
    settings = replace(tracer.settings, rays_K=None, subpixels=False)

    def image(depth: int) -> ImagePair:
        tree = tree_at(tracer, depth)
        made, cost = clocked(
            tracer.device, lambda: trace(tree, tracer.scene, tracer.device, settings)
        )
        seconds = ", ".join(f"{name} {value:.2f}" for name, value in made.seconds.items())
        print(f"h {1e3 * tree.frame.cell_m:.3g} mm: {cost.core_s:.1f} core-s ({seconds})")
        return ImagePair.of(made)

    def row(name: str, one: ImagePair, other: ImagePair) -> None:
        warm, emissivity = ImageDifference.between(tracer.temperature, one, other)
        known = warm.map_K[warm.map_K == warm.map_K]
        per_K = tracer.temperature.per_emissivity_K
        print(
            f"{name:44s} T_app {warm.error_K or 0.0:.3f} K, largest {known.max(initial=0.0):.2f}; "
            f"emissivity {(emissivity.error_K or 0.0) / per_K:.4f}",
            flush=True,
        )

    start = image(given.halvings)
    for up in range(1, given.finer + 1):
        row(f"error of h, against h / {2**up}", start, image(given.halvings + up))


if __name__ == "__main__":
    main()
