"""AMReX plotfiles written by the layout of AMReX's own writers: two levels, boxes, particles."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.cfd.importing import list_case
from cldit.cfd.mapping_draft import write_mapping
from cldit.cfd.to_spray import read_cfd
from cldit.cfd.vtk.datasets import as_numpy
from cldit.errors import SprayError
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.reading import notes_of, read, refused

NAMES = ("x_velocity", "density", "temp", "RhoRT", "Y(NC7H16)")
PARTICLES = ("xvel", "yvel", "zvel", "temperature", "diam", "spray_mf_NC7H16", "number_density")
EDGE_m, LOW_m, SHAPE = 1e-3, np.array([-4e-3, -4e-3, 0.0]), (8, 8, 16)
FINE = ((4, 4, 0), (11, 11, 15))  # cells of level 1
Box = tuple[tuple[int, int, int], tuple[int, int, int]]
COARSE: tuple[Box, ...] = (((0, 0, 0), (7, 7, 7)), ((0, 0, 8), (7, 7, 15)))


def text(box: Box) -> str:
    low, high = (",".join(map(str, each)) for each in box)
    return f"(({low}) ({high}) (0,0,0))"


def gas(box: Box, edge_m: float) -> np.ndarray[Any, Any]:
    """Components (C, nz, ny, nx): a jet, linear in a cell but for rounding."""
    axes = [LOW_m[i] + (np.arange(box[0][i], box[1][i] + 1) + 0.5) * edge_m for i in range(3)]
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij")
    fuel = 0.2 * np.exp(-(x**2 + y**2) / 4e-6) * (z < 12e-3)
    temperature = 800.0 - 900.0 * fuel
    moles = fuel / 0.1002 + (1 - fuel) / 0.02885
    return np.array([x, 5e6 / (moles * 8.314463 * temperature), temperature, x * 0 + 5e6, fuel])


@dataclass
class Plot:
    """Content to write; `single`: precision of the particles; `float32`: of the gas."""

    single: bool = False
    float32: bool = False
    order: str = "<"
    ghosts: int = 0
    levels: int = 2
    time: float = 1e-3
    names: tuple[str, ...] = NAMES
    solid: bool = False
    ids: list[int] = field(default_factory=lambda: list(range(1, 41)))

    def write(self, path: Path) -> Path:
        names = (*self.names, *(("volFrac",) if self.solid else ()))
        domains = [((0, 0, 0), tuple(2**n * k - 1 for k in SHAPE)) for n in range(self.levels)]
        edges = [EDGE_m / 2**n for n in range(self.levels)]
        boxes = [COARSE, (FINE,)][: self.levels]
        high_m = LOW_m + EDGE_m * np.array(SHAPE)
        lines = ["HyperCLaw-V1.1", str(len(names)), *names, "3", repr(self.time)]
        lines += [str(self.levels - 1), *(" ".join(map(repr, e.tolist())) for e in (LOW_m, high_m))]
        lines += ["2 " * (self.levels - 1), " ".join(map(text, domains)), "7 " * self.levels]
        lines += [f"{edge!r} {edge!r} {edge!r} " for edge in edges] + ["0", "0"]
        for level, (own, edge) in enumerate(zip(boxes, edges, strict=True)):
            lines += [f"{level} {len(own)} {self.time!r}", "7"]
            for low, high in own:
                ends = [
                    (LOW_m[i] + low[i] * edge, LOW_m[i] + (high[i] + 1) * edge) for i in (0, 1, 2)
                ]
                lines += [f"{float(a)!r} {float(b)!r}" for a, b in ends]
            lines.append(f"Level_{level}/Cell")
            self._level(path / f"Level_{level}", own, edge)
        (path / "Header").write_text("\n".join(lines) + "\n")
        self._particles(path / "particles")
        return path

    def _level(self, folder: Path, boxes: tuple[Box, ...], edge: float) -> None:
        folder.mkdir(parents=True)
        size, body, places, ranges = (4 if self.float32 else 8), b"", [], []
        kind = "32 8 23 0 1 9 0 127" if self.float32 else "64 11 52 0 1 12 0 1023"
        order = range(size, 0, -1) if self.order == "<" else range(1, size + 1)
        for low, high in boxes:
            grown: Box = (
                (low[0] - self.ghosts, low[1] - self.ghosts, low[2] - self.ghosts),
                (high[0] + self.ghosts, high[1] + self.ghosts, high[2] + self.ghosts),
            )
            values = gas(grown, edge)
            if self.solid:  # the lowest layer is solid, the second is cut in half
                layer = np.arange(grown[0][2], grown[1][2] + 1)
                share = np.clip((layer - 0.5) / 1.0, 0.0, 1.0)[:, None, None]
                values = np.concatenate([values, [np.broadcast_to(share, values[0].shape)]])
                values[:-1, layer == 0] = 0.0
            places.append(len(body))
            order_text = " ".join(map(str, order))
            head = f"FAB ((8, ({kind})),({size}, ({order_text}))){text(grown)} {len(values)}\n"
            body += head.encode() + values.astype(f"{self.order}f{size}").tobytes()
            inner = slice(self.ghosts, -self.ghosts or None)
            own = values[:, inner, inner, inner].reshape(len(values), -1)
            ranges.append((own.min(axis=1), own.max(axis=1)))
        (folder / "Cell_D_00000").write_bytes(body)
        lines = ["1", "1", str(len(ranges[0][0])), str(self.ghosts), f"({len(boxes)} 0"]
        lines += [*map(text, boxes), ")", str(len(boxes))]
        lines += [f"FabOnDisk: Cell_D_00000 {place}" for place in places] + [""]
        for side in (0, 1):
            lines.append(f"{len(boxes)},{len(ranges[0][0])}")
            lines += ["".join(f"{value:.17e}," for value in each[side]) for each in ranges] + [""]
        (folder / "Cell_H").write_text("\n".join(lines))

    def _particles(self, folder: Path) -> None:
        (folder / "Level_0").mkdir(parents=True)
        rows = drops()
        kind = "single" if self.single else "double"
        lines = [f"Version_Two_Dot_Zero_{kind}", "3", str(len(PARTICLES)), *PARTICLES, "0", "1"]
        lines += [str(len(rows)), "99", str(self.levels - 1)]
        lines += ["2", "1"][: self.levels]
        body = b""
        for begin, end in ((0, 25), (25, len(rows))):
            lines.append(f"0 {end - begin} {len(body)}")
            body += np.array([[self.ids[n], 0] for n in range(begin, end)], "<i4").tobytes()
            body += rows[begin:end].astype("<f4" if self.single else "<f8").tobytes()
        lines += ["0 0 0"] * (self.levels - 1)
        (folder / "Header").write_text("\n".join(lines) + "\n")
        (folder / "Level_0" / "DATA_00000").write_bytes(body)


def drops() -> np.ndarray[Any, Any]:
    """Positions and `PARTICLES` of 40 parcels."""
    random = np.random.default_rng(3)
    place = random.uniform((-2e-3, -2e-3, 1.6e-3), (2e-3, 2e-3, 11e-3), (40, 3))
    speed = random.normal((0, 0, 60), 3.0, (40, 3))
    low, high = (340.0, 5e-6, 1.0, 500.0), (400.0, 3e-5, 1.0, 4000.0)
    return np.column_stack([place, speed, random.uniform(low, high, (40, 4))])


PLACE: dict[str, Any] = {"nozzle_m": (0.0, 0.0, 0.0), "axis": "+z", "fuel_field": "NC7H16"}


@pytest.fixture
def mapping(tmp_path: Path) -> Path:
    file = tmp_path / "m.yaml"
    file.write_text("parcels: {density: 684}")
    return file


@pytest.mark.parametrize(
    "plot",
    [
        Plot(),
        Plot(single=True, float32=True),
        Plot(order=">"),
        Plot(ghosts=2),
        Plot(levels=1),
    ],
    ids=["plain", "single", "big-endian", "ghosts", "one level"],
)
def test_masses_and_places(tmp_path: Path, mapping: Path, plot: Plot) -> None:
    case = plot.write(tmp_path / "plt00007")
    spray = read(case, mapping=mapping, **PLACE)
    coarse, fine = gas(((0, 0, 0), (7, 7, 15)), EDGE_m), gas(FINE, EDGE_m / 2)
    vapour = coarse[1] * coarse[4] * EDGE_m**3
    if plot.levels == 2:
        vapour[:8, 2:6, 2:6] = 0.0
        vapour = np.append(vapour, fine[1] * fine[4] * (EDGE_m / 2) ** 3)
    rows = drops()
    liquid = 684 * np.pi / 6 * np.sum(rows[:, 9] * rows[:, 7] ** 3)
    exact = 1e-6 if plot.single else 1e-12  # float32 through d^3, or float64
    assert spray.notes["vapour_mass_kg"] == pytest.approx(vapour.sum(), rel=exact)
    assert spray.notes["liquid_mass_kg"] == pytest.approx(liquid, rel=exact)
    assert spray.notes["time_s"] == 1e-3
    assert spray.notes["gas_cells"] == 1024 + (7 * 128 if plot.levels == 2 else 0)
    assert spray.parcels is not None and spray.fuel == "n-heptane"
    place = rows[:, :3] * [1, -1, -1]
    np.testing.assert_allclose(spray.parcels.position_m, place, atol=1e-9)
    assert spray.parcels.velocity_m_s is not None
    np.testing.assert_allclose(spray.parcels.velocity_m_s, rows[:, 3:6] * [1, -1, -1], rtol=1e-6)


def test_solid_bodies_ghost_particles_and_several_times(tmp_path: Path, mapping: Path) -> None:
    whole = Plot(levels=1).write(tmp_path / "run" / "plt00001")
    Plot(levels=1, solid=True, time=2e-3, ids=[*range(1, 40), -2]).write(
        tmp_path / "run" / "plt00002"
    )
    spec = CfdSpray(file=tmp_path / "run", mapping=mapping, **PLACE)
    cut = read_cfd(spec)
    assert cut.notes["time_s"] == 2e-3
    remarks = " ".join(cut.remarks)
    assert "64 cells in solid bodies (volFrac) were omitted" in remarks
    assert "1 particles without a valid id were omitted" in remarks
    own = gas(((0, 0, 0), (7, 7, 15)), EDGE_m)
    vapour = (own[1] * own[4]).sum(axis=(1, 2)) * EDGE_m**3
    vapour[:2] *= 0.0, 0.5
    assert cut.notes["vapour_mass_kg"] == pytest.approx(vapour.sum(), rel=1e-9)
    first = read_cfd(spec.model_copy(update={"time_s": 1e-3}))
    assert first.notes == read_cfd(spec.model_copy(update={"file": whole / "Header"})).notes
    with pytest.raises(SprayError, match=r"available: 0\.001, 0\.002"):
        read_cfd(spec.model_copy(update={"time_s": 3e-3}))
    lines = list_case(spec)
    assert lines[:2] == ["format: amrex", "times in s: 0.001, 0.002"]
    assert "number_density" in lines[3]
    write_mapping(spec, tmp_path / "names.yaml")
    drafted = (tmp_path / "names.yaml").read_text()
    assert "fuel: {column: Y(NC7H16)" in drafted and "number: {column: number_density" in drafted


def test_what_it_lacks_is_named(tmp_path: Path, mapping: Path) -> None:
    case = Plot().write(tmp_path / "plt")
    refused(case, r"no field 'rho'; it has: .*constant: `density: 684`", **PLACE)
    with pytest.raises(SprayError, match=r"no cell field 'IC8H18'.*it has: .*Y\(NC7H16\)"):
        read_cfd(CfdSpray(file=case, mapping=mapping, **{**PLACE, "fuel_field": "IC8H18"}))
    twice = Plot(ids=[*range(1, 40), 1]).write(tmp_path / "twice")
    refused(twice, "particle field id of cpu: 1 occurs 2 times", mapping=mapping, **PLACE)
    other = Plot(names=(*NAMES[:-1], "rho_E")).write(tmp_path / "pelec")
    refused(other, r"rho_E, of PeleC.* cm, g, s; allowed: .* in m, kg, s", mapping=mapping, **PLACE)


def test_other_values_than_its_lists_state(tmp_path: Path, mapping: Path) -> None:
    case = Plot().write(tmp_path / "plt")
    spec = CfdSpray(file=case, mapping=mapping, **PLACE)
    data = case / "Level_0" / "Cell_D_00000"
    whole = bytearray(data.read_bytes())
    hottest = whole.find(np.float64(800.0).tobytes())
    whole[hottest + 6] ^= 1 << 3  # one bit of the exponent
    data.write_bytes(whole)
    with pytest.raises(SprayError, match=r"temp at \d+ is 544 to 800, by Cell_H 641\.15"):
        read_cfd(spec)


def test_as_vtk_reads_it(tmp_path: Path, mapping: Path) -> None:
    """vtk's readers of the same plotfile: cells of each level that no finer ones cover."""
    amr: Any = pytest.importorskip("vtkmodules.vtkIOAMR")
    case = Plot().write(tmp_path / "plt00007")

    def leaves(reader: Any) -> list[Any]:
        reader.Update()
        parts, data = [], reader.GetOutputDataObject(0).NewIterator()
        while not data.IsDoneWithTraversal():
            parts.append(data.GetCurrentDataObject())
            data.GoToNextItem()
        return parts

    reader = amr.vtkAMReXGridReader()
    reader.SetFileName(str(case))
    reader.UpdateInformation()
    reader.SetMaxLevel(1)
    for part in range(reader.GetNumberOfCellArrays()):
        reader.SetCellArrayStatus(reader.GetCellArrayName(part), 1)
    vapour = liquid = 0.0
    for grid in leaves(reader):
        names = ("density", "Y(NC7H16)", "vtkGhostType")
        density, fuel, ghost = (as_numpy(grid.GetCellData().GetArray(name)) for name in names)
        vapour += np.sum(density * fuel * (ghost == 0)) * np.prod(grid.GetSpacing())
    reader = amr.vtkAMReXParticlesReader()
    reader.SetPlotFileName(str(case))
    reader.SetParticleType("particles")
    reader.UpdateInformation()
    reader.GetPointDataArraySelection().EnableAllArrays()
    for cloud in leaves(reader):
        if cloud.GetNumberOfPoints():
            fields = ("number_density", "diam")
            number, size = (as_numpy(cloud.GetPointData().GetArray(name)) for name in fields)
            liquid += 684 * np.pi / 6 * np.sum(number * size**3)
    notes = notes_of(case, mapping=mapping, **PLACE)
    assert notes["vapour_mass_kg"] == pytest.approx(vapour, rel=1e-12)
    assert notes["liquid_mass_kg"] == pytest.approx(liquid, rel=1e-12)
