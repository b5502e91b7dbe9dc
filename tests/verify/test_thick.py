"""Thick cells against `path`: deep ones, dark and lit from one side; others with gaps between."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cldit.gpu.device import Device
from cldit.run import Run, simulate
from cldit.scene import load_scene, parse_scene
from cldit.transport.discrete_ordinates.problem import SweepProblem
from cldit.transport.final_gather.cell_sources import records as made
from cldit.transport.thick_region import ThickRegion
from cldit.transport.tuning import Tuning

from .slab import half_space_emission, mean_radiance, run_slab

EDGE = 0.04
CELL = EDGE / 16
SCENE: dict[str, Any] = {
    "size_m": (6 * CELL, 4 * CELL, 6 * CELL),
    "domain": {"edge_m": EDGE, "leaf_edge_m": 1.01 * CELL},
    "camera": {"pixels": [12, 12], "field_m": [8 * CELL, 8 * CELL], "rays_per_pixel": 1},
    "background": {"radius_m": 0.03, "temperatures_K": [400.0, 500.0]},
}
BLOCK = {
    "droplet_absorption_per_m": 0.2 * 4 / CELL,
    "droplet_scattering_per_m": 0.8 * 4 / CELL,
    "droplet_temperature_K": 350.0,
}
PHASE = {"henyey_greenstein": 0.6}
NAMES = ("background", "wall")


def wall(run: Run) -> Any:
    """Weight of the wall where the block is seen."""
    return run.weights.wall[run.maps.emissivity > 0.5].astype(float)


@pytest.mark.slow
def test_gather_and_audit(run_block: Callable[..., Run]) -> None:
    """Without gather the wall's weight, some 0.1, is far too low: light that a thick cell sends
    straight back is lost in it. With it, what is left is noise and the simplified phase function of
    nothing at all, as every cell is thick: as near to `path` as two such runs are to each other.

    `path` with 1024 samples of standard deviation under 0.3: 0.01 a pixel, likewise the gather; the
    difference of both is at most 0.014 RMS.
    """
    truth = run_block(
        BLOCK,
        **SCENE,
        transport={"method": "path", "accuracy_K": 1e-3, "max_samples": 1024, "phase": PHASE},
    )
    changes = {
        "accuracy_K": 1e-3,
        "max_samples": 1024,
        "directions": 128,
        "phase": PHASE,
        "seed": 5,
    }
    changes["audit"] = True
    plain = run_block(BLOCK, **SCENE, transport={**changes, "gather": False})
    gathered = run_block(BLOCK, **SCENE, transport=changes)
    error = np.sqrt(np.mean((wall(plain) - wall(truth)) ** 2))
    left = np.sqrt(np.mean((wall(gathered) - wall(truth)) ** 2))
    assert error > 0.03
    assert left < 0.014
    kelvin = plain.maps.apparent_temperature_K - truth.maps.apparent_temperature_K
    kelvin = kelvin[np.isfinite(kelvin) & (truth.maps.emissivity > 0.05)].astype(float)
    true = float(np.sqrt(np.mean(kelvin**2)))
    # The audit is to first order in T_app, and adds its standard error.
    assert plain.info.accuracy_K is not None and gathered.info.accuracy_K is not None
    assert 0.7 * true < plain.info.accuracy_K < 1.5 * true
    assert gathered.info.accuracy_K < 0.4 * true


@pytest.mark.slow
@pytest.mark.parametrize("phase", ["isotropic", PHASE], ids=["isotropic", "forward"])
def test_gaps_between_thick_cells(run_block: Callable[..., Run], phase: Any) -> None:
    """Cells of optical depth 0.3 to 1.4, which send what a linear source tells, half of them left
    out: what stands beyond a gap shades a part of a cell.

    `path` with 1024 samples and flights as many: as above 0.01 each, 0.014 together; here light is
    scattered less and noise is half of that. A mean over 80 pixels has a ninth of it, and what sets
    of 256 directions leave, alike in all. With 1024 and sixteen times as many samples 0.0024 of the
    background's and -0.0028 of the wall's weight are left: light within cells is not linear. Even
    in cells it errs by 0.03 here and there.
    """
    rng = np.random.default_rng(11)
    depth = rng.uniform(0.3, 1.4, (6, 4, 6)) * (rng.random((6, 4, 6)) < 0.5)
    block = {
        "droplet_absorption_per_m": 0.3 * depth / CELL,
        "droplet_scattering_per_m": 0.7 * depth / CELL,
        "droplet_temperature_K": 350.0,
    }
    asked = {"accuracy_K": 1e-3, "max_samples": 1024, "phase": phase}
    truth = run_block(block, **SCENE, transport={"method": "path", **asked})
    found = run_block(block, **SCENE, transport={**asked, "directions": 128})
    even = run_block(block, **SCENE, transport={**asked, "directions": 128, "gather": False})
    seen = truth.maps.emissivity > 0.2
    left, error = (
        np.stack([run.weights.images[name] - truth.weights.images[name] for name in NAMES])
        for run in (found, even)
    )
    rms = np.sqrt(np.mean(left[:, seen].astype(float) ** 2, axis=1))
    assert np.all(rms < 0.012)
    assert np.all(np.abs(left[:, seen].mean(axis=1)) < 0.004)
    assert np.sqrt(np.mean(error[:, seen].astype(float) ** 2)) > 2.5 * np.sqrt(np.mean(rms**2))


@pytest.mark.slow
def test_audit_of_a_sample(run_block: Callable[..., Run], monkeypatch: pytest.MonkeyPatch) -> None:
    """A third of the pixels give the same error as all, within what a third may miss of it."""
    transport = {"directions": 32, "phase": PHASE, "audit": True, "gather": False}
    whole = run_block(BLOCK, **SCENE, transport=transport).info.accuracy_K
    monkeypatch.setattr("cldit.transport.trace.Tuning", lambda: Tuning(audit_pixels=30))
    part = run_block(BLOCK, **SCENE, transport=transport).info.accuracy_K
    assert whole is not None and part is not None
    assert 0.5 * whole < part < 2.0 * whole


@pytest.mark.slow
def test_audit_where_no_pixel_sees_the_spray(device: Device) -> None:
    """As `cldit bench` has it, which measures what a picture of nothing costs."""
    data = load_scene("droplets-only").model_dump(mode="json")
    data["camera"] |= {"pixels": [8, 8], "field_m": [0.01, 0.01], "target_m": [0.09, 0.0, 0.09]}
    data["domain"]["leaf_edge_m"] = 4e-3
    data["transport"]["phase"] = {"henyey_greenstein": 0.6}
    run = simulate(parse_scene(data), device=device)
    assert run.weights.liquid.max() == 0.0
    assert run.weights.wall.min() == 1.0


def test_what_cannot_be_audited_says_so(run_block: Callable[..., Run]) -> None:
    """Light that would be scattered a million times is not followed."""
    thick = {**BLOCK, "droplet_absorption_per_m": 0.0, "droplet_scattering_per_m": 1e9}
    run = run_block(thick, **SCENE, transport={"audit": True, "directions": 16})
    assert any("no audit by path tracing (light is scattered" in text for text in run.info.remarks)
    unwanted = run_block(BLOCK, **SCENE, transport={"audit": False, "directions": 16})
    reason = "no audit by path tracing (transport.audit: false)"
    assert any(reason in text for text in unwanted.info.remarks)
    for text in unwanted.info.remarks:
        if text.startswith("transport.audit: false: transport.accuracy_K applies to the trace"):
            continue
        assert "error of the trace in T_app: at least" in text or "audit" not in text


def test_chains_that_stop_short_say_so(
    run_block: Callable[..., Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the samples that are allowed, or by all chains of a picture; not where noise is wanted."""

    def short(**transport: Any) -> bool:
        run = run_block(BLOCK, **SCENE, transport={"directions": 16, **transport})
        return any("paths in thick cells: stopped" in text for text in run.info.remarks)

    assert short(accuracy_K=1e-3, max_samples=128)
    assert not short(accuracy_K=100.0)
    monkeypatch.setattr("cldit.transport.trace.Tuning", lambda: Tuning(paths=1e4))
    assert short(accuracy_K=1e-3, max_samples=10**6)


