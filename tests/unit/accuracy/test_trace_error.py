"""A run that states an error larger than was asked for says so, and what can be done."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cldit.accuracy.node_traces import summed
from cldit.accuracy.trace_error import TraceError
from cldit.dit.maps import Maps, Reason
from cldit.gpu.device import Device
from cldit.optics.tolerance import kelvin_per_emissivity
from cldit.radiance.weights import Weights
from cldit.run import open_run, simulate
from cldit.scene import Scene, load_scene, parse_scene
from cldit.transport.monte_carlo.pixel_sampling import PixelSample
from cldit.transport.result import Audit


@pytest.mark.parametrize(
    ("halves_K", "audit_K", "cells_K", "error_K"),
    [(0.2, 0.1, 0.0, 0.1), (0.1, 0.2, 0.0, 0.2), (0.2, None, 0.0, 0.2), (0.2, None, 1.0, 0.2)],
)
def test_audit_is_stated(
    halves_K: float, audit_K: float | None, cells_K: float, error_K: float
) -> None:
    """It is of the image; halves have the error of half of the ordinates, and miss a part."""
    assert TraceError(halves_K, audit_K, cells_K).error_K == error_K


def test_unknown() -> None:
    """Is said, with what is known; it is never a number, nor less than was asked for."""
    assert TraceError(None, unknown="why").error_K is None
    (text,) = TraceError(None, unknown="why").unknown_remarks
    assert text == "error of the trace in T_app: unknown (why)"
    (text,) = TraceError(0.05, unknown="why").unknown_remarks
    assert text.startswith("error of the trace in T_app: at least 0.05 K RMS")


@pytest.mark.parametrize("audit_K", [0.0, 0.3, 0.8, 2.0])
@pytest.mark.parametrize("cells_K", [0.0, 0.4, 0.8])
def test_what_the_cells_explain_is_not_counted_twice(audit_K: float, cells_K: float) -> None:
    """The sum with the cells is neither below either of both, nor 2^1/2 too small or too large.

    The audit finds errors of even sources in cells (a part of the cells' error) and others. Its
    square is theirs together; which part is whose, nobody knows.
    """
    halves_K = 0.2
    found = TraceError(halves_K, audit_K, cells_K)
    assert found.whole_K == audit_K
    trace_K = found.error_K
    assert trace_K is not None and trace_K >= min(halves_K, audit_K)
    stated = (trace_K**2 + cells_K**2) ** 0.5
    assert stated >= max(audit_K, cells_K) - 1e-12
    both = (audit_K**2 + cells_K**2) ** 0.5
    assert both / 2**0.5 - 1e-12 <= stated <= both + 1e-12


def flat(value: float) -> Weights:
    """Weights of two by two pixels that all are of one value."""
    image = np.full((2, 2), value, np.float32)
    return Weights(image, -image, np.zeros_like(image), np.zeros_like(image))


def node(difference: float, audit: float | None, *, noise: float = 0.0) -> Any:
    """A trace of such weights, audited in all of its pixels by halves with this noise."""

    def half(sign: int) -> Weights:
        return flat((audit or 0.0) + sign * noise).map(lambda weight: weight.reshape(1, 4))

    every = PixelSample(np.arange(4), np.ones(4))
    return SimpleNamespace(
        weights=flat(0.5),
        weights_difference=flat(difference),
        audit=None if audit is None else Audit(every, (half(1), half(-1))),
        scatters=True,
        unaudited="no audit" if audit is None else "",
        seconds={},
        counts={},
    )


def stated(scene: Scene, *traces: Any) -> TraceError:
    """Of nodes of equal light."""
    at_K = scene.walls.temperature_K - 100.0  # at that of the walls the weights' errors cancel
    maps = replace(
        Maps.unevaluated((2, 2), Reason.OK),
        emissivity=np.full((2, 2), 0.5, np.float32),
        apparent_temperature_K=np.full((2, 2), at_K, np.float32),
    )
    nodes = [SimpleNamespace(share=lambda _: 1 / len(traces)) for _ in traces]
    quadrature: Any = SimpleNamespace(nodes=nodes, reference_K=at_K)
    found, emissivity = TraceError.of(scene, summed(traces, quadrature, scene), maps)
    # The background's weight is off by `difference`, which is that of emissivity as well.
    known = [np.sum([one.weights_difference.background for one in traces], axis=0) / len(traces)]
    expected_K = kelvin_per_emissivity(scene) * float(np.sqrt(np.mean(np.square(known))))
    assert emissivity.halves_K == pytest.approx(expected_K, rel=1e-5, abs=1e-6)
    return found


def test_wavelengths_add_as_they_do_in_the_picture() -> None:
    """Errors of opposite sign cancel, and equal ones are one node's: their share is the light's."""
    scene = load_scene("droplets-only")
    one = stated(scene, node(0.01, 0.02))
    both = stated(scene, node(0.01, 0.02), node(0.01, 0.02))
    against = stated(scene, node(0.01, 0.02), node(-0.01, -0.02))
    half = stated(scene, node(0.01, 0.02), node(0.0, 0.0))
    part = stated(scene, node(0.01, 0.02), node(0.01, None))
    assert (part.audit_K, part.unknown) == (None, "no audit")
    assert one.halves_K is not None and one.audit_K is not None and one.halves_K > 0.1
    assert one.audit_K == pytest.approx(2 * one.halves_K, rel=1e-6)
    assert (both.halves_K, both.audit_K) == pytest.approx((one.halves_K, one.audit_K), rel=1e-5)
    assert (against.halves_K, against.audit_K) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert half.audit_K == pytest.approx(one.audit_K / 2, rel=1e-5)


def test_one_standard_error_is_added_to_the_audit() -> None:
    """Halves of e (1 + s) and e (1 - s) in each of 4 pixels: their product has a mean of e^2 (1 -
    s^2), and a variance of 4 e^4 s^2 by the noise, so its mean has a standard error of e^2 s."""
    scene = load_scene("droplets-only")
    exact, noisy = (stated(scene, node(0.01, 0.02, noise=noise)) for noise in (0.0, 0.01))
    assert exact.audit_K is not None
    assert noisy.audit_K == pytest.approx((1 - 0.5**2 + 0.5) ** 0.5 * exact.audit_K, rel=1e-5)


@pytest.mark.slow
def test_runs_say_so(device: Device, tmp_path: Path) -> None:
    """As it goes, in run.json, and in the run that is opened again; not where 100 K will do."""
    data = load_scene("droplets-only").model_dump(mode="json")
    data["camera"]["pixels"] = [8, 8]
    data["domain"]["leaf_edge_m"] = 4e-3
    for kelvin, told in ((1e-3, 1), (100.0, 0)):
        lines: list[str] = []
        data["transport"] |= {"accuracy_K": kelvin, "directions": 8, "gather": False}
        data["transport"]["max_samples"] = 128
        folder = tmp_path / str(kelvin)
        run = simulate(parse_scene(data), folder, device=device, progress=lines.append)
        kept = json.loads((folder / "run.json").read_text())["remarks"]
        for texts in (lines, kept, run.info.remarks, open_run(folder).info.remarks):
            above = [text for text in texts if "more than transport.accuracy_K" in text]
            assert sum("stated error " in text for text in above) == told
