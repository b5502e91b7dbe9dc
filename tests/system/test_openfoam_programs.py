"""One run of OpenFOAM's aachenBomb, by OpenFOAM's own programs: all that they write is the same.

The tutorial lies in Debian's `openfoam-examples`; on a coarse mesh its first 0.2 ms take a second.
What is compared with is what the solver's log says.
"""

from __future__ import annotations

import gzip
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cldit.api.series import run_series
from cldit.cfd.to_spray import read_cfd
from cldit.errors import SprayError
from cldit.prepare.fitted_scene import fitted_scene
from cldit.scene import load_scene
from cldit.scene.spray import CfdSpray

TUTORIAL = Path("/usr/share/doc/openfoam-examples/examples/lagrangian/sprayFoam/aachenBomb")
SETTINGS = Path("/usr/share/openfoam/etc/bashrc")
PROGRAMS = ("blockMesh", "sprayFoam", "foamToVTK", "foamToEnsight", "decomposePar")
pytestmark = pytest.mark.skipif(
    not (TUTORIAL.is_dir() and SETTINGS.is_file() and all(map(shutil.which, PROGRAMS))),
    reason="OpenFOAM or its tutorials (apt: openfoam, openfoam-examples) are missing",
)
# the mass of vapour, as a sum over the cells that OpenFOAM makes itself
FUNCTIONS = """
functions
{
    fuel
    {
        type volFieldValue; libs (fieldFunctionObjects); regionType all; writeControl writeTime;
        fields (C7H16); operation weightedVolIntegrate; weightField rho; writeFields false;
    }
}
"""


