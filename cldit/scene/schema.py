"""What a scene is: frozen data with a range, a unit and a default for every key.

The defaults are the paper's numbers where it gives them (Section "Ray Tracing")."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cldit.scene.camera import Camera
from cldit.scene.checks import Section
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
