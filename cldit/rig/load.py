"""The rig from its YAML file: which drivers, with which settings, on which clock."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationError, model_validator

from cldit.errors import ClditError, SceneError
from cldit.io.plain_data import read_mapping
from cldit.radiance.boundary import Surroundings, Uncertainty
from cldit.rig.clock import Clock, SimulatedClock, SystemClock
from cldit.rig.drivers import RigContext, load_driver
from cldit.rig.errors import NotConnected, RigError
from cldit.rig.protocols import Background, Camera, Device, TriggerGenerator
from cldit.rig.safety import RigSafety, make_safe
from cldit.scene.checks import Section, Within, describe
from cldit.scene.values import Coordinate, Length, Temperature
from cldit.scene.vessel import Windows


class ClockChoice(Section):
    """`simulated` only where every device is; then a sequence takes no time."""

    model: Literal["system", "simulated"] = "system"
    """`simulated` only where every device is."""
    real_time_factor: Annotated[float, Within(1e-3, 1e6)] | None = None
    """Simulated seconds to a real one; left out: no waiting."""
    jump_after_s: Annotated[float, Within(0.0, 1e9)] | None = None
    """A fault of a simulated clock: when its date is set."""
    jump_s: Annotated[float, Within(-1e9, 1e9)] = 0.0
    """By how much."""

    @model_validator(mode="after")
    def _only_simulated(self) -> ClockChoice:
        if self.model == "system" and self.jump_after_s is not None:
            raise ValueError("jump_after_s: the system's clock is not ours to set; allowed is null")
        return self

    def make(self) -> Clock:
        """The clock that was chosen."""
        if self.model == "system":
            return SystemClock()
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
    """Of that driver; what is wrong is named with what is allowed."""


class UncertaintySection(Section):
    """Standard uncertainties of what no picture shows; for the evaluation's budget."""

    background_emissivity: Annotated[float, Within(0.0, 0.5)] = 0.01
    """Of the black body's emissivity."""
    wall_temperature_K: Annotated[float, Within(0.0, 100.0)] = 1.0
    """Of the walls."""
    window_temperature_K: Annotated[float, Within(0.0, 100.0)] = 1.0
    """Of either window."""
    window_transmission: Annotated[float, Within(0.0, 0.5)] = 0.01
    """Of either window."""
    filter_um: Annotated[float, Within(0.0, 1.0)] = 0.01
    """By how much the filter may lie beside what is stated."""


class Setup(Section):
    """What the evaluation must know of the place and no instrument can say."""

    background_emissivity: Annotated[float, Within(1e-3, 1.0)] = 1.0
    """Of the black body."""
    wall_temperature_K: Temperature = 300.0
    """Of what is around the spray."""
    background_surroundings_K: Temperature | None = None
    """What the black body reflects; the walls where left out."""
    camera_surroundings_K: Temperature = 295.0
    """What a front window reflects into the camera."""
    windows: Windows = ()
    """Windows before the camera and before the black body, one each."""
    background_error_K: Annotated[float, Within(0.0, 10.0)] = 0.0
    """Standard deviation of the black body about its reading, from one set point to the next."""
    camera_offset_error_counts: Annotated[float, Within(0.0, 1e5)] = 0.0
    """Standard deviation of the camera's offset, from one background to the next."""
    camera_gain_error: Annotated[float, Within(0.0, 1.0)] = 0.0
    """Standard deviation of the camera's gain, relative, from one background to the next."""
    uncertainty: UncertaintySection = UncertaintySection()
    """How well the rest of this section is known."""
    centre_m: tuple[Coordinate, Coordinate] = (0.0, 0.0)
    """x and z of the picture's middle."""
    pixel_m: tuple[Length, Length]
    """Width and height of a pixel in the plane of the spray."""

    @property
    def surroundings(self) -> Surroundings:
        """What the camera sees beside the spray."""
        return Surroundings(
            wall_temperature_K=self.wall_temperature_K,
            background_emissivity=self.background_emissivity,
            background_surroundings_K=self.background_surroundings_K,
            camera_surroundings_K=self.camera_surroundings_K,
            windows=self.windows,
            background_error_K=self.background_error_K,
            camera_offset_error_counts=self.camera_offset_error_counts,
            camera_gain_error=self.camera_gain_error,
            uncertainty=Uncertainty(**self.uncertainty.model_dump()),
        )


