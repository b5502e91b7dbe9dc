"""Which times a series has, and the one nozzle and axis of all of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cldit.cfd.orientation import with_one_frame
from cldit.cfd.times import choose_times
from cldit.cfd.to_spray import read_cfd
from cldit.errors import EmptyCloud, NoFuel, NotAtThisTime, SprayError
from cldit.scene.spray import CfdSpray
from cldit.scene.values import time_of
from tests.unit.cfd.conftest import foam
from tests.unit.cfd.reading import read
from tests.unit.cfd.seriescases import NOZZLE, write_times

KNOWN = (0.0, 1e-3, 2e-3, 5e-4, 3e-3)


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [
        ("all", [0.0, 5e-4, 1e-3, 2e-3, 3e-3]),
        ("::2", [0.0, 1e-3, 3e-3]),
        ("-2:", [2e-3, 3e-3]),
        ("1:3", [5e-4, 1e-3]),
        ([2e-3, 5e-4, 5e-4], [5e-4, 2e-3]),
        (["latest", "nearest 0.0021"], [2e-3, 3e-3]),
    ],
)
def test_times(wanted: str | list[float | str], expected: list[float]) -> None:
    assert list(choose_times("case", KNOWN, wanted)) == expected


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ([7e-4], r"case: no time 0\.0007 s .*available: 0, 0\.0005, 0\.001"),
        ("9:", r"case: 9:: selects none of its 5 times"),
        ("every", r"allowed: `all`"),
        ("::0", r"allowed: `all`"),
        ("1:2:3:4", r"allowed: `all`"),
    ],
)
def test_times_that_are_refused(wanted: str | list[float | str], message: str) -> None:
    with pytest.raises(SprayError, match=message):
        choose_times("case", KNOWN, wanted)


@pytest.mark.parametrize(
    ("text", "time"),
    [("0.95ms", 0.95e-3), ("950 us", 950e-6), ("1e-3 s", 1e-3), ("-12.5", -12.5), ("0.3", 0.3)],
)
def test_a_time_with_its_unit(text: str, time: float) -> None:
    """Exactly the number that the case has, not one beside it."""
    assert time_of(text) == time
    assert CfdSpray(file=Path("case"), time_s=text).time_s == time


@pytest.mark.parametrize("text", ["soon", "1 min", "ms", "1,5ms", ""])
def test_what_is_no_time(text: str) -> None:
    with pytest.raises(ValueError, match="number"):
        time_of(text)


def test_one_frame_from_the_time_that_tells_it_best(tmp_path: Path) -> None:
    """Parcels tell the nozzle; the last time has none."""
    case = write_times(tmp_path / "case", {"0.0001": 4e-5, "0.0002": 1e-4, "0.0003": -1.0})
    spec, remarks = with_one_frame(CfdSpray(file=case), (1e-4, 2e-4, 3e-4))
    assert spec.nozzle_m == pytest.approx(NOZZLE, abs=2e-4)
    assert spec.axis == (0.0, -1.0, 0.0)
    assert any("extrapolated to age zero" in each for each in remarks)
    nozzle = {
        tuple(read_cfd(spec.model_copy(update={"time_s": t})).notes[f"nozzle_{x}_m"] for x in "xyz")
        for t in (1e-4, 2e-4)
    }
    assert nozzle == {spec.nozzle_m}


def test_a_frame_that_is_given_stays(tmp_path: Path) -> None:
    case = write_times(tmp_path / "case", {"0.0001": 4e-5})
    given = CfdSpray(file=case, nozzle_m=(0, 0.01, 0), axis="-y")
    assert with_one_frame(given, (1e-4,)) == (given, ())


def test_a_frame_that_no_time_tells(tmp_path: Path) -> None:
    case = foam.case(tmp_path / "case")  # without ages
    with pytest.raises(SprayError, match="nozzle and axis"):
        with_one_frame(CfdSpray(file=case), (1e-3,))


def test_a_time_without_fuel_is_told_from_one_that_lacks_something(tmp_path: Path) -> None:
    times = {"0": 0.0, "0.0001": 4e-5, "0.0002": -1.0, "0.0003": 0.0}
    case = write_times(tmp_path / "case", times)

    with pytest.raises(NotAtThisTime, match=r"no parcels at this time, but at others: 0\.0001"):
        read(case, time_s=0.0, nozzle_m=NOZZLE)
    with pytest.raises(NotAtThisTime, match="no cell field 'C7H16'"):
        read(case, time_s=0.0, nozzle_m=NOZZLE, cloud="none")
    with pytest.raises(EmptyCloud, match="has no parcel"):
        read(case, time_s=2e-4, nozzle_m=NOZZLE)
    read(case, time_s=2e-4, nozzle_m=NOZZLE, cloud="none")
    zero = write_times(tmp_path / "zero", {"0.0001": -1.0})
    field = zero / "0.0001" / "C7H16"
    field.write_text(field.read_text().split("internalField")[0] + "internalField uniform 0;\n")
    with pytest.raises(NoFuel, match="no fuel: no liquid"):
        read(zero, cloud="none", nozzle_m=NOZZLE, axis="-y")


def test_penetrations_are_of_the_mass(tmp_path: Path) -> None:
    case = write_times(tmp_path / "case", {"0.0001": 1e-4})
    spray = read(case, nozzle_m=NOZZLE, axis="-y")
    assert spray.parcels is not None
    depth, mass = -spray.parcels.position_m[:, 2], spray.parcels.masses_kg
    for percent in (90, 95, 99):
        reach = spray.notes[f"liquid_penetration_{percent}_m"]
        above = float(mass[depth <= reach].sum() / mass.sum())
        before = float(mass[depth < reach].sum() / mass.sum())
        assert before < percent / 100 <= above
    assert np.isfinite(spray.notes["ambient_temperature_K"])
