"""The budget is what an evaluation with another set-up gives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.dit.fit import Pair
from cldit.dit.recorded import evaluate_shots
from cldit.dit.witness.examine import stated as stated_drifts
from cldit.io.images import read_image
from cldit.radiance.boundary import Surroundings, Uncertainty
from tests.laboratory import AROUND, FILTER_UM, laboratory


def _warmer_window(surroundings: Surroundings) -> Surroundings:
    front, rear = surroundings.windows
    return replace(
        surroundings,
        windows=(front, rear.model_copy(update={"temperature_K": rear.temperature_K + 5})),
    )


@pytest.mark.parametrize(
    ("part", "change"),
    [
        ("background emissivity", lambda around: replace(around, background_emissivity=0.94)),
        ("walls", lambda around: replace(around, wall_temperature_K=416.0)),
        ("rear window by", _warmer_window),
    ],
)
def test_parts_are_what_another_set_up_gives(
    part: str, change: Callable[[Surroundings], Surroundings]
) -> None:
    """The same shots, evaluated with what the part says: T_app moves by it, in every pixel.

    The change is linear in x, so that only the weights of the backgrounds differ, by 1 %; 2 % of
    the part and 1 mK of float32 are allowed. The emissivity does not move.
    """
    shots = laboratory(1, shape=(24, 40))
    shots.recorded.surroundings = replace(AROUND, uncertainty=Uncertainty(window_temperature_K=5.0))
    stated = evaluate_shots(shots.recorded)
    assert stated.budget is not None
    (item,) = (candidate for candidate in stated.budget.parts if candidate.name.startswith(part))
    shots.recorded.surroundings = change(AROUND)
    changed = evaluate_shots(shots.recorded)
    compared = np.isfinite(stated.maps.apparent_temperature_K) & (shots.emissivity > 0.1)
    moved = (changed.maps.apparent_temperature_K - stated.maps.apparent_temperature_K)[compared]
    np.testing.assert_allclose(moved, item.kelvin[compared], rtol=0.02, atol=2e-3)
    emissivity_change = changed.maps.emissivity - stated.maps.emissivity
    np.testing.assert_allclose(emissivity_change[compared], item.emissivity[compared], atol=1e-5)


def test_a_filter_beside_the_stated_one() -> None:
    """0.002 um: so little that the witnesses leave the weights alone.

    The spray's line has other weights than the references', by its own noise: 5 % of the part in
    the mean over the dense pixels.
    """
    shots = laboratory(2, shape=(24, 40), scatter=0.0)
    shots.recorded.surroundings = replace(AROUND, uncertainty=Uncertainty(filter_um=0.002))
    stated = evaluate_shots(shots.recorded)
    assert stated.budget is not None
    (item,) = (
        candidate for candidate in stated.budget.parts if candidate.name.startswith("filter")
    )
    low, high = FILTER_UM
    stretch = 1.0 + 0.002 / (0.5 * (low + high))
    shots.recorded.calibration["filter_um"] = [low * stretch, high * stretch]
    changed = evaluate_shots(shots.recorded)
    dense = shots.emissivity > 0.3
    moved = changed.maps.apparent_temperature_K - stated.maps.apparent_temperature_K
    assert np.nanmean(moved[dense]) == pytest.approx(
        float(np.nanmean(item.kelvin[dense])), rel=0.05
    )


def test_a_front_window_drops_out_and_the_total_is_the_root_of_squares(tmp_path: Path) -> None:
    shots = laboratory(3, shape=(24, 40))
    evaluation = evaluate_shots(shots.recorded)
    budget = evaluation.budget
    assert budget is not None
    for item in budget.parts:
        if item.name.startswith("front"):
            assert np.nanmax(np.abs(item.kelvin)) < 1e-6
    squares = evaluation.maps.apparent_temperature_standard_error_K.astype(float) ** 2
    squares += sum(item.kelvin**2 for item in budget.parts)
    np.testing.assert_allclose(budget.total_K, np.sqrt(squares), rtol=1e-6)
    budget.save(tmp_path, pixel_m=(1e-4, 1e-4))
    for name, image in (
        ("apparent_temperature_systematic_error_K", budget.kelvin),
        ("apparent_temperature_total_error_K", budget.total_K),
        ("emissivity_systematic_error", budget.emissivity),
        ("emissivity_total_error", budget.total_emissivity),
    ):
        np.testing.assert_allclose(read_image(tmp_path / f"{name}.tif")[0], image, rtol=1e-6)
    names = [line.split(":")[0].strip() for line in budget.lines[1:]]
    assert names[0].startswith("statistical") and names[-1] == "total"
    assert list(budget.to_dict()) == names


def test_readings_of_either_kind_have_errors_of_their_own() -> None:
    """A shared error cancels in front of a transparent spray; two readings do not.

    Variances of 0.01 and 0.04 K^2 at 2 radiances per kelvin, with lines of slopes 1 and 0.9.
    """
    variances_K2: dict[str, float] = {"reference": 0.01, "injection": 0.04}
    groups: dict[Any, Any] = {
        (kelvin, kind): SimpleNamespace(temperature_K=kelvin, temperature_variance_K2=variance)
        for kelvin in (400.0, 500.0)
        for kind, variance in variances_K2.items()
    }
    camera: Any = SimpleNamespace(counts_per_radiance=1.0)
    front = SimpleNamespace(transmission=1.0)
    boundary: Any = SimpleNamespace(leaving=lambda kelvin: 2.0 * np.asarray(kelvin), front=front)
    around = replace(
        AROUND, background_error_K=0.0, camera_offset_error_counts=0.0, camera_gain_error=0.0
    )
    drifts = stated_drifts(
        groups, [400.0, 500.0], boundary=boundary, surroundings=around, calibration=camera
    )
    lines = Pair(np.array([[1.0, 0.0, 0.9, 10.0]]), np.zeros((1, 4, 4)), np.zeros(1))
    nothing = np.zeros((2, 1)), np.zeros((2, 1))
    changes = [
        [float(error.variance[0] ** 0.5 * part[0]) for part in error.factors(lines, nothing)]
        for error in drifts
    ]
    assert changes == [pytest.approx([0.2, 0.0]), pytest.approx([0.0, 0.36])]


def test_a_defective_pixel_has_no_errors() -> None:
    """Neither those that it shares with all pixels, which its values do not tell."""
    made = laboratory(7, drifts=None)
    made.recorded.bad_pixels = np.zeros(made.emissivity.shape, bool)
    made.recorded.bad_pixels[5, 7] = True
    budget = evaluate_shots(made.recorded).budget
    assert budget is not None and budget.parts and budget.common
    for part in (*budget.parts, *budget.common):
        assert np.isnan(part.kelvin[5, 7]) and np.isnan(part.emissivity[5, 7])
        assert np.isfinite(part.emissivity[5, 8])
