"""The rig of a YAML file: its drivers, their settings, and the clock."""

from collections.abc import Collection
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import Field, ValidationError, model_validator

from cldit.errors import ClditError, SceneError
from cldit.io.plain_data import read_mapping
from cldit.radiance.boundary import Surroundings, Uncertainty
from cldit.rig.clock import Clock, SimulatedClock
from cldit.rig.drivers import RigContext, load_driver
from cldit.rig.errors import InUse, NotConnected, RigError
from cldit.rig.link import Linked
from cldit.rig.protocols import KINDS, Background, Camera, Device, FilterWheel, TriggerGenerator
from cldit.rig.safety import RigSafety, make_safe
from cldit.scene.checks import Section, Within, describe
from cldit.scene.values import Coordinate, Length, Temperature
from cldit.scene.vessel import Windows

PixelPlace = Annotated[float, Within(-1e5, 1e5)]


class ClockChoice(Section):
    """The rig's clock."""

    model: Literal["system", "simulated"] = "system"
    """`simulated` only if every device is; then a sequence takes no time."""
    real_time_factor: Annotated[float, Within(1e-3, 1e6)] | None = None
    """Simulated seconds per real second; without it nothing waits."""
    jump_after_s: Annotated[float, Within(0.0, 1e9)] | None = None
    """A fault of a simulated clock: time after which its date jumps."""
    jump_s: Annotated[float, Within(-1e9, 1e9)] = 0.0
    """Size of the jump."""

    @model_validator(mode="after")
    def _only_simulated(self) -> "ClockChoice":
        if self.model == "system" and self.jump_after_s is not None:
            raise ValueError("jump_after_s: the system's clock cannot be set; allowed: null")
        return self

    def make(self) -> Clock:
        """Makes the chosen clock."""
        if self.model == "system":
            return Clock()
        return SimulatedClock(
            real_time_factor=self.real_time_factor,
            jump_after_s=self.jump_after_s,
            jump_s=self.jump_s,
        )


class DriverChoice(Section):
    """One device: its driver and the driver's settings."""

    driver: str
    """Name of the driver; `cldit devices` lists them."""
    settings: dict[str, Any] = Field(default_factory=dict)
    """Settings of that driver."""


class Setup(Section):
    """Properties of the place that the evaluation needs and no instrument measures."""

    background_emissivity: Annotated[float, Within(1e-3, 1.0)] = 1.0
    """Emissivity of the black body."""
    wall_temperature_K: Temperature = 300.0
    """Temperature of the walls around the spray."""
    background_surroundings_K: Temperature | None = None
    """Temperature of what the black body reflects; without it that of the walls."""
    camera_surroundings_K: Temperature = 295.0
    """Temperature of what a front window reflects into the camera."""
    windows: Windows = ()
    """Windows in front of the camera and in front of the black body, at most one each."""
    background_error_K: Annotated[float, Within(0.0, 10.0)] = 0.0
    """Standard deviation of the black body about its reading, from one set point to the next."""
    camera_offset_error_counts: Annotated[float, Within(0.0, 1e5)] = 0.0
    """Standard deviation of the camera's offset, from one background to the next."""
    camera_gain_error: Annotated[float, Within(0.0, 1.0)] = 0.0
    """Standard deviation of the camera's gain, relative, from one background to the next."""
    uncertainty: Uncertainty = Uncertainty()
    """Uncertainties of the quantities of this section."""
    centre_m: tuple[Coordinate, Coordinate] = (0.0, 0.0)
    """x and z of the image's centre, from the injector's tip."""
    injector_pixel: tuple[PixelPlace, PixelPlace] | None = None
    """Column and row of the injector's tip in the image, from 0 at the top left, for `centre_m`."""
    pixel_m: tuple[Length, Length]
    """Width and height of a pixel in the plane of the spray."""

    @model_validator(mode="after")
    def _one_centre(self) -> "Setup":
        if self.injector_pixel is not None and self.centre_m != (0.0, 0.0):  # as stored too
            raise ValueError("injector_pixel: centre_m is given too; allowed: one of them")
        return self

    def centre_of(self, shape: tuple[int, ...]) -> tuple[float, float]:
        """x and z [m] of the centre of an image of `shape` (rows, columns)."""
        if self.injector_pixel is None:
            return self.centre_m
        column, row = self.injector_pixel
        across, down = (shape[1] - 1) / 2.0 - column, (shape[0] - 1) / 2.0 - row
        return across * self.pixel_m[0], -down * self.pixel_m[1]

    @property
    def surroundings(self) -> Surroundings:
        """Radiation sources that the camera sees beside the spray."""
        shared = {item.name for item in fields(Surroundings)} & set(type(self).model_fields)
        return Surroundings(**{name: getattr(self, name) for name in shared})


