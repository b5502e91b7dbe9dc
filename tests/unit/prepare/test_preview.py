"""Pixels with a T_app, as the wavelengths of a filter show them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cldit.gpu.device import Device
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.prepare.medium import prepare
from cldit.prepare.preview import as_many, previewed, visible_emissivities
from cldit.prepare.stages import Stages
from cldit.scene import load_scene


@pytest.mark.slow
def test_each_wavelength_shows_the_pixels_of_the_filter(device: Device, tmp_path: Path) -> None:
    """Lines of methane absorb a hundredfold: the faintest reach 0.05 in half of the pixels."""
    scene = load_scene("methane-jet").with_(
        **{"camera.pixels": [60, 60], "spray.box.spacing_m": 2e-3, "optics.wavelengths": 4}
    )
    prepared = prepare(scene, device, Stages(print), tmp_path)
    each, filtered = previewed(prepared)
    before = np.all(each < 1.0, axis=0)  # the background
    each, filtered = each[:, before], filtered[before]
    count = int(np.count_nonzero(filtered > VISIBLE_EMISSIVITY))
    assert np.count_nonzero(each > VISIBLE_EMISSIVITY, axis=1).min() < 0.6 * count
    chosen = prepared.properties.chosen
    light = [float(one.share(chosen.quadrature.reference_K)) for one in chosen.nodes]
    assert np.argmax(light * each.mean(axis=1)) == prepared.number  # not that of most light
    least = visible_emissivities(prepared)
    counts = [np.count_nonzero(one > bound) for one, bound in zip(each, least, strict=True)]
    assert counts == pytest.approx([count] * 4, abs=1)
    grey = prepare(scene.with_(**{"optics.wavelengths": 1}), device, Stages(print), tmp_path)
    assert visible_emissivities(grey) == (VISIBLE_EMISSIVITY,)


def test_values_that_as_many_exceed() -> None:
    """Half of the other's value at every rank; in proportion beyond its largest."""
    other = np.linspace(0.0, 1.0, 101)
    assert as_many(other[::-1] / 2, other, 0.3) == pytest.approx(0.15)
    assert as_many(other / 2, other, 3.0) == pytest.approx(1.5)
    assert as_many(np.zeros(3), np.zeros(3), 0.05) == 0.05
