"""Windows by measured curves do what a material of the same curves does, or are refused."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from cldit.errors import SceneError
from cldit.optics.windows import band_pane, window_shares
from cldit.scene.vessel import Window

FILTER_UM = (3.3, 3.5)


def test_curves_of_a_material_are_that_material() -> None:
    known = Window(side="front", material="CaF2", temperature_K=380.0)
    wavelengths = np.linspace(3.2, 3.6, 41)
    transmission, reflection = window_shares(known, wavelengths)
    given = Window(
        side="front",
        transmission=tuple(zip(wavelengths.tolist(), transmission.tolist(), strict=True)),
        reflection=tuple(zip(wavelengths.tolist(), reflection.tolist(), strict=True)),
    )
    one, other = (band_pane(each, FILTER_UM, reference_K=450.0) for each in (known, given))
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
        band_pane(short, FILTER_UM, reference_K=450.0)
