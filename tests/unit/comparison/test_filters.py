"""Several filters, each with a test of its own, in one verdict."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.stats import kstest

from cldit.cli import main
from cldit.comparison import Shown, compare
from cldit.dit.budget import Part, common_parts
from cldit.dit.maps import Maps
from cldit.errors import EvaluationError

SHAPE = (24, 24)
BANDS = {"fuel": (3.3, 3.5), "droplets": (3.9, 4.0)}
WRITTEN = Path(__file__).parents[2] / "data" / "run-0.1.0"


def campaign(rng: np.random.Generator | None, *, thicker: float = 0.0) -> dict[str, Shown]:
    """Results of both filters: noise of 0.5 K and 0.01, and amounts that scatter by 0.02.

    The extinction changes by the amount, and is larger by `thicker`. No rng: without noise.
    """

    def image(size: float) -> Any:
        return np.zeros(SHAPE) if rng is None else size * rng.standard_normal(SHAPE)

    results = {}
    for name, edges_um in BANDS.items():
        amount = 0.0 if rng is None else 0.02 * rng.standard_normal()
        emissivity = np.linspace(0.1, 0.6, SHAPE[0])[:, None] * (1.0 + amount) + image(0.01)
        emissivity += thicker if name == "droplets" else 0.0
        kelvin, size = 450.0 + image(0.5), np.linspace(0.1, 0.6, SHAPE[0])[:, None] * 0.02
        error = np.hypot(0.01, size) + np.zeros(SHAPE)
        part = Part(name="common error 1", kelvin=np.zeros(SHAPE), emissivity=size + 0.0 * kelvin)
        values = (emissivity, kelvin, error, np.full(SHAPE, 0.5), 0.0, kelvin, kelvin, kelvin)
        images: list[Any] = [np.full(SHAPE, value, np.float32) for value in values]
        images[4] = images[4].astype(np.uint8)
        maps = Maps(*images)
        results[name] = Shown(
            name=name, maps=maps, pixel_m=(1e-3, 1e-3), centre_m=(0.0, -10e-3), noisy=True,
            error_K=0.5, error_map_K=np.full(SHAPE, 0.5), emissivity_error=0.02,
            emissivity_error_map=error, common=(part,), filter_um=edges_um,
        )  # fmt: skip
    return results


def test_p_of_both_filters_is_uniform_and_the_thicker_one_is_named() -> None:
    """Of 60 equal pairs 0.6 differ at 1 %, at most 4 with a probability of 99.97 %.

    Extinction larger by 0.02 is 0.02 / (2^0.5 0.01 / 24) = 34 errors of the noise's mean, less what
    the amount's pattern takes up: its mean square of 0.14 is 0.12 by the mean, so a sixth is left.
    """
    rng = np.random.default_rng(1)
    equal = [
        compare(campaign(rng), campaign(rng), extinction=["droplets"]).results[0] for _ in range(60)
    ]
    assert kstest([result.p_value for result in equal], "uniform").pvalue > 1e-3
    assert sum(not result.within for result in equal) <= 4
    found = compare(campaign(rng), campaign(rng, thicker=0.02), extinction=["droplets"])
    assert found.differs and "differs in droplets (p " in found.verdict
    assert found.verdict.endswith("by 2 filters")
    extinction = found.results[0].by_filter["droplets"]
    assert (
        extinction.verdict.text.count(" emissivity ") == 1 and " K" not in extinction.verdict.text
    )
    assert extinction.to_dict()["regions"]["all"]["mean_emissivity"] == pytest.approx(
        0.02, abs=0.02
    )
    assert not compare(campaign(rng), campaign(rng, thicker=0.02)).differs  # T_app alone


def test_each_filter_has_its_share_of_the_level() -> None:
    """p of 0.007 in one of two filters is 0.014 by both: no difference at 1 %."""
    pair = compare(campaign(None), campaign(np.random.default_rng(3))).results[0]
    single = replace(pair.by_filter["fuel"], filters=1)
    region = replace(single.regions["all"], p_value=0.007)
    single = replace(single, regions={**single.regions, "all": region})
    shared = replace(single, filters=2)
    assert not single.within and shared.within
    assert shared.level == pytest.approx(1.0 - 0.99**0.5)
    both = replace(pair, by_filter={**pair.by_filter, "fuel": shared})
    assert both.p_value == pytest.approx(1.0 - 0.993**2)


def test_filters_that_differ_are_refused() -> None:
    one = campaign(None)
    with pytest.raises(EvaluationError, match=r"filters: .* has fuel, droplets; .* has fuel; allo"):
        compare(one, {"fuel": one["fuel"]})
    with pytest.raises(EvaluationError, match="fuel has one without a name; allowed: the same for"):
        compare(one, one["fuel"])
    with pytest.raises(EvaluationError, match=r"extinction: co2; allowed: fuel, droplets"):
        compare(one, one, extinction=["co2"])
    with pytest.raises(EvaluationError, match=r"3.3 to 3.5 um, droplets has 3.9 to 4 um"):
        compare(one, {"fuel": one["droplets"], "droplets": one["droplets"]})


def test_the_command_names_filters() -> None:
    """A run twice, under two names, is the same in both."""
    both = f"fuel={WRITTEN},droplets={WRITTEN}"
    given = ["compare", both, both, "--extinction", "droplets"]
    result = CliRunner().invoke(main, given)
    assert result.exit_code == 0, result.output
    assert result.output.count("the same in every pixel") == 2
    assert CliRunner().invoke(main, [*given, "--extinction", "co2"]).exit_code == 1


def test_a_common_error_of_the_emissivity_alone_is_kept() -> None:
    """The amount of spray does not change T_app; it is no noise of single pixels, though."""
    maps = campaign(None)["fuel"].maps
    nothing, size = np.zeros((1, *SHAPE)), np.full((1, *SHAPE), 0.02)
    (kept,) = common_parts(maps, nothing, size)
    assert np.abs(kept.emissivity) == pytest.approx(0.02)
    assert common_parts(maps, nothing, 1e-4 * size) == ()
