"""Patches of the enclosure: each has its weight, from every method, and what it replaces loses it.

Rationale: a patch is a part of the boundary by another name. Where it takes over all of the walls,
or of the background, it takes over its weight too; and the cavity at one temperature stays flat.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cldit
from cldit.api.experiment import run_experiment
from cldit.errors import SceneError, TransportError
from cldit.gpu.device import Device
from cldit.optics.planck import band_radiance
from cldit.optics.response import scene_filter
from cldit.run import Run, open_run
from tests.verify.blocks import compared
from tests.verify.cavity import EDGE_M as EDGE
from tests.verify.cavity import T_K as T
from tests.verify.cavity import cavity, departure


def window(name: str = "window", **changes: Any) -> dict[str, Any]:
    """On the face towards +x, seen by the medium alone."""
    data = {
        "name": name,
        "centre_m": [EDGE / 2, 0.0, 0.0],
        "facing": "-x",
        "radius_m": 0.08,
        "temperature_K": T,
    }
    return {key: value for key, value in {**data, **changes}.items() if value is not None}


def block(
    run_block: Callable[..., Run],
    patches: list[dict[str, Any]],
    *,
    depth: float = 0.5,
    **scene: Any,
) -> Run:
    """In a cavity at one temperature, with a disc behind it."""
    usual = {
        "camera": {"pixels": 13, "field_m": [0.15, 0.15]},
        "background": {"temperatures_K": [T, T + 20], "radius_m": 0.03},
    }
    return cavity(
        run_block, depth=depth, albedo=0.7, vapour=0.1, droplets=0.2, size_m=(EDGE / 2,) * 3,
        patches=patches, **{**usual, **scene},
    )  # fmt: skip


@pytest.mark.parametrize(
    "transport",
    [pytest.param({}, marks=pytest.mark.slow), {"phase": {"henyey_greenstein": 0.7}}],
)
def test_a_window_takes_its_share_from_the_walls(
    run_block: Callable[..., Run], transport: dict[str, Any]
) -> None:
    """Same directions with and without: equal to rounding, sum by sum."""
    # Enough for the one side to be the other's mirror; chains would go on elsewhere in either.
    transport = {"directions": 96, "gather": False, "accuracy_K": 1e-3, **transport}
    plain = block(run_block, [], transport=transport)
    run = block(run_block, [window(), window("other", facing="+x", centre_m=[-0.1, 0, 0])],
                transport=transport)  # fmt: skip
    w = run.weights
    assert set(w.patches) == {"window", "other"}
    assert not plain.weights.patches
    for image in w.patches.values():
        assert 0.01 < image.max() < 0.5
    np.testing.assert_allclose(w.background, plain.weights.background, atol=2e-6)
    np.testing.assert_allclose(w.wall + sum(w.patches.values()), plain.weights.wall, atol=4e-6)
    # Facing windows before a cube lit from both sides: the picture's left is the other's right.
    left, right = w.patches["other"][:, :6].mean(), w.patches["window"][:, -6:].mean()
    assert left == pytest.approx(right, rel=0.1)
    assert left > 1.5 * w.patches["other"][:, -6:].mean()
    np.testing.assert_allclose(departure(run), 0.0, atol=1e-5)
    assert run.info.defines["sweep.cl"]["N_PATCHES"] == 2
    assert "N_PATCHES" not in plain.info.defines["sweep.cl"]


@pytest.mark.slow
def test_a_patch_as_background(run_block: Callable[..., Run]) -> None:
    """A patch of the disc's place and size, before it, is seen as the disc was, and it alone."""
    disc = {"centre_m": [0, 0.1, 0], "facing": "-y", "radius_m": 0.03}
    many = {"directions": 96, "gather": False}
    plain = block(run_block, [], transport=many)
    behind: dict[str, Any] = {"background": {"radius_m": 0.03, "centre_m": [0, 0.1001, 0]}}
    run = block(run_block, [window("plate", **disc)], **behind, transport=many)
    np.testing.assert_allclose(run.weights.patches["plate"], plain.weights.background, atol=5e-3)
    assert run.weights.background.max() < 5e-3  # a sliver of 0.1 mm
    # In one plane the background is seen, and of patches the first.
    run = block(run_block, [window("plate", **disc), window("again", **disc)], transport=many)
    np.testing.assert_array_equal(run.weights.background, plain.weights.background)
    assert not run.weights.patches["plate"].any()


@pytest.mark.slow
def test_thick_cells_see_the_patches(run_block: Callable[..., Run]) -> None:
    """Chains through thick cells end in patches too, and every pixel closes. A patch's weight of
    0.02 scatters by 0.14 from chain to chain: by 10 % of it over 64 chains, the fewest, in 81
    pixels; twice that."""
    patches = [window(), window("other", facing="+x", centre_m=[-0.1, 0, 0])]
    gathered = block(run_block, patches, depth=0.7, transport={"directions": 96})
    truth = block(run_block, patches, depth=0.7, transport={"method": "path", "max_samples": 1024})
    assert gathered.info.counts["samples"] >= 64
    np.testing.assert_allclose(departure(gathered), 0.0, atol=2e-5)
    for name, image in gathered.weights.patches.items():
        assert image.mean() == pytest.approx(truth.weights.patches[name].mean(), rel=0.2)


