"""Measured pictures in files of any program, described by a small YAML: `measured.yaml`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, ValidationError

from cldit.acquisition.frames import FrameReader
from cldit.acquisition.pictures.source import Source, parse_source
from cldit.acquisition.plan import Kind
from cldit.camera.calibration import Calibration
from cldit.dit.witness.finding import Acceptable
from cldit.errors import EvaluationError, SceneError
from cldit.optics.response import Response, to_plain
from cldit.plain_data import read_mapping
from cldit.radiance.boundary import Surroundings
from cldit.rig.load import Setup
from cldit.scene.checks import Section, Within, describe
from cldit.scene.values import Filter, Temperature

MEASURED = "measured.yaml"

Files = Annotated[
    tuple[str, ...],
    BeforeValidator(
        lambda value: (value,) if isinstance(value, str) else value,
        json_schema_input_type=str | tuple[str, ...],
    ),
]
Count = Annotated[int, Within(1, 1_000_000)]


class MeasuredSensor(Section):
    """The camera. What is left out is taken from the references: gain, and noise from variance."""

    saturation_counts: Annotated[float, Within(1.0, 1e9)]
    """From here on a pixel is not used."""
    offset_counts: Annotated[float, Within(-1e6, 1e6)] | None = None
    """Counts in the dark; left out: from the references."""
    counts_per_radiance: Annotated[float, Within(1e-40, 1e10)] | None = None
    """Gain, counts per photon s-1 m-2 sr-1; left out: from the references."""
    electrons_per_count: Annotated[float, Within(1e-6, 1e9)] | None = None
    """For the photon noise; left out: from the references' variance."""
    read_noise_electrons: Annotated[float, Within(0.0, 1e9)] | None = None
    """Noise of the camera; left out: from the references' variance."""


class MeasuredBackground(Section):
    """Pictures before one black-body temperature: names of files, with * and ? if wanted."""

    temperature_K: Temperature
    """Of the black body."""
    references: Files
    """Names of pictures without spray, with * and ?; pages as `file[0:20]`."""
    injections: Files
    """Names of pictures with spray."""


class MeasuredFile(Section):
    """measured.yaml."""

    name: str = "measured"
    """Of the measurement."""
    filter_um: Filter
    """Two edges, a list of (um, transmission), or a file of both."""
    integration_time_s: Annotated[float, Within(1e-9, 10.0)] | None = None
    """For the record."""
    setup: Setup
    """What no picture can say."""
    sensor: MeasuredSensor
    """The camera."""
    backgrounds: tuple[MeasuredBackground, ...]
    """At least two for a fit."""
    references: Count | None = None
    """How many there must be before each background."""
    shots: Count | None = None
    """How many injections there must be before each background."""
    bad_pixels: str | None = None
    """A picture that is not 0 where a pixel is defective."""
    accept: tuple[Acceptable, ...] = ()
    """Witnesses that do not end the evaluation, whatever they find."""


@dataclass(frozen=True)
class MeasuredShot:
    """One picture of a file."""

    id: str
    kind: Kind
    background_setpoint_K: float
    background_K: float
    source: Source
    number: int


@dataclass(frozen=True)
class Measured:
    """Measured data, as the evaluation wants it (`cldit.dit.shots.Acquisition`).

    bad_pixels: (rows, columns) True where a pixel is not used. accept: names of witnesses that do
    not end the evaluation.
    """

    folder: Path
    name: str
    calibration: dict[str, Any]
    surroundings: Surroundings
    pixel_m: tuple[float, float]
    centre_m: tuple[float, float]
    bad_pixels: NDArray[np.bool_] | None
    shots: tuple[MeasuredShot, ...]
    accept: tuple[str, ...] = ()
    reader: FrameReader = field(default_factory=FrameReader, repr=False, compare=False)

    def load(self, shot: MeasuredShot) -> NDArray[Any]:
        """(rows, columns) counts.

        Raises:
            EvaluationError: the picture cannot be read.
        """
        return self.reader.read(shot.source, shot.number)

    def close(self) -> None:
        """Closes the file that was read last."""
        self.reader.close()