class RigFile(Section):
    """A rig file."""

    name: str = "rig"
    """Of the rig."""
    clock: ClockChoice = ClockChoice()
    """The rig's time."""
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1
    """Of simulated devices."""
    folder: Path | None = None
    """Where relative paths start; the file's own folder where left out."""
    setup: Setup
    """What no instrument can say."""
    bench: DriverChoice | None = None
    """The simulated optical bench; for simulated rigs."""
    camera: DriverChoice
    """The camera's driver."""
    background: DriverChoice
    """The black body's driver."""
    trigger: DriverChoice
    """The pulse generator's driver."""


@dataclass(frozen=True)
class Rig:
    """The instruments and the time. As a context manager it ends safe and closed.

    `file` is the rig file as used, with nothing left to defaults.
    """

    camera: Camera
    background: Background
    trigger: TriggerGenerator
    clock: Clock
    file: RigFile
    # Names of devices that were connected, but for those that were made safe and closed since.
    _connected: set[str] = field(default_factory=set, init=False, repr=False, compare=False)
    _safe: set[str] = field(default_factory=set, init=False, repr=False, compare=False)

    @property
    def devices(self) -> dict[str, Device]:
        """Devices in the order of connection; the trigger is made safe first."""
        return {"camera": self.camera, "background": self.background, "trigger": self.trigger}

    def connect(self, timeout_s: float = 10.0) -> None:
        """Connects all devices at once.

        Raises:
            NotConnected: names every device that failed, and why.
        """
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

    def make_safe(self, *, connect_s: float | None = None) -> RigSafety:
        """Makes every device safe, the last one first; see `cldit.rig.safety.make_safe`."""
        safety = make_safe(self.devices, self._connected, connect_s=connect_s)
        self._safe.clear()
        self._safe.update(safety.did)
        return safety

    def close(self) -> list[str]:
        """Closes every device, the last one first; what went wrong, one line a device."""
        problems: list[str] = []
        for name, device in reversed(self.devices.items()):
            try:
                device.close()
            except Exception as error:  # one broken device must not keep the others
                problems.append(f"{name}: {error}")
        self._connected.difference_update(self._safe)
        return problems

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        problems = self.make_safe().problems + self.close()
        if not problems:
            return
        text = "the rig was not left safe:\n" + "\n".join(problems)
        if error is None:
            raise RigError(text)
        error.add_note(text)


def read_rig(path_or_mapping: str | Path | dict[str, Any]) -> RigFile:
    """A rig file, checked but for the drivers' own settings.

    Raises:
        SceneError: names every key that is not allowed.
    """
    if isinstance(path_or_mapping, dict):
        data, source, folder = path_or_mapping, "rig", Path.cwd()
    else:
        path = Path(path_or_mapping)
        data, source, folder = read_mapping(path), str(path), path.resolve().parent
    try:
        file = RigFile.model_validate(data)
    except ValidationError as error:
        raise SceneError(f"{source}:\n{describe(RigFile, error.errors())}") from error
    base = folder if file.folder is None else folder / file.folder
    return file.model_copy(update={"folder": base})


def open_rig(path_or_mapping: str | Path | dict[str, Any], *, clock: Clock | None = None) -> Rig:
    """The rig that a file (or the mapping in it) describes. Nothing is connected yet.

    Args:
        path_or_mapping: the YAML file, or what is in it.
        clock: in place of the one that the file names.

    Raises:
        SceneError: names every key that is not allowed, every driver that is missing.
    """
    file = read_rig(path_or_mapping)
    folder = file.folder or Path.cwd()
    if clock is None:
        clock = file.clock.make()
    problems: list[str] = []

    def build(key: str, choice: DriverChoice, bench: object | None) -> Any:
        try:
            factory = load_driver(choice.driver)
        except SceneError as error:
            problems.append(f"{key}.{error}")
            return None
        try:
            return factory(dict(choice.settings), RigContext(clock, bench, folder, file.seed))
        except ClditError as error:
            problems.extend(f"{key}.settings.{line}" for line in str(error).splitlines())
            return None

    bench = None if file.bench is None else build("bench", file.bench, None)
    if file.bench is None or bench is not None:
        devices = {
            key: build(key, getattr(file, key), bench)
            for key in ("camera", "background", "trigger")
        }
    if problems:
        source = "rig" if isinstance(path_or_mapping, dict) else str(path_or_mapping)
        raise SceneError(f"{source}:\n" + "\n".join(problems))
    return Rig(**devices, clock=clock, file=file)