class InstrumentsFile(Section):
    """Content of a file with some instruments of a rig, of which one is checked alone."""

    name: str = "rig"
    """Name of the rig."""
    clock: ClockChoice = ClockChoice()
    """Clock of the rig."""
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1
    """Seed of simulated devices."""
    folder: Path | None = None
    """Start of relative paths; without it the folder of the file."""
    setup: Setup | None = None
    """Properties that no instrument measures."""
    bench: DriverChoice | None = None
    """The simulated optical bench; for simulated rigs."""
    camera: DriverChoice | None = None
    """The camera's driver."""
    filter_wheel: DriverChoice | None = None
    """The filter wheel's driver; without it the camera has one filter."""
    background: DriverChoice | None = None
    """The black body's driver."""
    trigger: DriverChoice | None = None
    """The pulse generator's driver."""


class RigFile(InstrumentsFile):
    """Content of a rig file."""

    setup: Setup
    """Properties that no instrument measures."""
    camera: DriverChoice
    """The camera's driver."""
    background: DriverChoice
    """The black body's driver."""
    trigger: DriverChoice
    """The pulse generator's driver."""


@dataclass(frozen=True)
class Rig:
    """The instruments and the clock; as a context manager it ends safe and closed.

    `file` is the rig file with all defaults filled in.
    """

    camera: Camera
    background: Background
    trigger: TriggerGenerator
    clock: Clock
    file: RigFile
    filter_wheel: FilterWheel | None = None
    # Names of devices that were connected, without those that were made safe and closed since.
    _connected: set[str] = field(default_factory=set, init=False, repr=False, compare=False)
    _safe: set[str] = field(default_factory=set, init=False, repr=False, compare=False)

    @property
    def devices(self) -> dict[str, Device]:
        """Devices in the order of connection; the trigger is made safe first."""
        devices = {kind: getattr(self, kind) for kind in KINDS}
        return {kind: device for kind, device in devices.items() if device is not None}

    def connect(self, timeout_s: float = 10.0) -> None:
        """Connects all devices at once, after it has locked all of them for this process.

        Raises InUse, which names every device that another process uses, before anything is asked
        of any, and NotConnected, which names every device that failed, and why.
        """
        self._reserve()
        with ThreadPoolExecutor(len(self.devices), thread_name_prefix="connect") as pool:
            waiting = {
                name: pool.submit(device.connect, timeout_s)
                for name, device in self.devices.items()
            }
        failures = [
            f"{name}: {error}"
            for name, future in waiting.items()
            if (error := future.exception()) is not None
        ]
        self._safe.clear()
        self._connected.update(
            name for name, future in waiting.items() if future.exception() is None
        )
        if failures:
            raise NotConnected("\n".join(failures))

    def _reserve(self) -> None:
        linked = [device for device in self.devices.values() if isinstance(device, Linked)]
        refusals = []
        for device in linked:
            try:
                device.reserve()
            except InUse as error:
                refusals.append(str(error))
        if refusals:
            for device in linked:
                device.let_go()
            raise InUse("\n".join(refusals))

    def make_safe(self, *, taken_over: bool = False) -> RigSafety:
        """Makes every device safe, the last first; see `cldit.rig.safety.make_safe`."""
        safety = make_safe(self.devices, self._connected, taken_over=taken_over)
        self._safe.clear()
        self._safe.update(safety.did)
        return safety

    def close(self) -> list[str]:
        """Closes every device, the last first, and returns one line for each failure."""
        problems = []
        for name, device in reversed(self.devices.items()):
            try:
                device.close()
            except Exception as error:  # the others must be closed all the same
                problems.append(f"{name}: {error}")
        self._connected.difference_update(self._safe)
        return problems

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _: object, error: BaseException | None, __: object) -> None:
        if problems := self.make_safe().unsafe + self.close():
            message = "the rig was not left safe:\n" + "\n".join(problems)
            if error is None:
                raise RigError(message)
            error.add_note(message)


