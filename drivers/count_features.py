"""Features of GenICam cameras that change the counts of a scene, set once and read back.

Names: GenICam SFNC 2.7, and makers' manuals (FLIR, Telops, Allied Vision). What a camera adjusts by
itself is switched off, what converts or joins pixels is set to do nothing. Gains and corrections
have no neutral value: the rig file states them, or the dry run names them.
"""

from collections.abc import Mapping

from cldit.rig.checks import ROUNDING
from cldit.rig.errors import ConfigRejected

from .genicam import Client

Value = bool | int | float | str

_BY_ITSELF = (
    *("ExposureAuto", "GainAuto", "BlackLevelAuto", "NUCMode", "NUCModeAuto", "NUCDatasetAuto"),
    *("AutoNUC", "FFCMode", "AutoFFC", "FlatFieldCorrectionMode", "AutoShutter", "ShutterMode"),
)
_ADJUSTS = {"auto", "automatic", "continuous", "once", "periodic"}
_BOOLEANS = {False: ("false", "Off", "0"), True: ("true", "On", "1")}  # YAML reads Off as false
_FIXED = ("Off", "Manual", "External", "false", "0")
_ONE = ("1", "One", "X1", "Off")
_NEUTRAL: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("TestPattern", "TestImageSelector", "TemperatureLinearMode"), ("Off",)),
    **dict.fromkeys(("GammaEnable", "LUTEnable"), ("false", "0")),
    **dict.fromkeys(("BinningHorizontal", "BinningVertical"), _ONE),
    **dict.fromkeys(("DecimationHorizontal", "DecimationVertical"), _ONE),
    "Gamma": ("1",),
    "IRFormat": ("Radiometric",),
}
_STATED = (  # the calibration is valid for one value
    *("Gain", "GainRaw", "GainMode", "SensorGainMode", "SensorWellDepth", "BlackLevel"),
    *("BlackLevelRaw", "NUCMode", "FFCMode", "FlatFieldCorrectionMode", "CalibrationMode"),
)
_TEMPERATURES = {"CalibrationMode": ("RT", "IBR", "IBI")}  # formats that are no counts


def set_features(client: Client, stated: Mapping[str, Value]) -> None:
    """Sets the `stated` features, then the others of this file; raises ConfigRejected."""
    for name, value in stated.items():
        if not client.has(name):
            raise ConfigRejected(f"camera: features.{name}: the camera has no such feature")
        texts = _BOOLEANS[value] if isinstance(value, bool) else (str(value),)
        if not _set(client, name, texts):
            raise ConfigRejected(
                f"camera: features.{name}: reads back {_read(client, name)} after {value} was "
                "written"
            )
    for name in (*_BY_ITSELF, *_NEUTRAL, *_TEMPERATURES):
        present = None if name in stated else _read(client, name)
        if (
            present is None
            or (neutral := _instead(name, present)) is None
            or _set(client, name, neutral)
        ):
            continue
        allowed = f"; wanted: {' or '.join(neutral)}" if neutral else ""
        raise ConfigRejected(
            f"camera: {name} is {present}, which changes its counts, and cannot be set{allowed}; "
            f"set it with the maker's program, or state it as camera.settings.features.{name}"
        )


def _instead(name: str, present: str) -> tuple[str, ...] | None:
    """Values that leave the counts as they are; None if the present one does."""
    if name in _NEUTRAL:
        neutral = _NEUTRAL[name]
        return None if any(_same(present, value) for value in neutral) else neutral
    if name in _TEMPERATURES:
        return () if present in _TEMPERATURES[name] else None
    adjusts = present.lower() in _ADJUSTS or (
        "Auto" in name and present.lower() in ("on", "true", "1")
    )
    return _FIXED if adjusts else None


def read_features(client: Client) -> dict[str, str]:
    """Values of the features that change counts, as far as the camera has them."""
    names = dict.fromkeys((*_BY_ITSELF, *_NEUTRAL, *_STATED))
    values = {name: _read(client, name) for name in names}
    return {name: value for name, value in values.items() if value is not None}


def unstated(values: Mapping[str, str], stated: Mapping[str, Value]) -> list[str]:
    """Features without a neutral value that the rig file does not state, with their values."""
    return [f"{name} {values[name]}" for name in _STATED if name in values and name not in stated]


def _set(client: Client, name: str, values: tuple[str, ...]) -> bool:
    """Sets the first of the values that the camera accepts; False if it accepts none."""
    for value in values:
        try:
            client.set_text(name, value)
            if _same(client.get_text(name), value):
                return True
        except ConfigRejected:  # another type of feature has other values
            continue
    return False


def _read(client: Client, name: str) -> str | None:
    """The present value; None if the camera lacks the feature, or does not offer it at present."""
    return client.get_text(name) if client.has(name) else None


def _same(got: str | None, written: str) -> bool:
    if got is None:
        return False
    try:
        number = float(written)
        return abs(float(got) - number) <= ROUNDING * max(abs(number), ROUNDING)
    except ValueError:
        return got.lower() == written.lower()
