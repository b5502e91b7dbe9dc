"""A scene's optical tables: made once, then read; the phase function that a preset means; files
that users bring, from a scene in YAML to the properties that are traced."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.errors import OpticsError, SceneError
from cldit.optics import mie
from cldit.prepare.medium import properties_of
from cldit.scene import Scene, load_scene, parse_scene
from cldit.show.report.optics_summary import scene_optics
from cldit.spray.result import Cells, Parcels, Prescribed, Spray, Vapour

MOLE = 6.02214076e23
CELLS = Cells.regular(origin_m=np.full(3, -0.05), spacing_m=np.full(3, 0.0125), shape=(8, 8, 8))


def scene_of(**parts: Any) -> Scene:
    return parse_scene(
        {"name": "block", "spray": {"model": "none"}, "optics": {"preset": "spectral"}, **parts}
    )


def spray_of(*, kelvin: float = 350.0, diameter_m: float | None = None) -> Spray:
    """A cube of droplets, 4 to 20 um or all alike, in their vapour."""
    count = len(CELLS.lower_m)
    diameter = np.linspace(4e-6, 20e-6, count)
    if diameter_m is not None:
        diameter[:] = diameter_m
    return Spray(
        parcels=Parcels(
            position_m=(CELLS.lower_m + CELLS.upper_m) / 2,
            diameter_m=diameter,
            droplets=0.05 * 0.0125**2 / diameter**2,
            temperature_K=np.full(count, kelvin),
            density_kg_m3=np.full(count, 600.0),
        ),
        vapour=Vapour(
            cells=CELLS,
            number_density_m3=np.full(count, 0.3 * MOLE),
            temperature_K=np.full(count, kelvin),
            molar_mass_kg_mol=0.1002,
        ),
    )


@pytest.mark.slow
def test_the_second_use_solves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = scene_of(optics={"preset": "spectral", "wavelengths": 2, "spectral_error_K": 5.0})
    spray = spray_of()
    first = properties_of(scene, spray, cache=tmp_path)
    files = sorted(tmp_path.iterdir())
    assert {file.name.split("-")[0] for file in files} == {"mie", "scattering", "wavelengths"}
    for name in ("efficiencies", "coefficients", "intensity"):
        monkeypatch.setattr(mie, name, lambda *_, **__: pytest.fail("solved again"))
    second = properties_of(scene, spray, cache=tmp_path)
    assert sorted(tmp_path.iterdir()) == files
    assert second.chosen.quadrature == first.chosen.quadrature
    assert second.chosen.errors_K == first.chosen.errors_K and second.phase == first.phase
    for one, two in zip(first.sources, second.sources, strict=True):
        assert one[0] is not None and two[0] is not None
        np.testing.assert_array_equal(one[0].scattering_m2, two[0].scattering_m2)
        np.testing.assert_array_equal(one[1][0].vapour_emission, two[1][0].vapour_emission)
    for before, after in zip(first.phases, second.phases, strict=True):
        assert before is not None and after is not None
        np.testing.assert_array_equal(before.cumulative, after.cumulative)
    monkeypatch.undo()
    # What the choice depends on: another spray, filter or wall makes it anew.
    for other, changed in (
        (spray_of(kelvin=351.0), scene),
        (spray, scene_of(walls={"temperature_K": 500.0}, optics=scene.optics.model_dump())),
    ):
        known = len(list(tmp_path.glob("wavelengths-*")))
        properties_of(changed, other, cache=tmp_path)
        assert len(list(tmp_path.glob("wavelengths-*"))) == known + 1


def test_coefficients_have_no_phase_function_and_say_so() -> None:
    count = len(CELLS.lower_m)
    zero, kelvin = np.zeros(count), np.full(count, 350.0)
    given = Prescribed(
        cells=CELLS,
        vapour_absorption_per_m=zero,
        droplet_absorption_per_m=zero,
        droplet_scattering_per_m=zero + 5.0,
        vapour_temperature_K=kelvin,
        droplet_temperature_K=kelvin,
    )
    found = properties_of(scene_of(), Spray(prescribed=given), cache=None)
    assert found.phases == (None,) and found.phase == "isotropic (no diameters)"
    assert "of Henyey" in found.remarks[0]


def test_every_wavelength_has_its_own_phase_function(tmp_path: Path) -> None:
    """All droplets of 9 um: g at each node is that of Mie's solution there.

    1e-3: tables of efficiencies, and 1024 bins of the angle.
    """
    scene = scene_of(optics={"preset": "spectral", "wavelengths": 2})
    found = properties_of(scene, spray_of(diameter_m=9e-6), cache=tmp_path)
    for band, phase in zip(found.chosen.bands, found.phases, strict=True):
        assert band.droplets is not None and phase is not None
        (table,) = band.droplets.tables
        x = np.pi * 9e-6 / (table.wavelength_um * 1e-6)
        g = mie.efficiencies(n=table.n, k=table.k, x=x).asymmetry[0]
        assert phase.asymmetry == pytest.approx(float(g), abs=1e-3)


NK = """REFERENCES: mine
DATA:
  - type: tabulated nk
    data: |
        3.2 1.35 0.02
        3.6 1.35 0.02
