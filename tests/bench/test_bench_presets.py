"""Why presets differ: nothing taken is the paper's run, whichever way its properties come in."""

from __future__ import annotations

from pathlib import Path

from cldit.accuracy.spectral import Difference
from cldit.bench.presets import CAUSES, LIQUID, PHASE, STEPS, variant
from cldit.gpu.device import Device
from cldit.run import simulate
from cldit.scene import Scene, load_scene, parse_scene


def small() -> Scene:
    data = load_scene("gdi").model_dump(mode="json")
    data["spray"].update(spacing_m=2e-3, size_classes=4)
    data["domain"]["leaf_edge_m"] = 6e-3
    return parse_scene(data)


def test_files_of_the_papers_properties_are_the_paper(
    device: Device, tmp_path: Path, tables: Path
) -> None:
    """Preset `spectral` with grey files takes one wavelength and gives the paper's maps.

    The paper's table of droplets is taken at the filter's mean wavelength, as the node's is; what
    is left, 5e-4 K, are the four digits of the .xsc file.
    """
    (tmp_path / "files").mkdir()
    asked = {"pixels": 16, "accuracy_K": 0.5}
    spectral = variant(small(), (PHASE,), tmp_path / "files", **asked)  # type: ignore[arg-type]
    data = variant(small(), (), tmp_path / "files", **asked).model_dump()  # type: ignore[arg-type]
    data["transport"]["phase"] = "mie"
    data["transport"]["audit"] = False  # else either run chooses cells of its own
    spectral = spectral.with_(**{"transport.audit": False})
    files = simulate(spectral, device=device, cache=tables)
    (node,) = files.quadrature.nodes
    data["optics"]["wavelength_um"] = node.wavelength_um
    runs = [simulate(parse_scene(data), device=device, cache=tables), files]
    assert [run.scene.optics.preset for run in runs] == ["paper", "spectral"]
    difference = Difference.of(runs[1].maps, runs[0].maps)
    assert difference is not None and difference.pixels > 10
    assert difference.rms_K < 5e-3 and abs(difference.mean_emissivity) < 1e-4


def test_all_causes_together_are_the_preset(device: Device, tmp_path: Path) -> None:
    """What nobody switched off is the shipped data: no file takes its place."""
    assert STEPS[-1] == CAUSES and len(set(STEPS)) == 7
    scene = variant(small(), CAUSES, tmp_path, pixels=16, accuracy_K=0.5)
    assert scene.optics.liquid is None and scene.optics.vapour is None
    assert scene.optics.preset == "spectral" and scene.transport.phase == "mie"
    other = variant(small(), (LIQUID,), tmp_path, pixels=16, accuracy_K=0.5)
    assert other.optics.liquid is None and other.optics.vapour is not None
    assert other.transport.phase == "isotropic"
