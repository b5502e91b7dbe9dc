"""Camera features that change counts are set and read back, stated in the rig file, or named."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from cldit.acquisition import Plan, acquire
from cldit.acquisition.dry_runs import dry_run
from cldit.errors import RunFolderError
from cldit.rig.errors import ConfigRejected
from cldit.rig.load import open_rig
from tests.emulators import gige_registers as reg
from tests.emulators.gige_camera import GigePeer
from tests.emulators.rig import PeerRig

for _module in ("viva_genicam", "pyvisa_py", "pymodbus"):
    pytest.importorskip(_module, reason=f"{_module} is missing; install cldit[rig]")

if TYPE_CHECKING:  # the same files, by the name under which mypy finds them
    from drivers.count_features import read_features, set_features, unstated
else:
    from cldit.drivers.count_features import read_features, set_features, unstated

PLAN = Plan.model_validate(
    {
        "backgrounds_K": [300.0],
        "shots": 0,
        "references": 1,
        "expect_fuel": False,
        "pause_s": 0.0,
        "drift_K": 10.0,
        "stability": {"tolerance_K": 5.0, "hold_s": 0.1, "settle_s": 0.0},
    }
)


class Camera:
    """A client with features by name: the allowed values, the present one first."""

    def __init__(self, **features: tuple[str, ...]) -> None:
        self.allowed = features
        self.values = {name: allowed[0] for name, allowed in features.items()}
        self.has = self.allowed.__contains__
        self.get_text = self.values.get

    def set_text(self, name: str, value: str) -> None:
        if value not in self.allowed[name]:
            raise ConfigRejected(f"camera: {name}: {value}")
        self.values[name] = value


def test_each_kind_of_feature_is_made_neutral() -> None:
    camera: Any = Camera(
        ExposureAuto=("Once", "Off", "Continuous"),
        GammaEnable=("true", "false"),
        Gamma=("0.45", "1"),
        BinningVertical=("2", "1"),
        BinningHorizontal=("Two", "One"),
        AutoNUC=("On", "Off"),
        NUCMode=("Automatic", "External"),
        CalibrationMode=("NUC", "RT"),
        Gain=("6.02",),
    )
    set_features(camera, {})
    assert camera.values == {
        "ExposureAuto": "Off",
        "GammaEnable": "false",
        "Gamma": "1",
        "BinningVertical": "1",
        "BinningHorizontal": "One",
        "AutoNUC": "Off",
        "NUCMode": "External",
        "CalibrationMode": "NUC",
        "Gain": "6.02",
    }
    values = read_features(camera)
    named = unstated(values, {"CalibrationMode": "NUC"})
    assert values.keys() == camera.values.keys()
    assert named == ["Gain 6.02", "NUCMode External"]


def test_what_the_rig_file_states_is_kept() -> None:
    """YAML reads `Off` as false, also where it is the name of an entry."""
    camera: Any = Camera(NUCMode=("Manual", "Automatic"), Boost=("On", "Off"))
    set_features(camera, {"NUCMode": "Automatic", "Boost": False})
    assert camera.values == {"NUCMode": "Automatic", "Boost": "Off"}


@pytest.mark.parametrize(
    ("has", "stated", "named"),
    [
        ({"GainAuto": ("Continuous",)}, {}, "GainAuto is Continuous.*wanted: Off"),
        ({"IRFormat": ("TemperatureLinear10mK",)}, {}, "IRFormat is Temp.*wanted: Radiometric"),
        ({"CalibrationMode": ("RT", "NUC")}, {}, "CalibrationMode is RT"),
        ({"Gain": ("0",)}, {"Gain": 3}, r"features\.Gain: reads back 0 after 3"),
        ({}, {"Gian": 3}, r"features\.Gian: the camera has no such feature"),
    ],
)
def test_what_cannot_be_set_is_named(
    has: dict[str, tuple[str, ...]], stated: dict[str, Any], named: str
) -> None:
    camera: Any = Camera(**has)
    with pytest.raises(ConfigRejected, match=named):
        set_features(camera, stated)


@pytest.fixture
def peers() -> Iterator[PeerRig]:
    """A camera as a viewer left it: automatic, binned, in temperatures."""
    with PeerRig(camera=GigePeer((64, 48))) as rig:
        for at in (reg.GAIN_AUTO, reg.BINNING, reg.IR_FORMAT):
            rig.camera._put(at, 2)
        rig.camera._put(reg.NUC_MODE, 1)
        rig.camera._put_float(reg.GAIN, 6.0)
        yield rig


@pytest.mark.gige
def test_a_dry_run_sets_or_names_them(peers: PeerRig, tmp_path: Path) -> None:
    data = peers.rig_data()
    with open_rig(data) as rig:
        found = dry_run(rig, PLAN, tmp_path / "a")
    registers = (reg.GAIN_AUTO, reg.BINNING, reg.IR_FORMAT, reg.NUC_MODE)
    assert [peers.camera._get(at) for at in registers] == [0, 1, 0, 0]
    assert found.problems == () and found.unstated == ("Gain 6", "NUCMode Manual")
    peers.camera._put(reg.IR_FORMAT, 1)
    peers.camera.stuck = {reg.IR_FORMAT}
    with open_rig(data) as rig:
        (problem,) = dry_run(rig, PLAN, tmp_path / "a").problems
    assert "IRFormat is TemperatureLinear100mK, which changes its counts" in problem


@pytest.mark.gige
def test_a_folder_is_not_continued_with_another_gain(peers: PeerRig, tmp_path: Path) -> None:
    for gain_dB, stated in ((3.0, True), (6.0, False)):
        data = peers.rig_data()
        data["camera"]["settings"]["features"] = {"Gain": 3.0} if stated else {}
        peers.camera._put_float(reg.GAIN, gain_dB)
        with open_rig(data) as rig:
            if stated:
                acquire(rig, PLAN, tmp_path / "a")
                continue
            (tmp_path / "a" / "shots").rename(tmp_path / "elsewhere")
            with pytest.raises(RunFolderError, match="Gain: 3 before, 6 now"):
                acquire(rig, PLAN, tmp_path / "a")