def called(case: Path, *command: str) -> str:
    """The output of a program of OpenFOAM in the folder of a case."""
    line = f"source {SETTINGS} >/dev/null 2>&1; cd '{case}' && " + " ".join(
        f"'{word}'" for word in command
    )
    done = subprocess.run(
        ["bash", "-c", line], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr
    return done.stdout


@dataclass(frozen=True)
class Solved:
    """The case, and what the log says at its end: in SI."""

    case: Path
    parcels: int
    liquid_kg: float
    vapour_kg: float
    sauter_m: float
    path_m: float
    log: str


def _changed(file: Path, *pairs: tuple[str, str]) -> None:
    text = file.read_text()
    for pattern, new in pairs:
        text, count = re.subn(pattern, new, text, flags=re.MULTILINE | re.DOTALL)
        assert count, f"{file}: no {pattern}"
    file.write_text(text)


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Solved:
    case = tmp_path_factory.mktemp("openfoam") / "bomb"
    shutil.copytree(TUTORIAL, case)
    for packed in case.rglob("*.gz"):
        packed.with_suffix("").write_bytes(gzip.decompress(packed.read_bytes()))
        packed.unlink()
    _changed(case / "system" / "blockMeshDict", (r"\(41 41 100\)", "(10 10 25)"))
    _changed(
        case / "system" / "controlDict",
        (r"^endTime .*?;", "endTime 2e-4;"),
        (r"^writeInterval .*?;", "writeInterval 1e-4;"),
        (r"^writeFormat .*?;", "writeFormat ascii;"),
        (r"^writePrecision .*?;", "writePrecision 12;"),
        (r"^functions.*\Z", FUNCTIONS),
    )
    _changed(case / "constant" / "chemistryProperties", (r"^chemistry .*?;", "chemistry off;"))
    _changed(
        case / "constant" / "sprayCloudProperties",
        ("parcelsPerSecond 20000000", "parcelsPerSecond 5000000"),
    )
    called(case, "blockMesh")
    log = called(case, "sprayFoam")

    def last(pattern: str) -> float:
        return float(re.findall(pattern + r"\s*([-+.\deE]+)", log)[-1])

    return Solved(
        case,
        int(last("Current number of parcels *=")),
        last("Current mass in system *="),
        last(r"weightedVolIntegrate\(\w+\) of C7H16 ="),
        last(r"D10, D32, Dmax \(mu\) *= [^,]+,") * 1e-6,
        last(r"Liquid penetration 95% mass \(m\) ="),
        log,
    )


def _vtk(case: Path) -> Path:
    pytest.importorskip("vtkmodules")
    called(case, "foamToVTK", "-time", "2e-4", "-fields", "(T p rho C7H16)")
    return case / "VTK"


def _ensight(case: Path) -> Path:
    called(case, "foamToEnsight", "-time", "2e-4")
    return case / "EnSight"


def _ensight_ascii(case: Path) -> Path:
    called(case, "foamToEnsight", "-ascii", "-time", "2e-4")
    return case / "EnSight"


def _decomposed(case: Path, *extra: str) -> Path:
    """Four processors along the axis, of which the spray has reached one or two."""
    (case / "system" / "decomposeParDict").write_text(
        "FoamFile { version 2.0; format ascii; class dictionary; object decomposeParDict; }\n"
        "numberOfSubdomains 4; method simple; simpleCoeffs { n (1 4 1); delta 0.001; }\n"
    )
    called(case, "decomposePar", "-time", "2e-4", *extra)
    shutil.rmtree(case / "0.0002")
    shutil.rmtree(case / "0.0001")
    return case


def _collated(case: Path) -> Path:
    return _decomposed(case, "-fileHandler", "collated")


def _binary(case: Path) -> Path:
    _changed(case / "system" / "controlDict", ("writeFormat ascii", "writeFormat binary"))
    called(case, "foamFormatConvert", "-time", "2e-4")
    return case


def _renumbered(case: Path) -> Path:
    """Cells in another order; the fields of the last time go with them."""
    for time in ("0", "0.0001"):
        shutil.rmtree(case / time)
    called(case, "renumberMesh", "-overwrite")
    return case


def _region(case: Path) -> Path:
    """The mesh and the fields as those of a region `gas`."""
    (case / "constant" / "gas").mkdir()
    (case / "constant" / "polyMesh").rename(case / "constant" / "gas" / "polyMesh")
    for time in ("0.0001", "0.0002"):
        (case / time).rename(case / "moved")
        (case / time).mkdir()
        (case / "moved").rename(case / time / "gas")
    return case


# each with the relative error of its numbers, a diameter's tripled: text of 12 digits, float32
# (6e-8) with sums of rounded numbers, text of 6 digits (5e-6 a number)
WRITERS: dict[str, tuple[Callable[[Path], Path], float]] = {
    "openfoam": (lambda case: case, 1e-11),
    "openfoam-binary": (_binary, 1e-11),
    "openfoam-region": (_region, 1e-11),
    "openfoam-renumbered": (_renumbered, 1e-11),
    "openfoam-decomposed": (_decomposed, 1e-11),
    "openfoam-collated": (_collated, 1e-11),
    "foamToVTK": (_vtk, 2e-7),
    "foamToEnsight": (_ensight, 2e-7),
    "foamToEnsight-ascii": (_ensight_ascii, 1.5e-5),
}


@pytest.mark.parametrize("writer", WRITERS)
def test_every_export_says_what_the_log_says(tmp_path: Path, solved: Solved, writer: str) -> None:
    write, slack = WRITERS[writer]
    shutil.copytree(solved.case, tmp_path / "bomb")
    spray = read_cfd(CfdSpray(file=write(tmp_path / "bomb")))
    notes = spray.notes
    assert notes["time_s"] == pytest.approx(2e-4, rel=1e-6)
    assert notes["parcels"] == solved.parcels
    assert notes["liquid_mass_kg"] == pytest.approx(solved.liquid_kg, rel=slack)
    assert notes["sauter_mean_diameter_m"] == pytest.approx(solved.sauter_m, rel=slack)
    # coordinates of 0.1 m in float32 or six digits, of a path of 9 mm; cells of 2 mm
    far = 12 * slack if "foamTo" in writer else slack
    assert notes["liquid_path_m"] == pytest.approx(solved.path_m, rel=far)
    assert notes["vapour_mass_kg"] == pytest.approx(solved.vapour_kg, rel=50 * slack)
    # the nozzle stands in the case's own dictionary, for the exports that lie in it, too
    assert [notes[f"nozzle_{name}_m"] for name in "xyz"] == [0.0, 0.0995, 0.0]
    assert [notes[f"axis_{name}"] for name in "xyz"] == [0.0, -1.0, 0.0]
    read = {Path(file.path).name for file in spray.files}
    assert "sprayCloudProperties" in read
    assert all(Path(file.path).stat().st_size == file.bytes for file in spray.files)


@pytest.mark.parametrize("program", ["foamToVTK", "foamToEnsight"])
def test_exports_of_a_region_have_no_parcels(tmp_path: Path, solved: Solved, program: str) -> None:
    """The programs leave them out in silence; the case has them."""
    if program == "foamToVTK":
        pytest.importorskip("vtkmodules")
    case = tmp_path / "bomb"
    shutil.copytree(solved.case, case)
    _region(case)
    shutil.copytree(case / "system", case / "system" / "gas")
    for file in case.glob("constant/*Properties"):
        shutil.copy(file, case / "constant" / "gas")
    fields = ("-fields", "(T p rho C7H16)") if program == "foamToVTK" else ()
    called(case, program, "-region", "gas", "-time", "2e-4", *fields)
    export = case / "EnSight" if program == "foamToEnsight" else case / "VTK"
    if program == "foamToVTK":
        with pytest.raises(SprayError, match=r"VTK files lie in .*VTK/gas; give one of these"):
            read_cfd(CfdSpray(file=export))
        export = export / "gas"
    with pytest.raises(SprayError, match=r"no parcels, but the case .*gas/lagrangian/sprayCloud"):
        read_cfd(CfdSpray(file=export))
    alone = read_cfd(CfdSpray(file=export, cloud="none", axis="-y", nozzle_m=(0, 0.0995, 0)))
    assert alone.notes["vapour_mass_kg"] == pytest.approx(solved.vapour_kg, rel=1e-5)


def test_parallel_export(tmp_path: Path, solved: Solved) -> None:
    """foamToVTK of four processors, of which three have no parcels, writes one mesh."""
    pytest.importorskip("vtkmodules")
    if shutil.which("mpirun") is None:
        pytest.skip("mpirun is missing")
    case = tmp_path / "bomb"
    shutil.copytree(solved.case, case)
    _decomposed(case)
    mpi = ("mpirun", "--allow-run-as-root", "--oversubscribe", "-np", "4")
    called(case, *mpi, "foamToVTK", "-parallel", "-time", "2e-4", "-fields", "(T p rho C7H16)")
    notes = read_cfd(CfdSpray(file=case / "VTK")).notes
    assert notes["liquid_mass_kg"] == pytest.approx(solved.liquid_kg, rel=2e-7)
    assert notes["sauter_mean_diameter_m"] == pytest.approx(solved.sauter_m, rel=2e-7)
    assert notes["vapour_mass_kg"] == pytest.approx(solved.vapour_kg, rel=1e-5)


def test_wedge_of_block_mesh(tmp_path: Path, solved: Solved) -> None:
    """A wedge of 5 degrees as users make it, its axis an empty patch without faces."""
    case = tmp_path / "wedge"
    shutil.copytree(solved.case / "system", case / "system")
    (case / "constant").mkdir()
    angle = np.radians(2.5)
    x, y = 6 * np.cos(angle), 6 * np.sin(angle)
    (case / "system" / "blockMeshDict").write_text(
        "FoamFile { version 2.0; format ascii; class dictionary; object blockMeshDict; }\n"
        f"scale 0.001; vertices ( (0 0 0) ({x} {-y} 0) ({x} {y} 0)"
        f" (0 0 8) ({x} {-y} 8) ({x} {y} 8) );\n"
        "blocks ( hex (0 1 2 0 3 4 5 3) (6 1 8) simpleGrading (1 1 1) );\n"
        "boundary ( front { type wedge; faces ((0 1 4 3)); }\n"
        "back { type wedge; faces ((0 3 5 2)); } axis { type empty; faces ((0 3 3 0)); }\n"
        "rest { type wall; faces ((1 2 5 4) (3 4 5 3) (0 2 1 0)); } );\n"
    )
    called(case, "blockMesh")
    for name, value in (("T", 600.0), ("rho", 20.0), ("C7H16", 0.1)):
        (case / "0.001").mkdir(exist_ok=True)
        (case / "0.001" / name).write_text(
            "FoamFile { version 2.0; format ascii; class volScalarField; }\n"
            f"internalField uniform {value};\n"
        )
    place: dict[str, Any] = {"nozzle_m": (0, 0, 8e-3), "axis": "-z"}
    with pytest.raises(SprayError, match=r"'front', 'back' are wedge: .* of 5 degrees about"):
        read_cfd(CfdSpray(file=case, **place))
    notes = read_cfd(CfdSpray(file=case, sector={"angle_deg": 5}, **place)).notes
    area = 72 * 0.5 * 6e-3**2 * np.sin(np.radians(5))  # of 72 triangles
    assert notes["vapour_mass_kg"] == pytest.approx(area * 8e-3 * 2.0, rel=1e-9)


def test_names_that_are_no_xml(tmp_path: Path, solved: Solved) -> None:
    """foamToVTK writes a field `PaSR<psiReactionThermo>:Qdot` as it is: the way out is named."""
    pytest.importorskip("vtkmodules")
    shutil.copytree(solved.case, tmp_path / "bomb")
    called(tmp_path / "bomb", "foamToVTK", "-time", "2e-4")
    with pytest.raises(SprayError, match=r"internal\.vtu: names a field 'PaSR<.*-fields '\(T p"):
        read_cfd(CfdSpray(file=tmp_path / "bomb" / "VTK"))


def test_reconstructed_after_a_newer_run(tmp_path: Path, solved: Solved) -> None:
    """Two claim the time; which is right, only the user knows."""
    case = tmp_path / "bomb"
    shutil.copytree(solved.case, case)
    shutil.copytree(case / "0.0002", tmp_path / "kept")
    _decomposed(case)
    shutil.copytree(tmp_path / "kept", case / "0.0002")  # with its old dates
    with pytest.raises(SprayError, match=r"2 claim to be time 0\.0002.*processor0"):
        read_cfd(CfdSpray(file=case))


def test_a_series_of_all_its_times_says_what_the_log_says(tmp_path: Path, solved: Solved) -> None:
    """Liquid, vapour and sizes of each time, in the scene that is written for the case."""
    spec = CfdSpray(file=solved.case)
    scene = tmp_path / "bomb.yaml"
    scene.write_text(fitted_scene(spec, read_cfd(spec), name="bomb"))
    small = {"camera.pixels": [16, 20], "domain.leaf_edge_m": 2e-3, "transport.audit": False}
    series = run_series(load_scene(scene).with_(**small), tmp_path / "out", trace_only=True)
    assert [each.state for each in series.times] == ["no spray", "done", "done"]
    for each in series.times[1:]:
        step = re.split(r"^Time = ", solved.log, flags=re.MULTILINE)
        (at,) = [text for text in step if text.startswith(f"{each.time:g}\n")]

        def said(pattern: str, text: str = at) -> float:
            return float(re.findall(pattern + r"\s*([-+.\deE]+)", text)[-1])

        liquid, vapour = said("Current mass in system *="), said(r"\(\w+\) of C7H16 =")
        assert each.spray["liquid_mass_kg"] == pytest.approx(liquid, rel=1e-11)
        assert each.spray["vapour_mass_kg"] == pytest.approx(vapour, rel=1e-9)
        sauter_m = said(r"D10, D32, Dmax \(mu\) *= [^,]+,") * 1e-6
        assert each.spray["sauter_mean_diameter_m"] == pytest.approx(sauter_m, rel=1e-11)
    assert [path.name for path in series.files if path.suffix == ".gif"] == ["film.gif"]
