"""Measured images in files of any program, described by a small YAML: `measured.yaml`."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise, product
from pathlib import Path
from typing import Annotated, Any, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, ValidationError, model_validator

from cldit.acquisition.frames import FrameReader
from cldit.acquisition.pictures.metadata import (
    check_exposures,
    check_times,
    metadata_lines,
    read_temperatures,
    read_times,
)
from cldit.acquisition.pictures.source import (
    AXES,
    Axis,
    ImageMetadata,
    Source,
    find_sources,
    parse_source,
)
from cldit.acquisition.plan import Kind
from cldit.acquisition.record import Acquisition, open_acquisition
from cldit.acquisition.witness_names import Acceptable
from cldit.camera.calibration import Calibration
from cldit.constants import ZERO_CELSIUS_K
from cldit.errors import EvaluationError, SceneError
from cldit.io.files import natural_order
from cldit.io.plain_data import read_mapping
from cldit.optics.response import Response, to_plain
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
Celsius = Annotated[float, Within(-273.0, 5000.0)]
Readings = tuple[Temperature, ...] | str
Readings_C = tuple[Celsius, ...] | str
Times = tuple[Annotated[float, Within(-1e12, 1e12)], ...] | str


def _all_axes(axes: tuple[Axis, ...] | None) -> tuple[Axis, ...] | None:
    if axes is not None and sorted(axes) != sorted(AXES):
        raise ValueError(f"{', '.join(axes)}; allowed: {', '.join(AXES)} in the files' order")
    return axes


class MeasuredSensor(Section):
    """Camera. Values that are not given are found from the references: gain, and noise from
    variance.
    """

    saturation_counts: Annotated[float, Within(1e-12, 1e12)]
    """Level at and above which a pixel is not used."""
    offset_counts: Annotated[float, Within(-1e6, 1e6)] | None = None
    """Counts in the dark; by default from the references."""
    counts_per_radiance: Annotated[float, Within(1e-40, 1e10)] | None = None
    """Gain, counts per photon s-1 m-2 sr-1; by default from the references."""
    electrons_per_count: Annotated[float, Within(1e-9, 1e21)] | None = None
    """For the photon noise; by default from the references' variance."""
    read_noise_electrons: Annotated[float, Within(0.0, 1e9)] | None = None
    """Noise of the camera; by default from the references' variance."""


