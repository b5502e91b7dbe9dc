"""Twin experiment of `cldit fit`: bias by a lens and an exposure that the model omits.

python -m tests.bench fit_bias
"""

import argparse
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cldit.api.experiment import run_experiment
from cldit.scene import Scene, load_scene
from cldit.study.fit import Fit, Parameter, fit

CAMERA = {
    "camera.exposure": "times",
    "camera.sensor.integration_time_s": 25e-6,
    "camera.lens": {"spread_m": 5e-6},  # a third of a pixel
}
TRUE = {"spray.fuel_temperature_K": 370.0, "spray.injected_mass_kg": 20e-6}
VARY = ("spray.fuel_temperature_K=350:390", "spray.injected_mass_kg=15e-6:25e-6")


def twin() -> Scene:
    """Coarse `droplets-only`, without scatter between shots."""
    return load_scene("droplets-only").with_(
        **{
            "camera.pixels": [40, 40],
            "camera.rays_per_pixel": 4,
            "camera.sensor.pixels": [40, 40],
            "camera.sensor.bad_pixels": 0,
            "domain.leaf_edge_m": 4e-3,
            "spray.spacing_m": 2e-3,
            "spray.scatter.optical_depth": 0.0,
            "transport.audit": False,
            "transport.accuracy_K": 0.2,
            "plan": {"shots": 8, "references": 8},
            "background.temperatures_K": [413.0, 473.0, 533.0],
            **TRUE,
        }
    )


def fitted(recorded: Mapping[str, Any], models: Mapping[str, Mapping[str, Any]]) -> dict[str, Fit]:
    """Fits by name of models that have these keys, to a recording with the keys `recorded`."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        run_experiment(twin().with_(**recorded), out / "truth")
        found = {}
        for name, keys in models.items():
            scene = twin().with_(**keys)
            vary = [Parameter.parse(text, scene) for text in VARY]
            found[name] = fit(out / "truth", scene, vary, out / name, acquired=True)
    return found


def biases(found: Fit) -> list[float]:
    """Fitted less true values, in standard errors as stated."""
    pairs = zip(found.parameters, TRUE.values(), strict=True)
    return [(one.value - true) / one.error for one, true in pairs]


def main() -> None:
    """Prints values, errors and biases of both models."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    for name, found in fitted(CAMERA, {"with": CAMERA, "without": {}}).items():
        for key, one, bias in zip(TRUE, found.parameters, biases(found), strict=True):
            print(f"{name:8} {key} {one.value:.4g} ± {one.error:.2g}: {bias:+.1f} errors off")
        print(f"{name:8} p {found.p_value:.2g}")


if __name__ == "__main__":
    main()
