"""The phase function of a scene: one decision for transport and for wavelengths."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
import pytest

from cldit.optics.scene_phase import henyey_greenstein, named_phase, scene_phase
from cldit.scene import Scene, load_scene
from cldit.scene.transport import PhaseName
from cldit.spray.result import Cells, Prescribed, Spray
from cldit.transport.trace import settings_for
from tests.phase_tables import henyey_greenstein as table_of

NAMES = get_args(PhaseName)
NAMED: tuple[Any, ...] = (*NAMES, -0.4)


def scene_of(**transport: Any) -> Scene:
    return load_scene("gdi-cone").with_(
        **{f"transport.{key}": one for key, one in transport.items()}
    )


def _named(phase: Any) -> tuple[str, float | None]:
    found = named_phase(phase)
    return found.name, found.asymmetry


def test_what_a_scene_names_is_taken_whatever_its_preset() -> None:
    for phase in NAMED:
        for preset in ("paper", "spectral"):
            found = scene_phase(scene_of(phase=phase), Spray(), preset)
            assert (found.name, found.asymmetry) == _named(phase)
            assert found.mie == (phase == "mie") and found.remarks == ()


def test_presets() -> None:
    assert scene_phase(scene_of(), Spray(), "spectral").mie
    paper = scene_phase(scene_of(), Spray(), "paper")
    assert (paper.name, paper.asymmetry) == ("isotropic (preset paper)", 0.0)
    branching = scene_phase(scene_of(method="branching"), Spray(), "spectral")
    assert branching.asymmetry == 0.0 and "branching" in branching.remarks[0]


def test_coefficients_scatter_isotropically() -> None:
    none = np.zeros(1)
    box = Cells(np.zeros((1, 3)), np.ones((1, 3)))
    for scattering, mie in ((5.0, False), (0.0, True)):
        given = Prescribed(
            cells=box,
            vapour_absorption_per_m=none,
            droplet_absorption_per_m=none,
            droplet_scattering_per_m=none + scattering,
            vapour_temperature_K=none + 350.0,
            droplet_temperature_K=none + 350.0,
        )
        found = scene_phase(scene_of(), Spray(prescribed=given), "spectral")
        assert found.mie == mie and ("of Henyey" in str(found.remarks)) == (not mie)


@pytest.mark.parametrize(
    "phase", [*sorted(set(NAMES) - {"mie"}), *({"henyey_greenstein": g} for g in (-0.4, 0.8))]
)
def test_transport_and_wavelengths_scatter_alike(phase: Any) -> None:
    """The table that is traced has the g by which wavelengths are chosen, to its bins of 3 mrad;
    a table of Mie's theory, given as well, is of no account."""
    scene = scene_of(phase=phase)
    asymmetry = scene_phase(scene, Spray(), "spectral").asymmetry
    traced = settings_for(scene, table_of(0.3)).phase
    assert asymmetry is not None
    assert (0.0 if traced is None else traced.asymmetry) == pytest.approx(asymmetry, abs=1e-4)
    assert (traced is None) == (phase == "isotropic")


@pytest.mark.parametrize("phase", ["mie", None])
def test_the_table_of_the_droplets_is_traced(phase: str | None) -> None:
    table = table_of(0.3)
    assert settings_for(scene_of(phase=phase), table).phase is table
    assert settings_for(scene_of(phase=phase)).phase is None


def test_share_above_a_cosine() -> None:
    """0 above 1 and all above -1; half of g = 0 goes forward."""
    for g in (-0.5, 1e-9, 0.9):
        share = henyey_greenstein(g)(np.array([1.0, 0.0, -1.0]))
        assert share[0] == pytest.approx(0.0, abs=1e-12) and share[2] == pytest.approx(1.0)
        assert (share[1] > 0.5) == (g > 1e-8)