class MeasuredBackground(Section):
    """Images taken at one black-body temperature: names of files, with * and ? if wanted."""

    temperature_K: Temperature
    """Temperature of the black body; `temperature_C` in its place is in degrees Celsius."""
    temperature_C: Celsius | None = None
    """The same in degrees Celsius."""
    references: Files
    """Names of images without spray, with * and ?; a part as `file[0:20]` or `file[0::2]`."""
    injections: Files
    """Names of images with spray."""
    references_K: Readings | None = None
    """Black-body temperature of each image: numbers, `log.csv::column`, or `run.nxs::/log`."""
    injections_K: Readings | None = None
    """The same for the injections; temperature_K by default."""
    references_C: Readings_C | None = None
    """As references_K, in degrees Celsius."""
    injections_C: Readings_C | None = None
    """As injections_K, in degrees Celsius."""
    references_s: Times | None = None
    """Time of each image: seconds of one clock, or as above, with dates in a table."""
    injections_s: Times | None = None
    """The same for the injections; if no background has times, those of the files."""

    @model_validator(mode="before")
    @classmethod
    def _kelvin(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        for name in ("temperature", "references", "injections"):
            if f"{name}_C" in data and f"{name}_K" in data:
                raise ValueError(f"{name}_C: {name}_K is given too; allowed: one of them")
        celsius = data.get("temperature_C")
        if isinstance(celsius, (int, float)):
            return {**data, "temperature_K": celsius + ZERO_CELSIUS_K}
        return data


def _filled(data: Any) -> Any:
    """Data of a draft, in which a section with comments alone is None, with empty sections."""
    if not isinstance(data, dict):
        return data
    backgrounds = data.get("backgrounds", ())
    if isinstance(backgrounds, list):
        backgrounds = [{} if background is None else background for background in backgrounds]
    empty: dict[str, Any] = {
        name: {} for name in ("setup", "sensor") if name in data and data[name] is None
    }
    return {**data, **empty, **({"backgrounds": backgrounds} if "backgrounds" in data else {})}


class MeasuredFile(Section):
    """measured.yaml."""

    name: str = "measured"
    """Name of the measurement."""
    filter_um: Filter
    """Two edges, a list of (um, transmission), or a file of both."""
    integration_time_s: Annotated[float, Within(1e-9, 10.0)] | None = None
    """Exposure of every image; by default that of the files."""
    setup: Setup
    """Set-up: everything that no image shows."""
    sensor: MeasuredSensor
    """The camera."""
    backgrounds: tuple[MeasuredBackground, ...]
    """At least two for a fit."""
    references: Count | None = None
    """Required number of references at each background."""
    shots: Count | None = None
    """Required number of injections at each background."""
    axes: Annotated[tuple[Axis, ...] | None, AfterValidator(_all_axes)] = None
    """Order of the axes in stacks of images; by default frames, rows, columns (MATLAB: last)."""
    bad_pixels: str | None = None
    """Image that is not 0 where a pixel is defective."""
    incomplete: bool = False
    """Read what is there of films that ended early or list images in other files."""
    accept: tuple[Acceptable, ...] = ()
    """Checks (witnesses) that do not end the evaluation, whatever they find."""


@dataclass(frozen=True)
class MeasuredShot:
    """One image of a file."""

    id: str
    kind: Kind
    background_setpoint_K: float
    background_K: float
    source: Source
    number: int
    metadata: ImageMetadata
    time_s: float | None

    @property
    def where(self) -> str:
        """Images to which it belongs, for messages."""
        return f"{self.kind}s at {self.background_setpoint_K:g} K"


@dataclass(frozen=True)
class Measured:
    """Measured data for the evaluation (`cldit.dit.shots.Acquisition`).

    bad_pixels: (rows, columns) True where a pixel is not used. accept: names of checks that do not
    end the evaluation. inputs: measured.yaml, and every file that it names. assumed: values of the
    set-up that it does not give.
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
    inputs: tuple[Path, ...] = ()
    assumed: tuple[str, ...] = ()
    reader: FrameReader = field(default_factory=FrameReader, repr=False, compare=False)

    def load(self, shot: MeasuredShot) -> NDArray[Any]:
        """Loads (rows, columns) counts; raises EvaluationError if the image cannot be read."""
        return self.reader.read(shot.source, shot.number)

    def found(self) -> tuple[str, ...]:
        """Summary of the files' content for the user, one line or more; reads the first image of
        each background and kind. Raises EvaluationError if one of them cannot be read.
        """
        groups: dict[tuple[float, Kind], list[MeasuredShot]] = {}
        for shot in self.shots:
            groups.setdefault((shot.background_setpoint_K, shot.kind), []).append(shot)
        forms: list[str] = []
        notes: dict[str, list[str]] = {}
        ends: list[float] = []
        for shot in (group[0] for group in groups.values()):
            picture = self.load(shot)
            rows, columns = picture.shape if picture.ndim == 2 else (0, 0)
            ending = shot.source.path.suffix.removeprefix(".").lower()
            forms.append(f"{columns} x {rows} {picture.dtype} ({ending})")
            for note in self.reader.notes(shot.source):
                notes.setdefault(note, []).append(shot.source.path.name)
            if picture.size and picture.dtype.kind in "uif":
                ends += [float(picture.min()), float(picture.max())]
        kelvin = [shot.background_K for shot in self.shots]
        setpoints = dict.fromkeys(setpoint for setpoint, _ in groups)
        counts = {
            kind: [len(group) for (_, group_kind), group in groups.items() if group_kind == kind]
            for kind in get_args(Kind)
        }
        lines = [
            f"{len(setpoints)} backgrounds ({', '.join(f'{k:g}' for k in setpoints)} K, readings "
            f"{min(kelvin):g}..{max(kelvin):g} K); "
            f"{', '.join(f'{_span(numbers)} {kind}s' for kind, numbers in counts.items())} each; "
            f"{', '.join(dict.fromkeys(forms))}; first images "
            f"{min(ends, default=np.inf):g}..{max(ends, default=-np.inf):g}"
        ]
        if self.assumed:
            lines.append(f"not given, therefore assumed: {', '.join(self.assumed)}")
        lines += metadata_lines([(shot.metadata, shot.time_s) for shot in self.shots])
        pairs = pairwise(dict.fromkeys(shot.source.path for shot in self.shots))
        turned = [
            f"names by their numbers: {path.name} before {following.name}"
            for path, following in pairs
            if str(path) > str(following) and natural_order(path) < natural_order(following)
        ]
        lines += turned[:1]
        for note, names in notes.items():
            further = f" and {len(names) - 1} more" if len(names) > 1 else ""
            lines.append(f"{names[0]}{further}: {note}")
        return tuple(lines)

    def close(self) -> None:
        """Closes the file that was read last."""
        self.reader.close()


def _span(counts: list[int]) -> str:
    return "..".join(str(number) for number in dict.fromkeys((min(counts), max(counts))))


def is_measured(path: str | Path) -> bool:
    """True if a path is measured data: a folder with measured.yaml, or such a file, existing or
    not.
    """
    path = Path(path)
    return (path / MEASURED).is_file() if path.is_dir() else path.suffix in (".yaml", ".yml")


def open_recorded(path: str | Path, *, frame: int = 0) -> Acquisition | Measured:
    """Opens measured data or an acquisition, of which `frame` selects the image of each shot."""
    if not is_measured(path):
        return open_acquisition(path, frame=frame)
    if frame:
        raise EvaluationError(f"{path}: frame {frame}: measured shots have one image, 0")
    return open_measured(path)


def open_measured(path: str | Path) -> Measured:
    """Opens measured.yaml (or the folder with it) and finds its files; no image is read yet.

    Raises SceneError if the YAML is invalid, which names every wrong key, and EvaluationError if
    files are missing, unreadable, named twice, or too few.
    """
    path = Path(path)
    file = path / MEASURED if path.is_dir() else path
    folder = file.resolve().parent
    try:
        data = _filled(read_mapping(file))
        described = MeasuredFile.model_validate(data, context={"folder": folder})
    except ValidationError as error:
        missing = any(item["type"] == "missing" for item in error.errors())
        hint = " is incomplete; complete and uncomment what is missing:" if missing else ""
        raise SceneError(f"{file}:{hint}\n{describe(MeasuredFile, error.errors())}") from error
    with _named(file, "sensor"):
        calibration = _calibration(described)
    reader = FrameReader()
    shots = tuple(_shots(file, described, reader))
    with _named(file, "backgrounds"):
        check_times((shot.id, shot.metadata, shot.time_s) for shot in shots)
    with _named(file, "integration_time_s"):
        check_exposures(((shot.id, shot.metadata) for shot in shots), described.integration_time_s)
    with _named(file, "bad_pixels"):
        bad_pixels = _bad_pixels(folder, described.bad_pixels, reader)
    centre_m = described.setup.centre_m
    if bad_pixels is not None or described.setup.injector_pixel is not None:
        with _named(file, "backgrounds"):
            shape = reader.read(shots[0].source, shots[0].number).shape
        with _named(file, "setup.injector_pixel"):
            centre_m = described.setup.centre_of(shape)
        if bad_pixels is not None and bad_pixels.shape != shape:
            raise EvaluationError(
                f"{file}: bad_pixels: {described.bad_pixels} has shape {bad_pixels.shape}; "
                f"allowed: {shape}, that of {shots[0].id}"
            )
    reader.close()
    return Measured(
        folder=folder,
        name=described.name,
        calibration=calibration,
        surroundings=described.setup.surroundings,
        pixel_m=described.setup.pixel_m,
        centre_m=centre_m,
        bad_pixels=bad_pixels,
        shots=shots,
        accept=described.accept,
        inputs=(
            file,
            *_files(folder, described),
            *dict.fromkeys(shot.source.path for shot in shots),
        ),
        assumed=tuple(
            f"{name} {getattr(described.setup, name):g}"
            for name in ("wall_temperature_K", "background_emissivity")
            if name not in described.setup.model_fields_set
        ),
        reader=reader,
    )


@contextmanager
def _named(file: Path, key: str) -> Iterator[None]:
    """Adds the file and the key to an error about its value."""
    try:
        yield
    except (OSError, ValueError) as error:  # those of cldit too; names may be impossible
        raise EvaluationError(f"{file}: {key}: {error}") from error


def _shots(file: Path, described: MeasuredFile, reader: FrameReader) -> Iterator[MeasuredShot]:
    """All images in the order of `file`, each once."""
    setpoints = [background.temperature_K for background in described.backgrounds]
    for setpoint_K in setpoints:
        if setpoints.count(setpoint_K) > 1:
            raise EvaluationError(
                f"{file}: backgrounds: {setpoint_K:g} K is given twice; list its files together"
            )
    owners: dict[tuple[Source, int], MeasuredShot] = {}
    for (place, background), kind in product(enumerate(described.backgrounds), get_args(Kind)):
        key = f"backgrounds[{place}].{kind}s"
        for shot in _shots_of(file, described, background, kind, reader, key=key):
            owner = owners.setdefault((shot.source, shot.number), shot)
            if owner is not shot:
                owners_text = f"named as {owner.where} and as {shot.where}"
                raise EvaluationError(
                    f"{file}: {key}: {shot.source.text}: {owners_text}; remove one"
                )
            yield shot


def _shots_of(
    file: Path,
    described: MeasuredFile,
    background: MeasuredBackground,
    kind: Kind,
    reader: FrameReader,
    *,
    key: str,
) -> Iterator[MeasuredShot]:
    """Images of one kind at one background, with their temperatures and times; `key` is that of
    the images in the file."""
    folder = file.resolve().parent
    setpoint_K = background.temperature_K
    where = f"{kind}s at {setpoint_K:g} K"
    kelvins, celsius, times = (getattr(background, f"{kind}s{unit}") for unit in ("_K", "_C", "_s"))
    with _named(file, key):
        images = _images_of(folder, described, background, kind, reader, where=where)
    kelvin, taken_s = [setpoint_K] * len(images), [metadata.time_s for _, _, metadata in images]
    if kelvins is not None or celsius is not None:
        with _named(file, f"{key}_{'C' if kelvins is None else 'K'}"):
            kelvin = read_temperatures(
                folder,
                celsius if kelvins is None else kelvins,
                where=where,
                count=len(images),
                setpoint_K=setpoint_K,
                zero_K=ZERO_CELSIUS_K if kelvins is None else 0.0,
            )
    if times is not None:
        with _named(file, f"{key}_s"):
            taken_s = [*read_times(folder, times, where=where, count=len(images))]
    elif any(group.references_s or group.injections_s for group in described.backgrounds):
        taken_s = [None] * len(images)  # those of another clock
    for (source, number, metadata), background_K, time_s in zip(
        images, kelvin, taken_s, strict=True
    ):
        yield MeasuredShot(
            id=_name(source, number, folder),
            kind=kind,
            background_setpoint_K=setpoint_K,
            background_K=background_K,
            source=source,
            number=number,
            metadata=metadata,
            time_s=time_s,
        )


def _images_of(
    folder: Path,
    described: MeasuredFile,
    background: MeasuredBackground,
    kind: Kind,
    reader: FrameReader,
    *,
    where: str,
) -> list[tuple[Source, int, ImageMetadata]]:
    """File, number in it and metadata of each image of one kind at one background."""
    count = described.references if kind == "reference" else described.shots
    timed = getattr(background, f"{kind}s_s") is not None
    images: list[tuple[Source, int, ImageMetadata]] = []
    for named in find_sources(folder, getattr(background, f"{kind}s"), where, described.axes):
        source = replace(named, incomplete=described.incomplete)
        of_file = reader.metadata(source)
        if not timed:
            check_clock(of_file, source)
        images += [(source, number, metadata) for number, metadata in enumerate(of_file)]
    if not images or (count is not None and len(images) != count):
        raise EvaluationError(
            f"{where}: {len(images)} images, expected {count or 'some'}; shots are missing, or too "
            "many files match"
        )
    return images


def _name(source: Source, number: int, folder: Path) -> str:
    """Name of image `number` of the chosen ones: the file in `folder`, and its place there."""
    inside = source.path.is_relative_to(folder)
    named = replace(source, path=source.path.relative_to(folder)) if inside else source
    return f"{named.text}[{source.first + number * source.step}]"


def check_clock(metadata: Sequence[ImageMetadata], source: Source) -> None:
    """Raises EvaluationError if the clock of a file goes back from one of its images to the next:
    some are those of another time, or in another order.
    """
    for number, (earlier, later) in enumerate(pairwise(metadata), start=1):
        if (
            earlier.time_s is not None
            and later.time_s is not None
            and later.time_s < earlier.time_s
        ):
            raise EvaluationError(
                f"{source.text}: frame {source.first + number * source.step}: the clock goes back "
                f"by {earlier.time_s - later.time_s:.3g} s; are frames in another order, or of "
                "another film? Select those of one with [first:last], or give references_s and "
                "injections_s"
            )


def _files(folder: Path, described: MeasuredFile) -> Iterator[Path]:
    """Logs of temperatures and times, and the image of defective pixels."""
    names = [f"{kind}_{unit}" for unit in "KCs" for kind in ("references", "injections")]
    logs = [getattr(background, name) for background in described.backgrounds for name in names]
    for log in (*logs, described.bad_pixels):
        if isinstance(log, str):
            yield folder / parse_source(log)[0]


def _calibration(described: MeasuredFile) -> dict[str, Any]:
    stated = described.filter_um
    filter_um = Response(stated) if isinstance(stated[0], tuple) else stated
    sensor = described.sensor.model_dump(exclude_none=True)
    data = {"filter_um": to_plain(filter_um), **sensor}
    filled = {
        "offset_counts": 0.0,
        "counts_per_radiance": 1.0,
        "electrons_per_count": 1.0,
        "read_noise_electrons": 0.0,
        **data,
    }
    Calibration.from_dict(filled)  # given values must be possible
    return data


def _bad_pixels(folder: Path, name: str | None, reader: FrameReader) -> NDArray[np.bool_] | None:
    if name is None:
        return None
    (source,) = find_sources(folder, (name,), "bad_pixels")[:1]
    return np.asarray(reader.read(source, 0) != 0)
