"""What files and YAML say of times and exposures: read, printed, and held against each other."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
import yaml
from click.testing import CliRunner

from cldit.acquisition.measured import check_clock, open_measured
from cldit.acquisition.pictures.hdf5 import Hdf5
from cldit.acquisition.pictures.source import ImageMetadata, Source, moment_s
from cldit.acquisition.pictures.tiff import Tiff
from cldit.cli import main
from cldit.errors import EvaluationError
from tests.laboratory import Laboratory, laboratory
from tests.measured_files import write_measured

DATE = "2026-01-31T12:00:00"
PICTURES = np.arange(3 * 4 * 5, dtype=np.uint16).reshape(3, 4, 5)


def _ome(
    path: Path, planes: dict[str, Any], *, date: str | None = DATE
) -> tuple[ImageMetadata, ...]:
    metadata = {"axes": "TYX", "Plane": planes} | ({"AcquisitionDate": date} if date else {})
    tifffile.imwrite(path, PICTURES, ome=True, metadata=metadata)
    with closing(Tiff(Source(path))) as opened:
        return opened.metadata


def test_ome(tmp_path: Path) -> None:
    planes = {
        "DeltaT": [0.0, 2.0, 4.5],
        "ExposureTime": [25.0] * 3,
        "ExposureTimeUnit": ["µs"] * 3,
    }
    told = _ome(tmp_path / "a.ome.tif", planes)
    assert [one.time_s for one in told] == [moment_s(DATE) + later for later in (0.0, 2.0, 4.5)]
    assert [one.integration_time_s for one in told] == [pytest.approx(25e-6)] * 3
    undated = _ome(tmp_path / "b.ome.tif", planes, date=None)
    assert {one.time_s for one in undated} == {None}  # no two files would have one start
    assert set(_ome(tmp_path / "c.ome.tif", {})) <= {ImageMetadata()}


def test_the_date_of_a_tiff_is_that_of_the_file(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", PICTURES[0], datetime="2026:01:31 12:00:00")
    with closing(Tiff(Source(tmp_path / "a.tif"))) as opened:
        assert opened.metadata == () and opened.notes == ("file made 2026:01:31 12:00:00",)


def test_nexus(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "run.nxs", "w") as file:
        for name, kind in (("detector", "NXdetector"), ("other", "NXcollection")):
            group = file.create_group(f"entry/{name}")
            group.attrs["NX_class"] = kind
            group["data"] = PICTURES
            group["count_time"] = 25.0
            group["count_time"].attrs["units"] = "us"
            group["start_time"] = [0.0, 2000.0, 4000.0]
            group["start_time"].attrs["units"] = "ms"
            group["start_time"].attrs["start"] = DATE
    with closing(Hdf5(Source(tmp_path / "run.nxs", "/entry/detector/data"))) as opened:
        assert opened.metadata[1].time_s == moment_s(DATE) + 2.0
        assert opened.metadata[1].integration_time_s == pytest.approx(25e-6)
    with closing(Hdf5(Source(tmp_path / "run.nxs", "/entry/other/data"))) as opened:
        assert opened.metadata == ()


def test_a_clock_that_goes_back_is_named(tmp_path: Path) -> None:
    """The third of the selected frames is older than the one before it."""
    times = [9.0, 0.0, 2.0, 1.0]
    told = tuple(ImageMetadata(time_s=time_s) for time_s in times)
    with pytest.raises(EvaluationError, match=r"a\.tif: frame 3: the clock goes back by 1 s"):
        check_clock(told[1:], Source(tmp_path / "a.tif", first=1))
    check_clock((*told[1:3], ImageMetadata(), told[1]), Source(tmp_path / "a.tif"))


@pytest.fixture(scope="module")
def made() -> Laboratory:
    return laboratory(3, shape=(16, 64), references=3, shots=3, scatter=0.0)


def _edit(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    path = folder / "measured.yaml"
    data = yaml.safe_load(path.read_text(encoding="utf-8"))
    change(data)
    path.write_text(yaml.safe_dump(data), encoding="utf-8")


def _timed(data: dict[str, Any]) -> None:
    """Shots alternate, 2 s apart, and 20 s lie between two backgrounds."""
    for number, background in enumerate(data["backgrounds"]):
        start_s = 30.0 * number
        background["references_s"] = [start_s, start_s + 6.0, start_s + 8.0]
        background["injections_s"] = [start_s + 2.0, start_s + 4.0, start_s + 10.0]


@pytest.mark.usefixtures("without_pages")
def test_times_in_the_yaml(made: Laboratory, tmp_path: Path) -> None:
    folder = tmp_path / "a"
    write_measured(folder, made)
    assert {shot.time_s for shot in open_measured(folder).shots} == {None}
    _edit(folder, _timed)
    assert [shot.time_s for shot in open_measured(folder).shots][:6] == [0, 6, 8, 2, 4, 10]
    result = CliRunner().invoke(main, ["evaluate", str(folder)])
    assert result.exit_code == 0, result.output
    said = " ".join(result.output.split())
    assert "times of 24 of 24 images, over 100 s" in said
    assert "drift fitted against time; median shot interval 2 s, longest 20 s" in said


def test_times_in_a_table_as_dates(made: Laboratory, tmp_path: Path) -> None:
    folder = tmp_path / "a"
    write_measured(folder, made)
    lines = ["when", *(f"2026-01-31T12:00:{second:02d}.5" for second in range(3))]
    (folder / "log.csv").write_text("\n".join(lines), encoding="utf-8")
    _edit(folder, lambda data: data["backgrounds"][0].update(references_s="log.csv::when"))
    opened = open_measured(folder)
    assert opened.shots[0].time_s == moment_s(DATE) + 0.5
    assert opened.shots[3].time_s is None  # nobody knows how far another clock is from that
    assert folder / "log.csv" in opened.inputs
    (folder / "log.csv").write_text("when\n1\nlater\n3\n", encoding="utf-8")
    with pytest.raises(EvaluationError, match=r"line 3: when is 'later'; allowed: seconds"):
        open_measured(folder)


@pytest.mark.parametrize(
    ("times_s", "message"),
    [
        ([0.0, 2.0], "references at 423 K: 3 images and 2 times"),
        ([0.0, 4.0, 2.0], "time 2 is 2 s after 4 s .* they must rise"),
    ],
)
def test_times_that_cannot_be(
    made: Laboratory, tmp_path: Path, times_s: list[float], message: str
) -> None:
    write_measured(tmp_path / "a", made)
    _edit(tmp_path / "a", lambda data: data["backgrounds"][0].update(references_s=times_s))
    with pytest.raises(EvaluationError, match=message):
        open_measured(tmp_path / "a")


def _films(folder: Path, made: Laboratory, *, injections_us: float = 25.0) -> None:
    """The same as Telops films, which tell time and exposure."""
    fasthcc = pytest.importorskip("fasthcc")
    write_measured(folder, made)
    for place in sorted(folder.glob("*.tif")):
        pictures = tifffile.imread(place)
        exposed_us = injections_us if place.name.startswith("injection") else 25.0
        start_s = 1_769_860_800 + round(float(place.stem.split("_")[1]))
        headers = [
            {"FrameID": n, "ExposureTime": exposed_us, "POSIXTime": start_s + 6 * n}
            for n in range(len(pictures))
        ]
        path = place.with_suffix(".hcc")
        fasthcc.write_hcc(path, pictures, metadata=headers, calibration_mode=0)
    text = (folder / "measured.yaml").read_text(encoding="utf-8").replace(".tif", ".hcc")
    (folder / "measured.yaml").write_text(text, encoding="utf-8")


def test_exposures_that_differ_are_refused(made: Laboratory, tmp_path: Path) -> None:
    _films(tmp_path / "a", made)
    opened = open_measured(tmp_path / "a")
    assert "exposure 25 us, by 24 of 24 images" in opened.found()
    opened.close()
    _edit(tmp_path / "a", lambda data: data.update(integration_time_s=30e-6))
    with pytest.raises(EvaluationError, match=r"25 us by its file; integration_time_s says 30 us"):
        open_measured(tmp_path / "a")
    _films(tmp_path / "b", made, injections_us=50.0)
    with pytest.raises(EvaluationError, match=r"injection_423.hcc.*50 us .*reference_423.*25 us"):
        open_measured(tmp_path / "b")


def test_times_of_files_and_yaml_must_agree(made: Laboratory, tmp_path: Path) -> None:
    _films(tmp_path / "a", made)

    def shifted(data: dict[str, Any], late_s: float) -> None:
        for number, background in enumerate(data["backgrounds"]):
            start_s = background["temperature_K"] + late_s * (number == 1)
            background["references_s"] = [start_s + 6.0 * n for n in range(3)]

    _edit(tmp_path / "a", lambda data: shifted(data, 0.5))
    open_measured(tmp_path / "a").close()
    _edit(tmp_path / "a", lambda data: shifted(data, 30.0))
    with pytest.raises(EvaluationError, match=r"reference_453.hcc\[0\]: \+30 s later after"):
        open_measured(tmp_path / "a")
