"""Damaged, incomplete and implausible OpenFOAM cases: refused, with file and field by name."""

from __future__ import annotations

import shutil
from pathlib import Path

from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import notes_of, refused

CLOUD = "0.001/lagrangian/sprayCloud"


def test_times_and_clouds_that_are_not_there(tmp_path: Path) -> None:
    foam.case(tmp_path, cloud=False, time="0")
    foam.case(tmp_path)
    refused(tmp_path, r"no time 0\.002 s \(spray\.time_s\); available: 0, 0\.001", time_s=0.002)
    refused(tmp_path, r"no cloud 'rain' .spray.cloud.; available: sprayCloud", cloud="rain")
    refused(
        tmp_path, r"no parcels at this time, but at others: 0\.001 ", cloud="sprayCloud", time_s=0.0
    )
    foam.case(tmp_path, name="rain")
    refused(tmp_path, r"several clouds: rain, sprayCloud; set spray\.cloud")
    assert notes_of(tmp_path, cloud="rain")["parcels"] == 17


def test_paths_that_are_no_case(tmp_path: Path) -> None:
    refused(tmp_path / "nothing", "no such file or folder")
    refused(tmp_path / "nothing" / "case.foam", "no such file or folder")
    refused(tmp_path, "no case that is read, but: nothing; allowed:")
    foam.case(tmp_path, cloud=False)
    shutil.rmtree(tmp_path / "0.001")
    (tmp_path / "VTK").mkdir()
    refused(tmp_path, r"no time with results; its VTK output .*VTK$")


def test_processors_must_have_the_same_fields(tmp_path: Path) -> None:
    for name in ("processor0", "processor1"):
        foam.case(tmp_path / name)
    (tmp_path / "processor1" / CLOUD / "T").unlink()
    refused(tmp_path, "only some processors have the field 'T'")
