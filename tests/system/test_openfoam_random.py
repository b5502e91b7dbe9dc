"""Random small cases through OpenFOAM's own programs, in random forms, processors and times."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from cldit.cfd.to_spray import read_cfd
from tests.system.test_openfoam_programs import SETTINGS, called
from tests.unit.cfd.conftest import Form, write_case
from tests.unit.cfd.randomcases import Case, Random, random_case, random_fields, rows_read

PROGRAMS = ("foamToVTK", "foamToEnsight", "decomposePar")
pytestmark = pytest.mark.skipif(
    not (SETTINGS.is_file() and all(map(shutil.which, PROGRAMS))),
    reason="OpenFOAM (apt: openfoam) is missing",
)
HEAD = "FoamFile { version 2.0; format ascii; class dictionary; object any; }\n"
SCHEMES = ("div", "grad", "laplacian", "interpolation", "snGrad", "ddt")
# relative error of a number: as written; float32; text of six digits
EXACT, SINGLE, SIX = 1e-12, 1e-7, 6e-6


def write(root: Path, random: Random) -> dict[float, Case]:
    """A case of two times, in ascii or binary, packed or not."""
    newer = random_case(random)
    cases = {5e-4: random_fields(newer.block, random), 1e-3: newer}
    form = Form(binary=bool(random.integers(2)), gz=bool(random.integers(2)))
    for time, case in cases.items():
        write_case(
            root,
            case.block,
            gas=case.gas,
            cloud=case.cloud,
            barycentric="coordinates",  # foamToVTK leaves out parcels that have `positions` alone
            form=form,
            time=f"{time:g}",
        )
    system = root / "system"
    (system / "fvSchemes").write_text(HEAD + "".join(f"{name}Schemes {{}}\n" for name in SCHEMES))
    (system / "fvSolution").write_text(HEAD)
    with (system / "controlDict").open("a") as stream:
        stream.write("writePrecision 16;\n")
    (system / "decomposeParDict").write_text(
        f"{HEAD}numberOfSubdomains {random.integers(2, 5)}; method random;\n"
    )
    return cases


def back(export: Path, cases: dict[float, Case], slack: float) -> None:
    """Refuses an export of which a time is another case."""
    for time, case in cases.items():
        spray = read_cfd(case.spec(export).model_copy(update={"time_s": time, "cloud": None}))
        found, expected = rows_read(spray, case), (case.gas_rows(), case.parcel_rows())
        far = slack * 0.02  # places of up to 20 mm
        # a box is scaled by its volume over its edges, 1 mm at least: an error of some places
        assert found[0][:, :6] == pytest.approx(expected[0][:, :6], abs=10 * far)
        assert found[0][:, 6:] == pytest.approx(expected[0][:, 6:], rel=3 * slack)
        assert found[1][:, :3] == pytest.approx(expected[1][:, :3], abs=far)
        assert found[1][:, 3:] == pytest.approx(expected[1][:, 3:], rel=slack)


def all_come_back(root: Path, seed: int) -> None:
    random = np.random.default_rng(seed)
    cases = write(root, random)
    back(root, cases, EXACT)
    called(root, "foamToVTK")
    back(root / "VTK", cases, SINGLE)
    ascii_ = bool(random.integers(2))
    called(root, "foamToEnsight", *(("-ascii",) if ascii_ else ()))
    back(root / "EnSight", cases, SIX if ascii_ else SINGLE)
    called(root, "decomposePar", "-time", "0:")
    for time in cases:
        shutil.rmtree(root / f"{time:g}")
    back(root, cases, EXACT)


@pytest.mark.parametrize("seed", [0, 1])
def test_programs(seed: int, tmp_path: Path) -> None:
    pytest.importorskip("vtkmodules")
    all_come_back(tmp_path / "case", seed)


@pytest.mark.slow
def test_programs_with_many_cases(tmp_path: Path) -> None:
    pytest.importorskip("vtkmodules")
    for seed in range(100, 130):
        all_come_back(tmp_path / str(seed), seed)
