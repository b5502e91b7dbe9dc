"""Types of the values of a scene: numbers with a range, points, directions, curves."""

import math
from decimal import Decimal
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, ValidationInfo

from cldit.errors import SceneError
from cldit.scene.checks import Within, length
from cldit.scene.curves import FREQUENCY, WAVELENGTH, Axis, Curve, check_curve, read_curve
from cldit.scene.point_samples import Samples, check_samples, read_samples

Length = Annotated[float, Within(1e-6, 100.0)]
Coordinate = Annotated[float, Within(-100.0, 100.0)]
Temperature = Annotated[float, Within(0.0, 5000.0)]
Backgrounds = Annotated[tuple[Temperature, ...], length(1, 1000, "temperatures")]
Pixels = Annotated[int, Within(1, 16384)]
Fraction = Annotated[float, Within(0.0, 1.0)]
Angle = Annotated[float, Within(-360.0, 360.0)]
Point = tuple[Coordinate, Coordinate, Coordinate]


def _direction(value: object) -> object:
    """Three numbers of a text such as `-y`."""
    if not isinstance(value, str):
        return value
    if len(value) != 2 or value[0] not in "+-" or value[1] not in "xyz":
        raise ValueError(f"{value!r} is no direction; allowed: -x, +x .. +z, or three numbers")
    sign = 1.0 if value[0] == "+" else -1.0
    return tuple(sign if name == value[1] else 0.0 for name in "xyz")


def _not_zero(value: Point) -> Point:
    if math.hypot(*value) < 1e-9:
        raise ValueError(f"{value} has no length; allowed: -x, +x .. +z, or three numbers")
    return value


Direction = Annotated[
    Point,
    BeforeValidator(
        _direction, json_schema_input_type=Point | Literal["-x", "+x", "-y", "+y", "-z", "+z"]
    ),
    AfterValidator(_not_zero),
]


def time_of(quantity: str) -> float:
    """The number in a text, in a case's own unit, or in s if it ends with s, ms or us."""
    unit = next((unit for unit in ("ms", "us", "s") if quantity.endswith(unit)), "")
    try:
        # shifted as text, so that 0.95ms is the number that is written 0.95e-3
        return float(Decimal(quantity.removesuffix(unit).strip()).scaleb(_SHIFT[unit]))
    except ArithmeticError as error:
        raise ValueError(f"{quantity!r} is no number") from error


_SHIFT = {"": 0, "s": 0, "ms": -3, "us": -6}  # powers of ten


def _case_time(value: object) -> object:
    """Checks a finite number, with unit or not, `latest`, or `nearest` and a number."""
    entry = str(value).strip()
    if isinstance(value, bool):
        raise ValueError(f"{entry} is no time; {_TIMES}")
    if entry == "latest":
        return entry
    nearest = entry.startswith("nearest")
    try:
        time = time_of(entry.removeprefix("nearest").strip(" :"))
    except ValueError as error:
        raise ValueError(f"{entry!r} is no time; {_TIMES}") from error
    if not math.isfinite(time) or abs(time) > 1e6:
        raise ValueError(f"{entry} is outside -1e6..1e6")
    return f"nearest {time!r}" if nearest else time


_TIMES = "allowed: a time of the case, `latest`, or `nearest` and a number"
CaseTime = Annotated[
    float | str,
    BeforeValidator(_case_time, json_schema_input_type=Annotated[float, Within(-1e6, 1e6)] | str),
]


Wavelength = Annotated[float, Within(WAVELENGTH.low, WAVELENGTH.high)]


def _in_folder(file: str | Path, info: ValidationInfo) -> Path:
    """Path of a file that is given relative to the scene's folder."""
    folder = (info.context or {}).get("folder")
    return Path(file) if folder is None else (Path(folder) / file).resolve()


def _curve(value: object, info: ValidationInfo, over: Axis = WAVELENGTH) -> object:
    """Reads a curve from a file, or checks one that is given as pairs; returns numbers as given."""
    try:
        if isinstance(value, (str, Path)):
            return read_curve(_in_folder(value, info), over)
        if isinstance(value, (list, tuple)) and value and isinstance(value[0], (list, tuple)):
            return check_curve(value, source="curve", over=over)
    except SceneError as error:
        raise ValueError(str(error)) from error
    return value


def _curve_or_numbers(value: object) -> str:
    pairs = isinstance(value, tuple) and bool(value) and isinstance(value[0], tuple)
    return "[curve]" if pairs else "[numbers]"


Filter = Annotated[
    Annotated[Curve, Tag("[curve]")] | Annotated[tuple[Wavelength, Wavelength], Tag("[numbers]")],
    Discriminator(_curve_or_numbers),
    BeforeValidator(_curve, json_schema_input_type=tuple[Wavelength, Wavelength] | Curve | Path),
]


QuantumEfficiency = Annotated[
    Annotated[Curve, Tag("[curve]")] | Annotated[float, Within(1e-3, 1.0), Tag("[numbers]")],
    Discriminator(_curve_or_numbers),
    BeforeValidator(
        _curve, json_schema_input_type=Annotated[float, Within(1e-3, 1.0)] | Curve | Path
    ),
]


def _material(value: object, info: ValidationInfo) -> object:
    """The name of a substance, or the full path of an existing table.

    The table of a finished run (context `finished`) may have been moved since.
    """
    if not (isinstance(value, str) and Path(value).suffix):
        return value
    path = _in_folder(value, info)
    if not path.is_file() and not (info.context or {}).get("finished"):
        raise ValueError(
            f"{path}: no such file; allowed: the name of a substance, or a table beside the scene"
        )
    return str(path)


Material = Annotated[str, Field(min_length=1), BeforeValidator(_material)]


WindowCurve = Annotated[Curve, BeforeValidator(_curve, json_schema_input_type=Curve | Path)]


def _transfer(value: object, info: ValidationInfo) -> object:
    """An MTF: a curve over spatial frequency that starts with 1 at 0."""
    curve = _curve(value, info, FREQUENCY)
    if isinstance(curve, tuple) and curve and curve[0] != (0.0, 1.0):
        raise ValueError(f"starts with {curve[0][1]:g} at {curve[0][0]:g} 1/mm; allowed: 1 at 0")
    return curve


TransferCurve = Annotated[Curve, BeforeValidator(_transfer, json_schema_input_type=Curve | Path)]


def _samples(value: object, info: ValidationInfo) -> object:
    try:
        if isinstance(value, (str, Path)):
            return read_samples(_in_folder(value, info))
        return check_samples(value, source="samples")
    except SceneError as error:
        raise ValueError(str(error)) from error


PointSamples = Annotated[Samples, BeforeValidator(_samples, json_schema_input_type=Samples | Path)]
