"""Mean of several injections, `spray.scatter.members`, with their deviation and standard error.

The nominal scene is traced first, with its error; its resolution is that of all members. Every run
has a folder of its own in that of the mean, `nominal` and `members/0001`, .., so that a run that
was stopped continues, and members can be traced side by side (`cldit.study.side_by_side`).
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cldit.accuracy.error_maps import TOTAL
from cldit.accuracy.errors import Cause, Errors
from cldit.arrays import Floats, Image
from cldit.camera.curve import Curve
from cldit.dit.maps import Maps
from cldit.io.files import make_folder, write_text
from cldit.radiance.apparent_temperature import has_temperature
from cldit.run.ensemble_statistics import Ensemble
from cldit.run.mean_light import MeanLight
from cldit.run.result import Run
from cldit.scene import Scene, dump_scene
from cldit.scene.scatter import member, members_of, nominal

NOMINAL, MEMBERS = "nominal", "members"
INJECTIONS = "injections"
UNSTATED = "one of several injections, traced with the resolution of the nominal one"


@dataclass
class _Sums:
    """Sums over members (H, W): of T_app and the emissivity, and of the spray's radiance E."""

    curve: Curve
    sums: dict[str, Floats] = field(default_factory=dict)

    def add(self, maps: Maps) -> None:
        """Adds one member."""
        emissivity = np.nan_to_num(maps.emissivity.astype(float))
        temperature_K = maps.apparent_temperature_K.astype(float)
        valid = has_temperature(maps.emissivity, temperature_K)
        kelvin: Floats = np.where(valid, temperature_K, 0.0)
        radiance = np.where(np.isfinite(temperature_K), emissivity, 0.0)
        radiance[radiance != 0.0] *= self.curve.radiance(temperature_K[radiance != 0.0])
        images = {
            "count": valid.astype(float),
            "K": kelvin,
            "K2": kelvin**2,
            "e": emissivity,
            "E": radiance,
            "ee": emissivity**2,
            "eE": emissivity * radiance,
            "EE": radiance**2,
        }
        for name, image in images.items():
            self.sums[name] = self.sums.get(name, 0.0) + image

    def statistics(self, maps: Maps, of_nominal: Maps, members: int) -> Ensemble:
        """Statistics of the members; `maps` are those of the mean light."""
        n, sums = float(members), self.sums
        count = sums["count"]
        with np.errstate(invalid="ignore", divide="ignore"):
            mean_K = sums["K"] / np.where(count > 0, count, np.nan)
            square = (sums["K2"] - count * mean_K**2) / np.where(count > 1, count - 1, np.nan)

            def covariance(x: str, y: str, product: str) -> Floats:
                return np.asarray((sums[product] - sums[x] * sums[y] / n) / max(n - 1, 1.0))

            ee = covariance("e", "e", "ee")
            # T_app of the mean light is that of E / e: d T = (dE - B(T) de) / (e dB/dT).
            valid = maps.has_temperature
            light_K = maps.apparent_temperature_K[valid].astype(float)
            black, slope = self.curve.radiance(light_K), self.curve.slope(light_K)
            variance = covariance("E", "E", "EE")[valid]
            variance += black**2 * ee[valid] - 2.0 * black * covariance("e", "E", "eE")[valid]
            error_K = np.full(count.shape, np.nan)
            error_K[valid] = np.sqrt(np.maximum(variance, 0.0) / n) / (
                slope * maps.emissivity[valid]
            )
            error_K[count < 2.0] = np.nan  # one member has no deviation
            images: dict[str, NDArray[np.floating]] = {
                "apparent_temperature_nominal_K": of_nominal.apparent_temperature_K,
                "apparent_temperature_mean_K": mean_K,
                "apparent_temperature_deviation_K": np.sqrt(np.maximum(square, 0.0)),
                "apparent_temperature_standard_error_K": error_K,
                "emissivity_mean": sums["e"] / n,
                "emissivity_deviation": np.sqrt(np.maximum(ee, 0.0)),
                "emissivity_standard_error": np.sqrt(np.maximum(ee, 0.0) / n),
                "injections": count,
            }
        visible = np.isfinite(maps.emissivity)
        return Ensemble(
            members,
            {
                name: np.where(visible, image, np.nan).astype(np.float32)
                for name, image in images.items()
            },
        )


Trace = Callable[[Scene, Path | None, Run | None], Run]


def ensemble_run(scene: Scene, folder: Path | None, like: Run | None, *, trace: Trace) -> Run:
    """The run of a scene whose image is the mean of its members; only these are written.

    `trace` returns the run of one scene in a folder, with the resolution of another run.
    """
    if folder is not None:
        begin(scene, folder)
    nominal_run = trace(nominal(scene), folder and folder / NOMINAL, like)
    members = members_of(scene)
    sums = _Sums(Curve(filter_um=nominal_run.quadrature.filter_um))

    def member_runs() -> Iterator[Run]:
        for number in range(1, members + 1):
            run = trace(
                member(scene, number), folder and member_folder(folder, number), nominal_run
            )
            sums.add(run.maps)
            yield run

    light = MeanLight.of(scene, member_runs(), nominal_run, label="injections")
    remark = f"mean of {members} injections; figures of the spray are those of the nominal one"
    run = light.run(scene, nominal_run, folder, remark)
    statistics = sums.statistics(run.maps, nominal_run.maps, members)
    return replace(
        run,
        info=replace(run.info, errors=_errors(nominal_run.errors, statistics, run.maps)),
        error_maps=_error_maps(
            nominal_run.error_maps,
            statistics["apparent_temperature_standard_error_K"],
            run.maps.has_temperature,
        ),
        emissivity_error_maps=_error_maps(
            nominal_run.emissivity_error_maps,
            statistics["emissivity_standard_error"],
            np.isfinite(run.maps.emissivity),
        ),
        ensemble=statistics,
    )


def begin(scene: Scene, folder: Path) -> None:
    """Writes the scene into the folder of an ensemble first: it identifies the folder."""
    make_folder(folder)
    write_text(folder / "scene.yaml", dump_scene(scene))


def member_folder(folder: Path, number: int) -> Path:
    """Folder of one injection of an ensemble in `folder`."""
    return folder / MEMBERS / f"{number:04d}"


def _errors(errors: Errors | None, statistics: Ensemble, maps: Maps) -> Errors | None:
    """Errors of the nominal run, and that by the number of injections."""
    if errors is None or errors.why:
        return errors
    rms = []
    for name in ("apparent_temperature_standard_error_K", "emissivity_standard_error"):
        valid = maps.has_temperature & np.isfinite(statistics[name])
        square = statistics[name][valid].astype(float) ** 2
        rms.append(float(np.sqrt(np.mean(square))) if valid.any() else None)
    method = f"standard error of the mean of {statistics.members} injections"
    cause = Cause(INJECTIONS, rms[0], method, "spray.scatter.members", emissivity=rms[1])
    return replace(errors, causes=(*errors.causes, cause))


def _error_maps(
    of_nominal: Mapping[str, Image], of_mean: Image, counted: NDArray[np.bool_]
) -> dict[str, Image]:
    """Error maps of the nominal run with the standard error of the mean of injections."""
    if TOTAL not in of_nominal:
        return dict(of_nominal)
    error = np.where(counted, of_mean, np.nan)
    out = {name: image for name, image in of_nominal.items() if name != TOTAL}
    total = np.hypot(np.nan_to_num(of_nominal[TOTAL]), error).astype(np.float32)
    return {**out, INJECTIONS: error.astype(np.float32), TOTAL: total}
