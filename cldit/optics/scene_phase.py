"""The phase function of a scene's droplets, decided once for transport and wavelengths.

A new phase function is a name of `cldit.scene.transport.PhaseName` and a branch of `named_phase`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, assert_never

import numpy as np

from cldit.arrays import Floats
from cldit.errors import OpticsError
from cldit.scene.schema import Scene
from cldit.scene.transport import Phase
from cldit.spray.result import Spray

Cumulative = Callable[[Floats], Floats]


@dataclass(frozen=True, kw_only=True)
class ScenePhase:
    """Phase function with which the droplets of a scene scatter.

    name: for reports, with its parameters or the reason why it was chosen.
    asymmetry: mean cosine g of the scattering angle; None: by Mie's theory from the droplets.
    cumulative: share of the light that is scattered into cosines above given ones, any shape, up
        to a constant factor; None: isotropic, or by Mie's theory.
    """

    name: str
    asymmetry: float | None
    cumulative: Cumulative | None = None
    remarks: tuple[str, ...] = ()

    @property
    def mie(self) -> bool:
        """True if the phase function follows from the sizes of the droplets."""
        return self.asymmetry is None

    @property
    def isotropic(self) -> bool:
        """True if light is scattered into all directions alike."""
        return self.cumulative is None and not self.mie


def named_phase(phase: Phase) -> ScenePhase:
    """The phase function that a scene names in `transport.phase`."""
    if isinstance(phase, float):
        name = f"Henyey and Greenstein, g {phase:g}"
        return ScenePhase(name=name, asymmetry=phase, cumulative=henyey_greenstein(phase))
    if phase == "isotropic":
        return ScenePhase(name=phase, asymmetry=0.0)
    if phase == "mie":
        return ScenePhase(name=phase, asymmetry=None)
    assert_never(phase)


def scene_phase(scene: Scene, spray: Spray, preset: Literal["paper", "spectral"]) -> ScenePhase:
    """The phase function that a scene names, or that of the optical `preset` if it names none."""
    if scene.transport.phase is not None:
        return named_phase(scene.transport.phase)
    if preset == "paper":
        return ScenePhase(name="isotropic (preset paper)", asymmetry=0.0)
    if has_coefficients(spray):
        remark = (
            "droplets given as coefficients, without diameters, are taken to scatter "
            "isotropically; set transport.phase to the g of Henyey and Greenstein if it is known"
        )
        return ScenePhase(name="isotropic (no diameters)", asymmetry=0.0, remarks=(remark,))
    if scene.transport.method == "branching":
        remark = "method branching scatters isotropically, whatever the preset"
        return ScenePhase(name="isotropic (method branching)", asymmetry=0.0, remarks=(remark,))
    return ScenePhase(name="mie (preset spectral)", asymmetry=None)


def has_coefficients(spray: Spray) -> bool:
    """True if scattering is given by coefficients, without droplets."""
    prescribed = spray.prescribed
    return prescribed is not None and bool(np.any(prescribed.droplet_scattering_per_m > 0))


def henyey_greenstein(g: float) -> Cumulative:
    """The phase function of Henyey and Greenstein (Astrophys. J. 93, 1941) of asymmetry `g`."""
    if not -1 < g < 1:
        raise OpticsError(f"Henyey-Greenstein: g = {g:g} is outside -1..1 (both excluded)")

    def cumulative(cosine: Floats) -> Floats:
        if abs(g) < 1e-6:
            return (1 - cosine) / 2
        root = np.sqrt(1 + g * g - 2 * g * cosine)
        return np.asarray((1 - g * g) / (2 * g) * (1 / abs(1 - g) - 1 / root))

    return cumulative
