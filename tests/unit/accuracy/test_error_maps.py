"""Maps of the standard error: their RMS is what the run states, and they are kept."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cldit.accuracy.error_maps import error_maps
from cldit.run.stored_files import load_maps, save_maps


def found() -> tuple[dict[str, float | None], dict[str, np.ndarray], np.ndarray]:
    counted = np.ones((40, 30), bool)
    counted[:, :5] = False
    cells = np.abs(np.random.default_rng(1).normal(size=(40, 30)))
    cells[20:] *= 3.0
    cells[:10, :10] = np.nan
    errors = {"cells": 2.0, "wavelengths": 0.5, "gas grid": None}
    return errors, {"cells": cells}, counted


def test_rms_is_what_is_stated() -> None:
    errors, differences, counted = found()
    maps = error_maps(errors, differences, counted)
    assert set(maps) == {"cells", "total"}
    for name, stated in (("cells", 2.0), ("total", 4.25**0.5)):
        assert np.all(np.isnan(maps[name][~counted])) and np.all(maps[name][counted] > 0)
        rms = np.sqrt(np.mean(maps[name][counted].astype(float) ** 2))
        assert rms == pytest.approx(stated, rel=1e-5)
    assert np.nanmean(maps["cells"][25:]) > 2 * np.nanmean(maps["cells"][:15])


def test_more_pixels_than_those_of_the_rms() -> None:
    """Emissivity has a map in all pixels, and an RMS over the number of those with a T_app; sources
    without a map are in these alone."""
    errors, differences, counted = found()
    differences["cells"] = np.nan_to_num(differences["cells"])
    every = np.ones_like(counted)
    maps = error_maps(errors, differences, every, counted, local=("cells",))
    for name, stated in (("cells", 2.0), ("total", 4.25**0.5)):
        square = np.sum(maps[name].astype(float) ** 2) / np.count_nonzero(counted)
        assert square**0.5 == pytest.approx(stated, rel=1e-5)
    ratio = differences["cells"] / maps["cells"].clip(1e-30)
    assert np.ptp(ratio[maps["cells"] > 0]) < 1e-5 * ratio.max()  # local values are as they are


def test_far_from_drawn_pixels_the_nearest_count() -> None:
    """Drawn pixels are dense at an edge with errors, and few where there is nothing: in between
    are squares without any, whose error is not the image's mean."""
    counted = np.ones((200, 200), bool)
    difference = np.full(counted.shape, np.nan)
    difference[:, 90:110] = 1.0
    difference[::40, :30:15] = 0.0  # squares are 6 pixels wide
    total = error_maps({"cells": 2.0}, {"cells": difference}, counted)["total"]
    assert np.max(total[:, :30]) < 1e-3 * np.max(total[:, 95:105])


def test_no_pixel_no_map() -> None:
    errors, differences, counted = found()
    assert error_maps(errors, differences, np.zeros_like(counted)) == {}


def test_maps_are_kept(tmp_path: Path) -> None:
    maps = error_maps(*found())
    maps["gas grid"] = maps["cells"]
    save_maps(maps, tmp_path / "errors", pixel_m=(1e-3, 1e-3))
    again = load_maps(tmp_path / "errors")
    assert set(again) == set(maps)
    np.testing.assert_array_equal(again["gas grid"], maps["gas grid"])
    assert load_maps(tmp_path / "none") == {}
