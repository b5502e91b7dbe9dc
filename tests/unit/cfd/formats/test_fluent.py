"""Fluent's pair in HDF5, built by h5py after the layout that vtk's reader documents."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from cldit.cfd.formats import contents, read_case
from cldit.scene.spray import CfdSpray
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import read, refused, same
from tests.unit.cfd.vtkfiles import cell_arrays

NAMES = {"T": "SV_T", "rho": "SV_DENSITY", "C7H16": "C7H16", "p": "SV_P"}


def write_fluent(folder: Path, sample: Any, *, whole: bool = False) -> Path:
    """The sample, faces in two sections or whole; faces of the boundary come first.

    Faces are turned to point into c0, as vtk's reader expects of Fluent.
    """
    block, gas, _ = sample
    folder.mkdir(parents=True, exist_ok=True)
    path, faces, cells = folder / "run.cas.h5", len(block.faces), block.cells
    inner = len(block.neighbour)
    order = [*range(inner, faces), *range(inner)]

    def section(low: int, high: int, place: Any) -> None:
        place.attrs["minId"], place.attrs["maxId"] = np.uint64(low), np.uint64(high)

    with h5py.File(path, "w") as file:
        mesh = file.create_group("meshes/1")
        for name, count in (("cellCount", cells), ("faceCount", faces)):
            mesh.attrs[name] = np.uint64(count)
        mesh.attrs["nodeCount"] = np.uint64(len(block.points))
        mesh.attrs["dimension"] = np.uint64(3)
        mesh["nodes/coords/1"] = block.points
        section(1, len(block.points), mesh["nodes/coords/1"])
        outer = faces - inner
        ranges = [(1, faces)] if whole else [(1, outer), (outer + 1, faces)]
        for number, (low, high) in enumerate(ranges, start=1):
            some = [block.faces[place][::-1] for place in order[low - 1 : high]]
            part = mesh.create_group(f"faces/nodes/{number}")
            section(low, high, part)
            part["nnodes"] = np.array([len(face) for face in some], "i2")
            part["nodes"] = np.concatenate(some).astype("u4") + 1
            part = mesh["faces"]
            c0 = np.array([block.owner[place] for place in order[low - 1 : high]], "u4") + 1
            part[f"c0/{number}"] = c0
            section(low, high, part[f"c0/{number}"])
        mesh["faces/c1/1"] = np.array(block.neighbour, "u4") + 1
        section(outer + 1, faces, mesh["faces/c1/1"])
        for name, count in (("nodes", len(ranges)), ("c0", len(ranges)), ("c1", 1)):
            mesh[f"faces/{name}"].attrs["nSections"] = np.uint64(count)
    with h5py.File(folder / "run.dat.h5", "w") as file:
        held = file.create_group("results/1/phase-1/cells")
        half = cells // 2
        ranges = [(1, cells)] if whole else [(1, half), (half + 1, cells)]
        text = "".join(f"{NAMES[name]};" for name in gas).encode() + b"\0"
        held.create_dataset("fields", data=np.array(text, f"S{len(text)}"))
        for name, values in gas.items():
            part = held.create_group(NAMES[name])
            part.attrs["nSections"] = np.uint64(len(ranges))
            for number, (low, high) in enumerate(ranges, start=1):
                part[f"{number}"] = values[low - 1 : high]
                section(low, high, part[f"{number}"])
    return path


def write_dpm(file: Path, cloud: Any) -> Path:
    mass = cloud["rho"] * np.pi / 6 * cloud["d"] ** 3
    columns = [*cloud["position"].T, *cloud["U"].T, cloud["d"], cloud["T"], mass]
    rows = np.stack([*columns, cloud["nParticle"]], axis=1).tolist()
    names = "x y z u v w diameter t mass n-in-parcel name"
    text = "".join(
        f"(({' '.join(map(repr, row))}) injection-0:{n})\n" for n, row in enumerate(rows)
    )
    file.write_text(f"(outflow {len(rows)})\n({names})\n{text}")
    return file


MAPPING = """
parcels:
  file: drops.dpm
  position: [x, y, z]
  velocity: [u, v, w]
  diameter: diameter
  number: n-in-parcel
  temperature: t
  density: mass-density
"""


def test_pair_and_particles(tmp_path: Path) -> None:
    _, _, cloud = sample = foam.sample()
    case, mapping = write_fluent(tmp_path / "fluent", sample), tmp_path / "names.yaml"
    write_dpm(tmp_path / "drops.dpm", cloud)
    mapping.write_text(MAPPING)
    spray = read(case.with_name("run.dat.h5"), mapping=mapping)
    assert same(spray, read(case, mapping=mapping))
    known = [Path(file.path).name for file in spray.files]
    assert known == ["names.yaml", "run.cas.h5", "run.dat.h5", "drops.dpm"]
    assert "no pressure among the cell fields" in " ".join(spray.remarks)
    assert contents(CfdSpray(file=case)).fields == ("C7H16", "SV_DENSITY", "SV_P", "SV_T")
    refused(case, r"names the parcels, and spray\.cloud is 'other'", mapping=mapping, cloud="other")


def test_vtk_reads_the_same(tmp_path: Path) -> None:
    """The layout of the test is one that another reader of Fluent's files takes."""
    from vtkmodules.vtkIOFLUENTCFF import vtkFLUENTCFFReader

    block, _, _ = sample = foam.sample()
    case = write_fluent(tmp_path, sample, whole=True)
    with h5py.File(case, "r+") as file:  # what that reader wants beside
        mesh = file["meshes/1"]
        for what, key in (("nodes", "node"), ("cells", "cell"), ("faces", "face")):
            mesh.attrs[f"{key}Offset"] = np.uint64(0)
            zone = mesh.require_group(f"{what}/zoneTopology")
            zone.attrs["nZones"] = np.uint64(1)
            for name in ("zoneType", "faceType", "childZoneId", "shadowZoneId", "flags", "id"):
                zone[name] = np.array([1], "i4")
            zone["cellType"] = np.array([4], "i4")  # hexahedra
            for name, value in (
                ("minId", 1),
                ("maxId", mesh.attrs[f"{key}Count"]),
                ("dimension", 3),
            ):
                zone[name] = np.array([value], "u8")
        file.create_group("settings")
    reader: Any = vtkFLUENTCFFReader()
    reader.SetFileName(str(case))
    reader.Update()
    (volumes,) = cell_arrays(reader.GetOutput().GetBlock(0))
    assert volumes == pytest.approx(block.volume, rel=1e-5, abs=0)  # float32 points, 1 % wide
    mesh = read_case(CfdSpray(file=case)).mesh
    ours = mesh.measure(np.arange(mesh.cells)).volume_m3
    assert ours == pytest.approx(block.volume, rel=1e-12, abs=0)


def test_incomplete(tmp_path: Path) -> None:
    case = write_fluent(tmp_path, foam.sample())
    refused(case, "does not state its time", time_s=0.1)
    refused(case, r"no cloud 'drops'", cloud="drops")
