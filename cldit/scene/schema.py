"""The scene: frozen data with a range, a unit and a default for every key.

Defaults are the paper's values (Section "Ray Tracing") where it gives them.
"""

from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import Field, ValidationError, model_validator

from cldit.errors import SceneError
from cldit.io.plain_data import dump_yaml
from cldit.scene.camera import Camera
from cldit.scene.change import changed
from cldit.scene.checks import Former, Section, Within, describe
from cldit.scene.optics import Optics
from cldit.scene.spray import Spray, gas_jet_of_0_1
from cldit.scene.transport import Transport
from cldit.scene.values import Point
from cldit.scene.vessel import Background, Domain, Patches, Walls, Windows

_GAS_OF_0_1 = "cone", "methane"  # model and fuel of a spray


class Rig(Section):
    """Behaviour of the simulated rig."""

    background_start_K: ClassVar[float] = 295.0  # that of a room
    _former: ClassVar[Former] = {"background_start_K": (295.0, "it is 295 K, that of a room")}

    background_time_constant_s: Annotated[float, Within(0.0, 1e5)] = 120.0
    """Time constant with which the black body approaches its set point."""
    seed: Annotated[int, Within(0, 2**31 - 1)] = 1
    """Random seed of noise and of `spray.scatter.optical_depth`."""


class PlanSize(Section):
    """Number of recordings at each background temperature."""

    shots: Annotated[int, Within(1, 100_000)] = 5
    """Number of injections at each background temperature."""
    references: Annotated[int, Within(1, 100_000)] = 5
    """Number of reference images, without injection, at each background temperature."""
    delays_s: tuple[Annotated[float, Within(1e-5, 0.1)], ...] = ()
    """Delays after the start of injection, at every background. Empty: `spray.time_s` alone."""


class Scene(Section):
    """All input of a run; `cldit.load_scene` reads it from YAML."""

    name: Annotated[str, Field(min_length=1, max_length=100)]
    """Name of the run's folder and figures."""
    description: str = ""
    """Text for lists and reports."""
    domain: Domain = Domain()
    """The traced cube."""
    spray: Spray
    """The spray between camera and background."""
    camera: Camera = Camera()
    """Position, field of view and sensor of the camera."""
    background: Background = Background()
    """The black body behind the spray."""
    walls: Walls = Walls()
    """The rest of the enclosure, at one temperature."""
    patches: Patches = ()
    """Parts of the enclosure with their own temperature and weight, at most 16."""
    windows: Windows = ()
    """Windows in front of the camera and of the background, at most one each."""
    optics: Optics = Optics()
    """The camera's filter, and optical properties of liquid and vapour."""
    transport: Transport = Transport()
    """Settings of the radiative transfer."""
    rig: Rig = Rig()
    """The simulated instruments."""
    plan: PlanSize = PlanSize()
    """Number of recordings."""

    @model_validator(mode="before")
    @classmethod
    def _of_0_1(cls, data: Any) -> Any:
        """Moves the scatter between shots from its place in version 0.1, and reads its gas jets."""
        spray = data.get("spray") if isinstance(data, dict) else None
        if isinstance(spray, dict) and (spray.get("model"), spray.get("fuel")) == _GAS_OF_0_1:
            data = {**data, "spray": gas_jet_of_0_1(spray)}
        rig = data.get("rig") if isinstance(data, dict) else None
        old = {"shot_scatter": "optical_depth", "shot_scatter_length_m": "length_m"}
        if not isinstance(rig, dict) or not rig.keys() & old.keys():
            return data
        moved = {f"spray.scatter.{old[key]}": rig[key] for key in old if key in rig}
        return changed({**data, "rig": {k: v for k, v in rig.items() if k not in old}}, moved)

    @classmethod
    def from_dict(
        cls,
        data: dict[str, Any],
        *,
        source: str = "scene",
        folder: Path | None = None,
        finished: bool = False,
    ) -> "Scene":
        """Checks plain data and returns the scene.

        Args:
            data: as read from YAML.
            source: name of the scene in messages.
            folder: start of its relative paths.
            finished: True for a finished run, whose tables need not exist any more.

        Raises:
            SceneError: a value is not allowed; each line has the path, the value and what is
                allowed.
        """
        try:
            scene = cls.model_validate(data, context={"folder": folder, "finished": finished})
        except ValidationError as error:
            raise SceneError(f"{source}:\n{describe(cls, error.errors())}") from error
        for key in ("file", "mapping"):
            file = getattr(scene.spray, key, None)
            if file is not None and folder is not None and not file.is_absolute():
                spray = scene.spray.model_copy(update={key: (folder / file).resolve()})
                scene = scene.model_copy(update={"spray": spray})
        return scene

    def to_yaml(self) -> str:
        """YAML with every default; `cldit.load_scene` reads it back unchanged from a file."""
        return dump_yaml(self.model_dump(mode="json"))

    def __repr__(self) -> str:
        columns, rows = self.camera.pixels
        backgrounds = ", ".join(f"{kelvin:g}" for kelvin in self.background.temperatures_K)
        return (
            f"<Scene {self.name!r}: spray {self.spray.model}, {columns} x {rows} pixels, "
            f"backgrounds {backgrounds} K, walls {self.walls.temperature_K:g} K>"
        )

    __str__ = __repr__

    def with_(self, **changes: Any) -> "Scene":
        """A scene with other values, checked again: `with_(**{"walls.temperature_K": 500})`.

        Args:
            changes: value of each path, such as `spray.plumes[2].mass_fraction`. A mapping
                replaces a whole section.

        Returns:
            The new scene.

        Raises:
            SceneError: a path or value is not allowed.
        """
        data = changed(self.model_dump(mode="json"), changes)
        return type(self).from_dict(data, source=self.name)

    @property
    def target_m(self) -> Point:
        """The point at the centre of the image."""
        return self.domain.centre_m if self.camera.target_m is None else self.camera.target_m

    @property
    def background_centre_m(self) -> Point:
        """Centre of the background disc."""
        if self.background.centre_m is not None:
            return self.background.centre_m
        x, y, z = self.domain.centre_m
        return (x, y + self.domain.edge_m / 2, z)


Section._scene_type = Scene