def is_measured(path: str | Path) -> bool:
    """Whether a path is measured data: a folder with measured.yaml, or such a file."""
    path = Path(path)
    return path.suffix in (".yaml", ".yml") if path.is_file() else (path / MEASURED).is_file()


def open_measured(path: str | Path) -> Measured:
    """Opens measured.yaml (or the folder with it) and finds its files; no picture is read yet.

    Raises:
        SceneError: the YAML is not as it must be; every wrong key is named.
        EvaluationError: files that are missing, unreadable, named twice, or too few.
    """
    path = Path(path)
    file = path / MEASURED if path.is_dir() else path
    try:
        given = MeasuredFile.model_validate(
            read_mapping(file), context={"folder": file.resolve().parent}
        )
    except ValidationError as error:
        raise SceneError(f"{file}:\n{describe(MeasuredFile, error.errors())}") from error
    folder = file.resolve().parent
    reader = FrameReader()
    shots: list[MeasuredShot] = []
    owners: dict[Source, str] = {}
    setpoints: set[float] = set()
    for background in given.backgrounds:
        setpoint_K = background.temperature_K
        if setpoint_K in setpoints:
            raise EvaluationError(
                f"{file}: backgrounds: {setpoint_K:g} K stands there twice; give its files together"
            )
        setpoints.add(setpoint_K)
        wanted: tuple[tuple[Kind, tuple[str, ...], int | None], ...] = (
            ("reference", background.references, given.references),
            ("injection", background.injections, given.shots),
        )
        for kind, patterns, count in wanted:
            where = f"{kind}s before {setpoint_K:g} K"
            found: list[MeasuredShot] = []
            for source in _sources(folder, patterns, where):
                if source in owners:
                    raise EvaluationError(
                        f"{source.text}: named as {owners[source]} and as {where}; leave one out"
                    )
                owners[source] = where
                found += [
                    MeasuredShot(
                        f"{source.path.name}[{number}]",
                        kind,
                        setpoint_K,
                        setpoint_K,
                        source,
                        number,
                    )
                    for number in range(reader.count(source))
                ]
            if not found or (count is not None and len(found) != count):
                raise EvaluationError(
                    f"{where}: {len(found)} pictures, expected {count or 'some'}; shots are "
                    "missing, or too many files match"
                )
            shots += found
    bad_pixels = _bad_pixels(folder, given.bad_pixels, reader)
    reader.close()
    return Measured(
        folder=folder,
        name=given.name,
        calibration=_calibration(given),
        surroundings=given.setup.surroundings,
        pixel_m=given.setup.pixel_m,
        centre_m=given.setup.centre_m,
        bad_pixels=bad_pixels,
        shots=tuple(shots),
        accept=given.accept,
        reader=reader,
    )


def _sources(folder: Path, patterns: tuple[str, ...], where: str) -> list[Source]:
    found: list[Source] = []
    for text in patterns:
        pattern, place = parse_source(text)
        plain = Path(pattern)
        if plain.is_absolute():
            paths = sorted(Path(plain.anchor).glob(str(plain.relative_to(plain.anchor))))
        else:
            paths = sorted(folder.glob(pattern))
        if not paths:
            raise EvaluationError(f"{where}: no file matches {text} in {folder}")
        found += [Source(path, place.dataset, place.first, place.last) for path in paths]
    return found


def _calibration(given: MeasuredFile) -> dict[str, Any]:
    known = given.filter_um
    filter_um = Response(known) if isinstance(known[0], tuple) else known
    sensor = given.sensor.model_dump(exclude_none=True)
    data = {"filter_um": to_plain(filter_um), **sensor}
    filled = {
        "offset_counts": 0.0,
        "counts_per_radiance": 1.0,
        "electrons_per_count": 1.0,
        "read_noise_electrons": 0.0,
        **data,
    }
    Calibration.from_dict(filled)  # what is given must be possible
    return data


def _bad_pixels(folder: Path, name: str | None, reader: FrameReader) -> NDArray[np.bool_] | None:
    if name is None:
        return None
    (source,) = _sources(folder, (name,), "bad_pixels")[:1]
    return np.asarray(reader.read(source, 0) != 0)
