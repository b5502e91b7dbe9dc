"""No number comes from memory that nothing wrote: fresh buffers hold NaN, and nothing changes.

What comes into the thick region lies by faces and directions, where two opposite faces may share a
number. Here each has its own, so that no face's light stands in for another's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cldit
from cldit.gpu.device import Device
from cldit.run import Run
from cldit.transport.thick_region import ThickRegion
from tests.small_scenes import COUNT, KELVIN, block_scene, deep_block

CUTOFF = 1e-4  # of transmission
FORWARD = {"henyey_greenstein": 0.6}
SPECTRAL = {"preset": "spectral", "wavelengths": 2, "compare_paper": False}
CASES: dict[str, dict[str, Any]] = {
    "source": {"transport": {"phase": "isotropic"}},
    "source, forward": {"transport": {"phase": FORWARD}},
    "source, few directions": {  # one octant has none of the last twelve
        "transport": {"phase": {"henyey_greenstein": 0.9}, "directions": 4}
    },
    "source, Mie, wavelengths": {"optics": SPECTRAL, "transport": {"phase": "mie"}},
    "path, Mie": {"transport": {"method": "path", "max_samples": 128, "phase": "mie"}},
    "branching": {"transport": {"method": "branching", "order": 1}},
}


def traced(device: Device, cache: Path, case: dict[str, Any]) -> Run:
    transport = {"audit": False, "accuracy_K": 1.0, "cutoff": CUTOFF, **case["transport"]}
    scene = block_scene(**{**case, "transport": transport})
    return cldit.simulate(
        scene, device=device, cache=cache, spray=deep_block(np.linspace(8e-6, 12e-6, COUNT**3))
    )


def apart(thick: ThickRegion | None) -> ThickRegion | None:
    """With another number for each upper face than for any lower one."""
    if thick is None:
        return None
    beside, faces = thick.beside.copy(), int(thick.faces.max()) + 1
    beside[:, 1:6:2] -= np.where(thick.faces[:, 1::2] >= 0, faces, 0)
    return replace(thick, beside=beside, interfaces=thick.interfaces + faces)


def filled(*given: Any, empty: Callable[..., Any] = np.empty, **named: Any) -> Any:
    """As `numpy.empty`, with numbers that show."""
    out = empty(*given, **named)
    if out.dtype.kind in "iuf":
        out.fill(np.nan if out.dtype.kind == "f" else np.iinfo(out.dtype).max)
    return out


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of Mie tables."""
    return tmp_path_factory.mktemp("tables")


# In the first tier each method, each kind of device and both sorts of phase function.
QUICK = {
    ("source", "cpu"),
    ("path, Mie", "cpu"),
    ("branching", "gpu"),
}


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        pytest.param(name, kind, marks=[] if (name, kind) in QUICK else [pytest.mark.slow])
        for name in CASES
        for kind in ("cpu", "gpu")
    ],
)
def test_nothing_unwritten_is_read(
    name: str, kind: str, device: Device, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To the last bit as without NaN, by the code for either kind of device; and the weights of an
    isothermal medium sum to 1."""
    device = replace(device, info=replace(device.info, kind=kind))
    plain = traced(device, cache, CASES[name])
    of = ThickRegion.of
    monkeypatch.setattr(ThickRegion, "of", lambda *given, **named: apart(of(*given, **named)))
    monkeypatch.setattr(np, "empty", filled)
    found = traced(device.poisoned(), cache, CASES[name])
    assert len(found.spectral) == (2 if "wavelengths" in name else 1)
    for weights, others in zip(found.spectral, plain.spectral, strict=True):
        for part, image in weights.images.items():
            np.testing.assert_array_equal(image, others.images[part], err_msg=part)
            assert np.all(np.isfinite(image)), part
    for weights, node in zip(found.spectral, found.quadrature.nodes, strict=True):
        emitted = weights.liquid.astype(float) / node.radiance(KELVIN)
        left = weights.background + weights.wall + emitted - 1
        if name.startswith("source"):
            assert np.abs(left).max() < CUTOFF
        else:  # a mean of chains that scatter by 0.6 at most, five standard errors
            assert abs(left.mean()) < 5 * 0.6 / (128 * left.size) ** 0.5
    assert found.weights.liquid.max() > 0
