"""What a scene is: frozen data with a range, a unit and a default for every key.

The defaults are the paper's numbers where it gives them (Section "Ray Tracing")."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, ValidationError

from cldit.errors import SceneError
from cldit.scene.camera import Camera
from cldit.scene.change import changed
from cldit.scene.checks import Section, describe
from cldit.scene.optics import Optics
from cldit.scene.rig import PlanSize, Rig
from cldit.scene.spray import Spray
from cldit.scene.transport import Transport
from cldit.scene.values import Point
from cldit.scene.vessel import Background, Domain, Patches, Walls, Windows


class Scene(Section):
    """Everything a run needs; `cldit.load_scene` reads it from YAML."""

    name: Annotated[str, Field(min_length=1, max_length=100)]
    """Names the run's folder and pictures."""
    description: str = ""
    """Shown in lists and reports."""
    domain: Domain = Domain()
    """The cube that is traced."""
    spray: Spray
    """What is between camera and background."""
    camera: Camera = Camera()
    """Where it stands and what it records."""
    background: Background = Background()
    """The black body, or whatever is behind the spray."""
    walls: Walls = Walls()
    """The rest of the enclosure."""
    patches: Patches = ()
    """Windows, flanges: pieces of the enclosure with a temperature and a weight of their own, at
    most 16."""
    windows: Windows = ()
    """Windows before the camera and before the background, one each."""
    optics: Optics = Optics()
    """What light is counted, and what matter does to it."""
    transport: Transport = Transport()
    """How the equation of transfer is solved."""
    rig: Rig = Rig()
    """The simulated instruments."""
    plan: PlanSize = PlanSize()
    """How much is recorded."""

    @classmethod
    def checked(
        cls, data: dict[str, Any], *, source: str, folder: Path | None, finished: bool
    ) -> Scene:
        """A scene from plain data; `cldit.scene.parse_scene` also resolves its paths.

        Args:
            data, source, folder, finished: as in `parse_scene`.

        Raises:
            SceneError: something is not allowed; each line names the path, the value and what is.
        """
        try:
            return cls.model_validate(data, context={"folder": folder, "finished": finished})
        except ValidationError as error:
            raise SceneError(f"{source}:\n{describe(cls, error.errors())}") from error

    def with_(self, **changes: Any) -> Scene:
        """The scene with other values, checked again, as `with_(**{"walls.temperature_K": 500})`.

        Args:
            changes: value of each path; names are joined with dots, `[i]` counts in lists. A
                mapping replaces a whole section.

        Returns:
            Another scene.

        Raises:
            SceneError: a path or value is not allowed.
        """
        data = changed(self.model_dump(mode="json"), changes)
        return type(self).checked(data, source=self.name, folder=None, finished=False)

    @property
    def target_m(self) -> Point:
        """The point in the middle of the picture."""
        return self.domain.centre_m if self.camera.target_m is None else self.camera.target_m

    @property
    def background_centre_m(self) -> Point:
        """The middle of the background disc."""
        if self.background.centre_m is not None:
            return self.background.centre_m
        x, y, z = self.domain.centre_m
        return (x, y + self.domain.edge_m / 2, z)
