"""Size distributions from a scene's YAML to its maps, as a user writes them.

Rationale: light comes from gas, droplets and walls alone, so that an apparent temperature outside
theirs would be energy from nowhere.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pytest import approx
from scipy.special import gamma

import cldit
from cldit.gpu.device import Device
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.run import Run
from cldit.scene import load_scene
from cldit.scene.spray import ConeSpray
from cldit.spray.sizes import mean_diameter_m

SCENE = """
name: small
spray:
  model: cone
  spacing_m: 2.0e-3
  size_classes: 4
  droplets: {droplets}
domain: {{centre_m: [0.0, 0.0, -0.05], leaf_edge_m: 6.0e-3}}
camera: {{pixels: [16, 16]}}
background: {{radius_m: 0.08, temperatures_K: [413.0, 473.0, 533.0]}}
walls: {{temperature_K: 450.0}}
transport: {{phase: mie}}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scenes")


def run_of(text: str, folder: Path, device: Device) -> Run:
    (folder / "scene.yaml").write_text(text)
    return cldit.simulate(load_scene(folder / "scene.yaml"), device=device, cache=folder / "cache")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("droplets", "sauter_um"),
    [
        ("{m_um: 1.5, n: 1.0, p: 3.0}", 9.0),  # m (p + 3)
        ("{d_um: 10.0, q: 3.0}", 10.0 / gamma(1 - 1 / 3)),  # d / gamma(1 - 1 / q)
        # 15 and 5 a um: sums of (b^4 - a^4) / 4 over those of (b^3 - a^3) / 3
        (
            "{edges_um: [4.0, 8.0, 12.0], number: [60.0, 20.0]}",
            (15 * 960 + 5 * 4160) / ((15 * 448 + 5 * 1216) / 3),
        ),
    ],
)
def test_every_distribution_of_sizes(
    droplets: str, sauter_um: float, folder: Path, device: Device
) -> None:
    run = run_of(SCENE.format(droplets=droplets), folder, device)
    assert isinstance(run.scene.spray, ConeSpray) and run.scene.spray.droplets is not None
    assert mean_diameter_m(run.scene.spray.droplets, 3, 2) * 1e6 == approx(sauter_um, rel=1e-8)
    emissivity, kelvin = run.maps.emissivity, run.maps.apparent_temperature_K
    spray = np.nan_to_num(emissivity) > VISIBLE_EMISSIVITY
    assert spray.sum() > 10 and np.nanmax(emissivity) < 1.0 + 1e-3
    # The coldest droplet boils below the gas's 570 K; 1 K: the trace is solved to about 0.1 K.
    assert np.all(kelvin[spray] > run.info.spray["wet_bulb_K"] - 1.0)
    assert np.all(kelvin[spray] < 570.0 + 1.0)
    closure = run.info.closure
    assert closure is not None and closure.largest < closure.bound
    # Forward: 0.8 to 0.9, as droplets several wavelengths wide scatter (van de Hulst, 12).
    g = float(run.info.phase.partition(", g ")[2].split()[0])
    assert run.info.phase.startswith("mie") and 0.8 < g < 0.9
