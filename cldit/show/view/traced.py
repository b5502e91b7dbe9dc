"""Data of a run for the page, from which it computes maps for any temperatures.

The page evaluates the trace as `cldit.run.reevaluated` does. For every pixel that the spray
changes, it gets the changes of the weights of background, walls and patches against those without
spray, and the emission of vapour and droplets; for all others only an index into the few different
pixels without spray. Differences keep their own precision where the spray is thin.

Of several wavelengths, only sums with the radiances of a few temperatures are needed. These span
fewer directions than there are wavelengths, so the weights are projected on them (`_directions`),
with a loss of 1e-7.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.accuracy.error_maps import TOTAL
from cldit.arrays import Floats
from cldit.camera.sensor import SensorModel
from cldit.optics.windows import Pane, band_panes
from cldit.radiance.boundary import Boundary, Surroundings
from cldit.run import Run
from cldit.run.content import trace_content
from cldit.scene import Scene
from cldit.scene.delays import spray_time_s
from cldit.show.figures.maps import frame_of, spray_window
from cldit.show.view.item import Item, place_of, planck_ends, planck_tables
from cldit.show.view.packing import ERROR_BITS, MANTISSA_BITS, rounded

# Change of a weight, emission in backgrounds, or share of the light that a projection may lose:
# a twentieth of the 2e-6 by which weights are rounded.
_NEGLIGIBLE = 1e-7
_PANES_K = np.geomspace(100.0, 5000.0, 64)  # temperatures of light for means of windows
_SHARE_KNOTS_K = np.geomspace(50.0, 5000.0, 256)  # those of `Quadrature.shares`


def traced_item(run: Run, *, source: str) -> Item:
    """Item of a run for the page; `source` names its scene in commands.

    Args:
        run: a run.
        source: name of its scene in commands.

    Returns:
        Item for `save_page`.
    """
    scene = run.scene
    stack = _Stack(run)
    x, _, z = scene.target_m
    nodes = run.quadrature.nodes
    head: dict[str, Any] = {
        "kind": "run",
        "name": scene.name,
        "about": scene.description,
        "source": source,
        "time_s": spray_time_s(scene),
        **place_of(run.reference.background.shape, run.pixel_m, (x, z)),
        "window_mm": spray_window(run.maps, frame_of(run.scene)),
        "ends": planck_ends(run.quadrature.filter_um),
        "scene": _scene_data(scene),
        "sensor": _sensor_data(scene),
        "panes": {
            "nodes": [
                {window.side: _plain(node.pane(window)) for window in scene.windows}
                for node in nodes
            ],
            "reference_K": run.quadrature.reference_K,
            "ends": [float(np.log(_PANES_K[0])), float(np.log(_PANES_K[-1]))],
        },
        "nodes": len(nodes),
        "share_ends": [float(np.log(_SHARE_KNOTS_K[0])), float(np.log(_SHARE_KNOTS_K[-1]))],
        "components": stack.components,
        "locked": _locked(scene, len(nodes)),
        "stated_error_K": None if run.errors is None else run.errors.total_K,
        "stated_error": "" if run.errors is None else run.errors.text,
        "stated_error_emissivity": None if run.errors is None else run.errors.total_emissivity,
    }
    arrays = {**planck_tables(run.quadrature.filter_um), **stack.arrays}
    if len(nodes) > 1:
        spline = run.quadrature.shares
        at = np.log(_SHARE_KNOTS_K)
        arrays["shares"] = np.stack([spline(at).T, spline(at, 1).T])  # (2, nodes, knots)
    for window in scene.windows:
        means = band_panes(window, run.quadrature.filter_um, reference_K=_PANES_K)
        arrays[f"pane_{window.side}"] = np.array([_plain(pane) for pane in means]).T
    for prefix, maps in (("", run.error_maps), ("emissivity_", run.emissivity_error_maps)):
        if TOTAL in maps:
            total = rounded(maps[TOTAL][stack.covered], ERROR_BITS)
            arrays[f"{prefix}simulation_error"] = total
    return Item(head, arrays)


def _scene_data(scene: Scene) -> dict[str, Any]:
    """Values of a scene that the page may change, or that its equation needs."""
    return {
        "backgrounds_K": list(scene.background.temperatures_K),
        "emissivity": scene.background.emissivity,
        "around_K": scene.background.surroundings_K,
        "wall_K": scene.walls.temperature_K,
        "camera_K": scene.camera.surroundings_K,
        "patches": [
            {"name": patch.name, "K": patch.temperature_K, "emissivity": patch.emissivity}
            for patch in scene.patches
        ],
        "windows_K": {window.side: window.temperature_K for window in scene.windows},
        "shots": scene.plan.shots,
        "references": scene.plan.references,
        "read_noise_electrons": scene.camera.sensor.read_noise_electrons,
    }


def _sensor_data(scene: Scene) -> dict[str, Any]:
    sensor = SensorModel.from_scene(scene)
    return {
        "electrons_per_radiance_s": sensor.electrons_per_radiance / sensor.integration_time_s,
        "integration_time_s": sensor.integration_time_s,
        "fixed_time": scene.camera.sensor.integration_time_s is not None,
        "offset_counts": sensor.offset_counts,
        "saturation_counts": sensor.saturation_counts,
        "electrons_per_count": sensor.electrons_per_count,
    }


def _plain(pane: Pane) -> list[float]:
    return [pane.transmission, pane.reflection]


def _locked(scene: Scene, nodes: int) -> dict[str, str]:
    """Reasons why temperatures of this run cannot be changed, by their source."""
    if nodes == 1 and _served(scene):
        return {}
    cause = "wavelengths were chosen" if scene.optics.preset == "spectral" else "rays were spent"
    explanation = f"{cause} for this run's temperatures; trace it again with others"
    return {"background": explanation, "wall": explanation}


def _served(scene: Scene) -> bool:
    """True if the trace is valid for other temperatures."""
    walls = scene.walls.model_copy(update={"temperature_K": scene.walls.temperature_K / 2 + 1.0})
    return trace_content(scene) == trace_content(scene.model_copy(update={"walls": walls}))


class _Stack:
    """Weights of a run in the pixels that the spray changes, minus those without spray.

    covered: (H, W). arrays: `covered` and `palette_index` (H, W), `palette` (P, 3 + patches), and
    for the covered pixels (N,): `emitted`, and one for each of the `components`, which name the
    source and the direction over the nodes.
    """

    def __init__(self, run: Run) -> None:
        scene, nodes = run.scene, run.quadrature.nodes
        surroundings = Surroundings.from_scene(scene)
        in_filter = Boundary.in_filter(
            surroundings, run.quadrature.filter_um, reference_K=run.quadrature.reference_K
        )
        bands = [Boundary.of(surroundings, node.radiance, node.pane) for node in nodes]
        # Transmission of the front window in each node, over the filter's mean; a single node
        # represents the filter, whatever its own pane.
        passes = [1.0] if len(nodes) == 1 else [
            band.front.transmission / in_filter.front.transmission for band in bands
        ]  # fmt: skip
        parts = [weights.images for weights in run.spectral]
        bare = {name: image.astype(np.float64) for name, image in run.reference.images.items()}
        names = ["background", "wall", *(patch.name for patch in scene.patches)]
        emitted = sum(
            f * (images["vapour"].astype(np.float64) + images["liquid"]) - f * (
                bare["vapour"] + bare["liquid"]
            )
            for f, images in zip(passes, parts, strict=True)
        )  # fmt: skip
        dimmest = float(min(in_filter.leaving(list(scene.background.temperatures_K))))
        covered = np.abs(emitted) > _NEGLIGIBLE * dimmest
        for name in names:
            for images in parts:
                covered = covered | (np.abs(images[name] - bare[name]) > _NEGLIGIBLE)
        self.covered = np.asarray(covered)
        self.components: list[dict[str, Any]] = []
        self.arrays: dict[str, NDArray[Any]] = {
            "covered": self.covered.astype(np.uint8),
            "emitted": rounded(np.asarray(emitted)[covered], MANTISSA_BITS),
        }
        self._palette(bare, names, float(sum(passes)))
        lights = _lights(scene, bands, passes)
        for name in names:
            change = np.stack([images[name][covered] - bare[name][covered] for images in parts])
            directions, sizes = _directions(lights[name])
            for number, (mix, size) in enumerate(zip(directions.T, sizes, strict=True)):
                spared = int(np.log2(sizes[0] / size))
                key = f"weight_{name}_{number}"
                bits = max(MANTISSA_BITS - spared, 4)
                self.arrays[key] = rounded(mix @ change, bits)
                self.components.append({"source": name, "mix": mix.tolist(), "array": key})

    def _palette(self, bare: dict[str, Floats], names: Sequence[str], passes: float) -> None:
        """Stores the few different pixels without spray, and the emission there."""
        columns = [bare[name] for name in names]
        columns.append(passes * (bare["vapour"] + bare["liquid"]))
        code = np.zeros(columns[0].size, np.int64)
        for column in columns:
            values, index = np.unique(column, return_inverse=True)
            _, code = np.unique(code * len(values) + index.reshape(-1), return_inverse=True)
        _, places = np.unique(code, return_index=True)
        kind = np.uint8 if len(places) < 256 else np.uint16 if len(places) < 65536 else np.float32
        self.arrays["palette_index"] = code.astype(kind)  # float32 counts exactly to 2^24
        self.arrays["palette"] = np.stack(
            [column.reshape(-1)[places] for column in columns], axis=1
        )


def _lights(scene: Scene, bands: Sequence[Boundary], passes: Sequence[float]) -> dict[str, Floats]:
    """Light (nodes, N) of each source in every node, for all requests of the page.

    Several nodes are valid for the run's own temperatures only (`_locked`), and any emissivity.
    """
    f = np.asarray(passes)
    rear = np.array([band.rear.transmission for band in bands])
    at_K = np.array(scene.background.temperatures_K)
    backgrounds = np.stack([band.radiance(at_K) for band in bands]) * (f * rear)[:, None]
    surroundings = f * rear * np.array([band.surroundings for band in bands])
    added = f * np.array([band.rear_added for band in bands])
    lights = {
        "background": np.column_stack([backgrounds, surroundings, added]),
        "wall": (f * np.array([band.wall for band in bands]))[:, None],
    }
    for patch in scene.patches:
        lights[patch.name] = (f * np.array([band.patches[patch.name] for band in bands]))[:, None]
    return lights


def _directions(light: Floats) -> tuple[Floats, Floats]:
    """Directions (nodes, r) with the light (nodes, N) but `_NEGLIGIBLE`, and its sizes (r,)."""
    if len(light) == 1:
        return np.ones((1, 1)), np.ones(1)
    norms = np.linalg.norm(light, axis=0)
    unit = light[:, norms > 0] / norms[norms > 0]
    u, sizes, _ = np.linalg.svd(unit, full_matrices=False)
    for r in range(1, len(sizes) + 1):
        residual = unit - u[:, :r] @ (u[:, :r].T @ unit)
        if np.max(np.linalg.norm(residual, axis=0)) < _NEGLIGIBLE:
            break
    return u[:, :r], sizes[:r]
