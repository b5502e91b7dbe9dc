"""OpenFOAM cases written by the test, in every form: the spray is what was written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import notes_of, read, refused

NOZZLE = (0.5e-3, 9e-3, 0.1e-3)
AVOGADRO_MOL = 6.02214076e23
HEPTANE_KG_MOL = 0.100204
FORMS: dict[str, dict[str, Any]] = {
    "ascii": {},
    "ascii-gz": {"gz": True},
    "binary": {"binary": True},
    "binary-gz": {"binary": True, "gz": True},
    "binary-label64": {"binary": True, "label": 64},
    "binary-scalar32": {"binary": True, "scalar": 32},
}


@pytest.mark.parametrize("barycentric", ["", "positions", "coordinates"])
@pytest.mark.parametrize(
    ("form", "shear"), [(form, (0.0, 0.3)[number % 2]) for number, form in enumerate(FORMS)]
)
def test_every_form_gives_what_was_written(
    tmp_path: Path, form: str, barycentric: str, shear: float
) -> None:
    block, gas, cloud = foam.sample(shear)
    foam.case(tmp_path, shear=shear, barycentric=barycentric, form=foam.form(**FORMS[form]))
    (tmp_path / "case.foam").touch()
    spray = read(tmp_path / "case.foam")

    # numbers are kept to the last bit but for float32 files: half an ulp, and 3e-9 m on 1e-2 m
    tolerance = 1e-6 if "32" in form else 1e-12
    assert spray.parcels is not None
    assert spray.vapour is not None
    for name, key in (
        ("diameter_m", "d"),
        ("droplets", "nParticle"),
        ("temperature_K", "T"),
        ("density_kg_m3", "rho"),
    ):
        assert getattr(spray.parcels, name) == pytest.approx(cloud[key], rel=tolerance)
    x, y, z = (cloud["position"] - NOZZLE).T
    turned = np.stack([x, -z, y], axis=1)  # -y becomes -z by a turn about x
    assert spray.parcels.position_m == pytest.approx(turned, abs=1e-2 * tolerance, rel=0)

    assert spray.vapour.temperature_K == pytest.approx(gas["T"], rel=tolerance)
    number = gas["rho"] * gas["C7H16"] * AVOGADRO_MOL / HEPTANE_KG_MOL
    assert spray.vapour.number_density_m3 == pytest.approx(number, rel=tolerance)
    # a cell of 1e-3 m between float32 coordinates of 1e-2 m: 1e-9 / 1e-3 an edge
    loose = 5e-6 if "32" in form else 1e-11
    assert spray.vapour.cells.volume_m3 == pytest.approx(block.volume, rel=loose)
    middle = (spray.vapour.cells.lower_m + spray.vapour.cells.upper_m) / 2
    x, y, z = (block.centre - NOZZLE).T
    assert middle == pytest.approx(np.stack([x, -z, y], axis=1), abs=1e-2 * loose, rel=0)

    mass = float(np.sum(gas["rho"] * gas["C7H16"] * block.volume))
    liquid = float(np.sum(cloud["nParticle"] * cloud["rho"] * np.pi / 6 * cloud["d"] ** 3))
    assert spray.notes["vapour_mass_kg"] == pytest.approx(mass, rel=loose)
    assert spray.notes["liquid_mass_kg"] == pytest.approx(liquid, rel=loose)
    assert spray.notes["parcels"] == 17
    assert spray.notes["time_s"] == 0.001
    assert not spray.remarks  # nozzle and axis were given


@pytest.mark.parametrize("barycentric", ["", "coordinates"])
def test_decomposed(tmp_path: Path, barycentric: str) -> None:
    block, gas, cloud = foam.sample()
    clouds = {2: cloud, 10: {name: values[:5] for name, values in cloud.items()}}
    places = []
    for number in range(11):  # the spray has reached two of them
        step = 0.2 * number
        shifted = foam.block((block.edges[0] + step, block.edges[1], block.edges[2]))
        own = clouds.get(number)
        if own is not None:
            own = own | {"position": own["position"] + (step, 0.0, 0.0)}
            places.append(own["position"])
        part = tmp_path / f"processor{number}"
        foam.write(part, shifted, gas=gas, cloud=own, barycentric=barycentric)
    spray = read(tmp_path)
    assert spray.parcels is not None
    wanted = np.concatenate(places) - NOZZLE
    assert spray.parcels.position_m[:, 0] == pytest.approx(wanted[:, 0], abs=1e-13, rel=0)
    single = np.sum(gas["rho"] * gas["C7H16"] * block.volume)
    assert spray.notes["vapour_mass_kg"] == pytest.approx(11 * single, rel=1e-11)
    assert spray.notes["gas_cells"] == 11 * block.cells


def test_times(tmp_path: Path) -> None:
    for time, fuel in (("0", 0.1), ("2.5e-05", 0.2), ("0.001", 0.3)):
        foam.case(tmp_path, gas={"C7H16": fuel}, cloud=False, time=time)
    (tmp_path / "0.002").mkdir()  # nothing in it that we read
    # this time only exists decomposed
    foam.case(tmp_path / "processor0", gas={"C7H16": 0.4}, cloud=False, time="0.0015")
    for wanted, fuel in ((None, 0.4), (0.001, 0.3), (2.5e-5, 0.2), (0.0, 0.1)):
        spray = read(tmp_path, time_s=wanted)
        assert spray.notes["vapour_mass_fraction_max"] == fuel


def test_mesh_that_moves(tmp_path: Path) -> None:
    block, gas, _ = foam.sample()
    foam.write(tmp_path, block, gas=gas)
    longer = foam.block((2 * block.edges[0], block.edges[1], block.edges[2]))
    body = foam.form().numbers(longer.points)
    foam.form().write(tmp_path / "0.0005" / "polyMesh" / "points", "vectorField", body)
    foam.form().write(tmp_path / "0.002" / "polyMesh" / "points", "vectorField", body[:50])
    mass = np.sum(gas["rho"] * gas["C7H16"] * longer.volume)
    assert notes_of(tmp_path)["vapour_mass_kg"] == pytest.approx(mass, rel=1e-11)


def test_density_from_pressure(tmp_path: Path) -> None:
    """2 mol of nitrogen-like gas and 1 mol of heptane in the volume that p V = N R T gives them."""
    block, _, _ = foam.sample()
    fuel = HEPTANE_KG_MOL / (HEPTANE_KG_MOL + 2 * 0.02885)
    foam.write(tmp_path, block, gas={"T": 600.0, "p": 3e6, "C7H16": fuel})
    vapour = read(tmp_path).vapour
    assert vapour is not None
    molecules = 3e6 / (1.380649e-23 * 600.0)  # per m3, p = n k T
    assert vapour.number_density_m3 == pytest.approx(molecules / 3, rel=1e-9)


def test_gas_without_fuel_and_cells_with_a_trace_are_left_out(tmp_path: Path) -> None:
    block, gas, _ = foam.sample()
    spray = read(foam.case(tmp_path / "none", gas={"C7H16": 0.0}))
    assert spray.vapour is None
    assert spray.notes["vapour_mass_kg"] == 0.0
    fraction = np.zeros(block.cells)
    fraction[3], fraction[4], fraction[5] = 0.2, 1e-150, -1e-5
    spray = read(foam.case(tmp_path / "trace", gas={"C7H16": fraction}, cloud=False))
    assert spray.vapour is not None
    assert spray.vapour.temperature_K.tolist() == [gas["T"][3]]
    assert spray.parcels is None


def test_uniform_lists_of_a_cloud(tmp_path: Path) -> None:
    foam.case(tmp_path)
    folder = tmp_path / "0.001" / "lagrangian" / "sprayCloud"
    foam.form().write(folder / "rho", "scalarField", b"17{612.5}")
    foam.form().write(folder / "U", "vectorField", b"17{(0 -3 0)}")
    spray = read(tmp_path, axis=None)
    assert spray.parcels is not None
    assert spray.parcels.density_kg_m3.tolist() == [612.5] * 17
    assert spray.notes["axis_y"] == -1.0


@pytest.mark.parametrize("shift", [0, 7])
def test_parcels_lie_in_the_cells_that_they_state(tmp_path: Path, shift: int) -> None:
    """Cells with other numbers, as of a mesh that was renumbered without its fields."""
    block, _, cloud = foam.sample()
    case = foam.case(tmp_path)
    cells = (block.barycentric(cloud["position"])[1][:, :1] + shift) % block.cells
    file = case / "0.001/lagrangian/sprayCloud/positions"
    foam.form().write(file, "Cloud", foam.form().records(cloud["position"], cells))
    if shift:
        refused(case, r"positions: 1\d of 17 parcels lie outside the cells that they state")
    else:
        assert notes_of(case)["parcels"] == 17