@pytest.mark.slow
@pytest.mark.parametrize(("precision", "phase"), [("float32", "isotropic"), ("float64", PHASE)])
def test_flights_one_by_one(
    run_block: Callable[..., Run], monkeypatch: pytest.MonkeyPatch, precision: str, phase: Any
) -> None:
    """As on GPUs, and eight at once: the same chains, whose sums differ by rounding alone. In
    single precision that turns a chance here and there, and a chain with it: of 128 in a pixel,
    which bring up to 1, one counts 0.008; nearly all pixels have none."""
    changes = {"accuracy_K": 1.0, "max_samples": 128, "phase": phase, "precision": precision}
    eight = run_block(BLOCK, **SCENE, transport=changes)
    paths = "cldit.transport.final_gather.paths"
    monkeypatch.setattr(f"{paths}.simd_defines", lambda _: {"SIMD_WIDTH": 1})
    one = run_block(BLOCK, **SCENE, transport=changes)
    assert one.info.counts["samples"] == eight.info.counts["samples"]
    difference = np.abs(wall(one) - wall(eight))
    assert difference.max() < (0.02 if precision == "float32" else 1e-6)
    assert np.quantile(difference, 0.9) < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("accuracy_K", [0.05, 0.1])
def test_flights_meet_light_that_changes_as_it_does(
    run_block: Callable[..., Run], monkeypatch: pytest.MonkeyPatch, accuracy_K: float
) -> None:
    """In a slab of 0.6 a cell the sources in flights' way, and how they change across cells, are
    those of PythonicDISORT.

    Of six layers the middle four are compared, in the middle of a cube that is five times as wide.
    Changes (12 times the integral over the place from the middle) of the light from either side
    are right to 3 %, for which 192 directions and more are enough, and so linear is light there;
    the mean to 8 % of the change, of which the cube's sides take most from the light from behind.
    By one pass less, as the last sweeps' own sources are, changes are up to 9 % too small, and
    means up to 11 % of them off.
    """
    kept: dict[str, Any] = {}

    def keeping(problem: SweepProblem, thick: ThickRegion, *given: Any, **found: Any) -> Any:
        kept["cells"], kept["thick"] = problem.medium, thick
        kept["records"] = made(problem, thick, *given, **found)
        return kept["records"]

    monkeypatch.setattr("cldit.transport.camera_source.records", keeping)
    depth, layers, albedo, cells = 0.6, 6, 0.6, 32
    transport = {"accuracy_K": accuracy_K, "max_samples": 128}
    run_slab(run_block, layers * depth, albedo, layers=layers, cells=cells, transport=transport)
    thick, records = kept["thick"], kept["records"]
    low = np.asarray(kept["cells"].box().low)
    x, y, z = (thick.at + low).T - np.array([[cells // 2], [(cells - layers) // 2], [cells // 2]])
    place, weight = np.polynomial.legendre.leggauss(8)
    for layer in (1, 2, 3, 4):
        there = (y == layer) & (np.abs(x) < 5) & (np.abs(z) < 5)
        sent = records[there].mean(axis=0) / albedo
        exact = mean_radiance(layers * depth, albedo, (layer + (place + 1) / 2) * depth)
        mean, change = exact @ weight / 2, 3 * exact @ (weight * place)
        source, along_y = sent[8:10], sent[16:18]  # as kernels/cell_record.h has them
        np.testing.assert_allclose(along_y, change, rtol=0.03)
        assert np.all(np.abs(source - mean) < 0.08 * np.abs(change))


@pytest.mark.parametrize("method", ["source", "path"])
@pytest.mark.parametrize("per_m", [1e6, 1e12])
def test_coefficients_beyond_single_precision(
    run_block: Callable[..., Run], per_m: float, method: str
) -> None:
    """The mean free path at 1e12 per m is 1e-8 of what the 24 bits of a place resolve. A cell so
    deep has the radiance of a half space: 144 pixels of 0.01 each, the noise of paths, give a mean
    to 0.001; the mean of the wall's weight was 0.2 too large."""
    run = run_block(
        {
            "droplet_absorption_per_m": 0.5 * per_m,
            "droplet_scattering_per_m": 0.5 * per_m,
            "droplet_temperature_K": 370.0,
        },
        **SCENE | {"camera": {"pixels": [12, 12], "field_m": [4 * CELL, 4 * CELL]}},
        transport={"method": method, "phase": "isotropic", "accuracy_K": 0.3, "audit": False},
    )
    assert run.weights.background.max() < 1e-6
    assert run.weights.wall.mean() == pytest.approx(1.0 - half_space_emission(0.5), abs=0.003)


def test_paths_are_bounded_in_total(
    run_block: Callable[..., Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Light in cells of depth 1000 that absorb 1e-4 of it scatters some thousand times in a path.

    The remark names the bound, and energy is conserved.
    """
    few = Tuning(path_segments=2e5)
    monkeypatch.setattr("cldit.transport.trace.Tuning", lambda: few)
    block = {"droplet_scattering_per_m": 2e5, "droplet_absorption_per_m": 20.0}
    run = run_block({**block, "droplet_temperature_K": 400.0}, **SCENE)
    assert any("2e+05 scatterings" in remark for remark in run.info.remarks)
    assert run.info.closure is not None and abs(run.info.closure.largest) < 5e-4