CONDITIONS: {temperature: 298.0}
"""


def xsc(value_cm2: float) -> str:
    """HITRAN's form, the same absorption from 2700 to 3200 1/cm."""
    head = (
        f"{'MINE':>20}{2700.0:10.4f}{3200.0:10.4f}{20:7d}{350.0:7.1f}{760.0:6.1f}{value_cm2:10.3E}"
    )
    return head + "\n" + 2 * (10 * f"{value_cm2:10.3E}" + "\n")


@pytest.mark.slow
def test_tables_of_the_user_from_a_scene(tmp_path: Path) -> None:
    """A refractiveindex.info file and a HITRAN file, named in YAML beside it: what each wavelength
    gets is what they say. 6.022e19 m2/mol are 1 cm2 a molecule."""
    (tmp_path / "liquid.yml").write_text(NK)
    (tmp_path / "gas.xsc").write_text(xsc(2e-19))
    (tmp_path / "mine.yaml").write_text(
        "name: mine\nspray: {model: none}\n"
        "optics: {preset: spectral, liquid: liquid.yml, vapour: gas.xsc}\n"
    )
    scene = load_scene(tmp_path / "mine.yaml")
    found = properties_of(scene, spray_of(), cache=tmp_path / "cache")
    assert found.chosen.errors_K[0] < 0.1 and len(found.chosen.bands) == 1
    (band,) = found.chosen.bands
    assert band.droplets is not None
    (table,) = band.droplets.tables
    assert (table.n, table.k) == pytest.approx((1.35, 0.02), rel=1e-9)
    assert float(band.vapour_m2_mol(np.array([350.0]))[0]) == pytest.approx(12.044, rel=1e-3)
    shown = scene_optics(scene, cache=tmp_path / "cache")
    assert shown.liquid is not None and shown.liquid.source == "mine"
    assert [vapour.species for vapour in shown.vapours] == ["MINE"]
    # A file that changes is another table, though its name stays.
    (tmp_path / "gas.xsc").write_text(xsc(4e-19))
    (again,) = properties_of(scene, spray_of(), cache=tmp_path / "cache").chosen.bands
    assert float(again.vapour_m2_mol(np.array([350.0]))[0]) == pytest.approx(24.089, rel=1e-3)


@pytest.mark.parametrize(
    ("optics", "message"),
    [
        ({"filter_um": [4.2, 4.4]}, "is outside"),
        ({"liquid": "water"}, "no refractive index is shipped"),
        ({"vapour": "steam"}, "no vapour absorption is shipped"),
    ],
)
def test_what_the_data_do_not_cover_is_refused(optics: dict[str, Any], message: str) -> None:
    scene = scene_of(optics={"preset": "spectral", **optics})
    with pytest.raises(OpticsError, match=message):
        properties_of(scene, spray_of(), cache=None)


@pytest.mark.parametrize("key", ["liquid", "vapour"])
def test_a_table_that_is_not_there_is_refused_when_the_scene_is_read(
    key: str, tmp_path: Path
) -> None:
    data = {"name": "mine", "spray": {"model": "none"}, "optics": {key: "mine/nowhere.csv"}}
    message = rf"optics\.{key}: .*{tmp_path.name}/mine/nowhere\.csv: no such file; allowed: "
    with pytest.raises(SceneError, match=message):
        parse_scene(data, folder=tmp_path)
    # A run that is done can be read without it.
    scene = parse_scene(data, folder=tmp_path, finished=True)
    assert getattr(scene.optics, key) == str(tmp_path / "mine" / "nowhere.csv")