File = TypeVar("File", bound=InstrumentsFile)


def read_rig(path_or_mapping: str | Path | dict[str, Any]) -> RigFile:
    """Reads a rig file and checks all but the drivers' own settings.

    Raises SceneError, which names every key that is not allowed.
    """
    return _read(path_or_mapping, RigFile)


def read_instruments(path: Path) -> InstrumentsFile:
    """Reads a rig file, or one with some of its instruments; raises SceneError as `read_rig`."""
    return _read(path, InstrumentsFile)


def _read(path_or_mapping: str | Path | dict[str, Any], model: type[File]) -> File:
    if isinstance(path_or_mapping, dict):
        data, source, folder = path_or_mapping, "rig", Path.cwd()
    else:
        path = Path(path_or_mapping)
        data, source, folder = read_mapping(path), str(path), path.resolve().parent
    try:
        file = model.model_validate(data)
    except ValidationError as error:
        raise SceneError(f"{source}:\n{describe(model, error.errors())}") from error
    base = folder if file.folder is None else folder / file.folder
    return file.model_copy(update={"folder": base})


def open_rig(path_or_mapping: str | Path | dict[str, Any], *, clock: Clock | None = None) -> Rig:
    """Makes the rig of a file, with nothing connected yet.

    Args:
        path_or_mapping: the YAML file, or its content.
        clock: replaces the one that the file names.

    Raises:
        SceneError: names every key that is not allowed, and every driver that is missing.
    """
    file = read_rig(path_or_mapping)
    source = "rig" if isinstance(path_or_mapping, dict) else str(path_or_mapping)
    clock = clock or file.clock.make()
    parts = [kind for kind in KINDS if getattr(file, kind) is not None]
    return Rig(**_devices(file, parts, clock, source), clock=clock, file=file)


def open_instrument(path: Path, part: str) -> Device:
    """Makes one instrument of a file, not connected yet; raises SceneError as `open_rig`."""
    file = read_instruments(path)
    device: Device = _devices(file, (part,), file.clock.make(), str(path))[part]
    return device


def _devices(
    file: InstrumentsFile, parts: Collection[str], clock: Clock, source: str
) -> dict[str, Any]:
    problems: list[str] = []

    def build(key: str, choice: DriverChoice, bench: object | None) -> Any:
        try:
            factory = load_driver(choice.driver)
        except SceneError as error:
            problems.append(f"{key}.{error}")
            return None
        try:
            context = RigContext(clock, bench, file.folder or Path.cwd(), file.seed)
            return factory(dict(choice.settings), context)
        except ClditError as error:
            problems.extend(f"{key}.settings.{line}" for line in str(error).splitlines())
            return None

    devices: dict[str, Any] = {}
    bench = None if file.bench is None else build("bench", file.bench, None)
    if file.bench is None or bench is not None:
        devices = {key: build(key, getattr(file, key), bench) for key in parts}
    if problems:
        raise SceneError(f"{source}:\n" + "\n".join(problems))
    return devices
