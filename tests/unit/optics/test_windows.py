"""Windows: published transmission, Fresnel sums in two independent forms, energy closure."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from cldit.errors import SceneError
from cldit.optics.windows import MATERIALS, band_pane, slab, window_shares
from cldit.scene.vessel import Window


def window(material: str = "CaF2", **keys: float) -> Window:
    return Window.model_validate(
        {"side": "front", "material": material, "temperature_K": 297.0, **keys}
    )


@pytest.mark.parametrize(
    # CaF2: computed from Malitson's n and Crystran's k, 5 and 10 mm, uncoated, four digits.
    ("wavelength_um", "thickness_m", "transmission"),
    [
        (2.0, 0.005, 0.9404),
        (2.0, 0.010, 0.9401),
        (3.4, 0.005, 0.9427),
        (3.4, 0.010, 0.9427),
        (5.0, 0.005, 0.9453),
        (5.5, 0.005, 0.9465),
        (5.5, 0.010, 0.9455),
        (5.6, 0.010, 0.9456),
    ],
)
def test_calcium_fluoride_as_published(
    wavelength_um: float, thickness_m: float, transmission: float
) -> None:
    got, _ = window_shares(window(thickness_m=thickness_m), wavelength_um)
    assert float(got) == pytest.approx(transmission, abs=1.5e-4)


def test_sapphire_as_published() -> None:
    """n of the ordinary ray (Malitson and Dodge) to five digits; 0.92 / cm at 5 um."""
    sapphire = MATERIALS["sapphire"]
    assert float(sapphire.index(2.0, 293.0)) == pytest.approx(1.73769, abs=1e-5)
    assert float(sapphire.index(3.4, 293.0)) == pytest.approx(1.69893, abs=1e-5)
    per_cm = 4 * np.pi * float(sapphire.extinction(np.array(5.0))) / 5e-4
    assert per_cm == pytest.approx(0.92, rel=0.01)


@pytest.mark.parametrize(
    ("n", "k"), [(1.4, 0.0), (1.7, 1e-5), (2.5, 1e-4), (4.0, 1e-3), (1.5, 1e-2)]
)
def test_against_counting_passages(n: float, k: float) -> None:
    """Every reflection followed one by one, until nothing is left."""
    surface = abs((complex(n, -k) - 1) / (complex(n, -k) + 1)) ** 2
    a = np.exp(-4 * np.pi * k * 1e-3 / 4e-6)
    transmitted, reflected, inside = 0.0, surface, (1 - surface) * a
    for passage in range(500):
        if passage % 2 == 0:
            transmitted += inside * (1 - surface)
        else:
            reflected += inside * (1 - surface)
        inside *= surface * a
    got = slab(n, k, wavelength_um=4.0, thickness_m=1e-3)
    assert got[0] == pytest.approx(transmitted, rel=1e-12)
    assert got[1] == pytest.approx(reflected, rel=1e-12)


@pytest.mark.parametrize("material", ["CaF2", "sapphire"])
@pytest.mark.parametrize("thickness_m", [1e-5, 0.01, 0.2])
@pytest.mark.parametrize("filter_um", [(3.3, 3.5), (2.0, 5.0), (4.99, 5.0)])
def test_energy(material: str, thickness_m: float, filter_um: tuple[float, float]) -> None:
    pane = band_pane(window(material, thickness_m=thickness_m), filter_um, reference_K=450.0)
    assert 0 < pane.transmission < 1 and 0 < pane.reflection < 1 and pane.emission >= 0
    assert pane.transmission + pane.reflection + pane.emission == pytest.approx(1.0, abs=1e-12)


def test_index_moves_with_temperature() -> None:
    """Less reflection from a hot CaF2 window, more from a hot sapphire one; 4e-4 for 150 K."""
    for material, sign in (("CaF2", 1.0), ("sapphire", -1.0)):
        cold, hot = (
            float(window_shares(window(material, temperature_K=kelvin), 3.4)[0])
            for kelvin in (300.0, 450.0)
        )
        assert 5e-5 < sign * (hot - cold) < 1e-3


@pytest.mark.parametrize(
    ("material", "filter_um"), [("CaF2", (5.0, 6.0)), ("sapphire", (1.0, 2.5))]
)
def test_beyond_the_data(material: str, filter_um: tuple[float, float]) -> None:
    with pytest.raises(SceneError, match=f"windows: {material} is known from"):
        band_pane(window(material), filter_um, reference_K=450.0)


def test_curves_of_a_material_are_that_material() -> None:
    known = Window(side="front", material="CaF2", temperature_K=380.0)
    wavelengths = np.linspace(3.2, 3.6, 41)
    transmission, reflection = window_shares(known, wavelengths)
    given = Window(
        side="front",
        transmission=tuple(zip(wavelengths.tolist(), transmission.tolist(), strict=True)),
        reflection=tuple(zip(wavelengths.tolist(), reflection.tolist(), strict=True)),
    )
    one, other = (band_pane(each, (3.3, 3.5), reference_K=450.0) for each in (known, given))
    # straight lines over 10 nm of curves that bend by less than 1e-3 in a micrometre
    assert other.transmission == pytest.approx(one.transmission, abs=1e-6)
    assert other.emission == pytest.approx(one.emission, abs=1e-6)


def test_what_is_no_window_is_named() -> None:
    flat, low = ((3.0, 0.7), (4.0, 0.7)), ((3.4, 0.2), (4.0, 0.2))
    for more in ({}, {"transmission": flat}, {"material": "CaF2", "transmission": flat}):
        with pytest.raises(ValidationError, match="allowed: a material, or both"):
            Window.model_validate({"side": "front", **more})
    with pytest.raises(ValidationError, match=r"add up to 1\.400"):
        Window(side="front", transmission=flat, reflection=flat)
    short = Window(side="rear", transmission=flat, reflection=low)
    with pytest.raises(SceneError, match=r"reflection of the rear window is given from 3\.4 to 4"):
        band_pane(short, (3.3, 3.5), reference_K=450.0)