@pytest.mark.parametrize("method", [pytest.param("path", marks=pytest.mark.slow), "branching"])
def test_methods_agree(run_block: Callable[..., Run], method: str) -> None:
    """Order 1, a rectangle that is seen directly and one that is not; noise from two seeds each."""
    patches = [
        window("flange", shape="rectangle", centre_m=[0.05, 0.1, 0.02], facing="-y",
               size_m=[0.06, 0.04], radius_m=None),
        window(),
    ]  # fmt: skip
    camera = {"pixels": 8, "field_m": [0.15, 0.15]}
    common = {"order": 1, "accuracy_K": 1.0}
    runs = {
        way: [
            block(
                run_block,
                patches,
                depth=0.1,
                camera=camera,
                transport={**common, "method": way, "seed": seed, "directions": directions},
            )
            for seed in (1, 2)
        ]
        for way, directions in (("source", 512), (method, None))
    }
    for name in ("background", "wall", "flange", "window"):
        difference, noise = compared(runs["source"], runs[method], name)
        # 2e-3: cells of optical depth 0.1 are taken at one value by `source`.
        assert np.mean(difference**2) < 4 * noise + 2e-3**2, name
    direct = runs[method][0].weights.patches["flange"]
    assert direct.max() > 0.9 and direct.min() < 0.1


def test_an_empty_vessel(device: Device, tmp_path: Path) -> None:
    """What the camera sees is where the patch is, to the pixel; and none of it from behind."""
    data = {
        "name": "empty vessel",
        "spray": {"model": "none"},
        "camera": {"model": "orthographic", "pixels": 40, "field_m": [0.16, 0.16]},
        "background": {"radius_m": 0.03},
        "patches": [
            window("low", shape="rectangle", centre_m=[-0.04, 0.1, -0.05], facing="-y",
                   radius_m=None, size_m=[0.04, 0.02]),
            window("turned", centre_m=[0.05, 0.1, 0.05], facing=[0.6, -0.8, 0], radius_m=0.0201),
            window("back", centre_m=[0, -0.1, 0], facing="+y"),
        ],
    }  # fmt: skip
    weights = cldit.simulate(cldit.Scene.from_dict(data), device=device).weights
    at = (np.arange(40) + 0.5) * 0.004 - 0.08
    x, z = at[None, :], -at[:, None]
    low = (np.abs(x + 0.04) < 0.02) & (np.abs(z + 0.05) < 0.01)
    np.testing.assert_array_equal(weights.patches["low"], low)
    turned = ((x - 0.05) / 0.8) ** 2 + (z - 0.05) ** 2 < 0.0201**2
    np.testing.assert_array_equal(weights.patches["turned"], turned)
    assert not weights.patches["back"].any()


@pytest.mark.slow
def test_a_run_with_a_cold_window_end_to_end(
    run_block: Callable[..., Run], device: Device, tmp_path: Path
) -> None:
    """The window's radiance is in references and injections; files, bench, report hold it.

    With a window at the walls' temperature, the apparent temperature is that of a run without;
    with a colder one it is lower where the spray scatters the window's light.
    """
    base = block(run_block, []).scene.model_dump(mode="json")
    base["camera"]["sensor"]["pixels"] = [13, 13]
    base["plan"] = {"shots": 1, "references": 1}
    seen = {}
    for name, kelvin in (("same", T), ("cold", 295.0)):
        data = {**base, "name": name, "patches": [window(temperature_K=kelvin)]}
        start = run_experiment if name == "cold" else cldit.simulate
        seen[name] = start(cldit.Scene.from_dict(data), tmp_path / name, device=device)
    plain = block(run_block, [])
    middle = (6, 6)
    same, cold = (seen[name].maps.apparent_temperature_K[middle] for name in ("same", "cold"))
    assert same == pytest.approx(plain.maps.apparent_temperature_K[middle], abs=0.02)
    # First order: the intercept loses w (B(450) - B(295)) of some B(450) emissivity.
    filter_um = scene_filter(plain.scene)
    hot, low = (float(band_radiance(kelvin, filter_um=filter_um)) for kelvin in (T, 295.0))
    lost = seen["cold"].weights.patches["window"][middle] * (hot - low)
    emissivity = 1 - plain.weights.background[middle]
    assert band_radiance(cold, filter_um=filter_um) == pytest.approx(
        float(band_radiance(same, filter_um=filter_um)) - lost / emissivity, rel=1e-3
    )
    measured = seen["cold"].measured
    assert measured is not None
    assert measured.apparent_temperature_K[middle] == pytest.approx(cold, abs=5.0)
    again = open_run(tmp_path / "cold")
    np.testing.assert_array_equal(
        again.weights.patches["window"], seen["cold"].weights.patches["window"]
    )
    assert (tmp_path / "cold" / "weights" / "window.tif").is_file()
    assert "window" in (tmp_path / "cold" / "report.html").read_text(encoding="utf-8")


def test_a_patch_in_the_spray_is_refused(run_block: Callable[..., Run]) -> None:
    with pytest.raises(TransportError, match=r"patches\.window: its plane cuts .* in front of it"):
        block(run_block, [window(centre_m=[0.02, 0, 0])])


@pytest.mark.parametrize(
    ("patches", "message"),
    [
        ([window("wall")], "the name wall is used more than once"),
        ([window(), window()], "the name window is used more than once"),
        ([window("Big one")], r"patches\[0\]\.name"),
        ([window(radius_m=None)], "neither of radius_m and size_m; allowed: one of them"),
        ([window(shape="rectangle")], r"patches\[0\]\.shape: unknown key"),
        ([window(facing=[0, 0, 0])], "has no length"),
        ([window(f"w{n}") for n in range(17)], "17 patches; allowed: 0..16"),
    ],
)
def test_what_is_not_allowed(patches: list[dict[str, Any]], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        cldit.Scene.from_dict({"name": "x", "spray": {"model": "none"}, "patches": patches})
