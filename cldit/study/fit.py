"""Fit of a scene's values to a measurement, by least squares on radiance.

Every evaluation is a run in a folder of its own, with the resolution of the first one and the same
random numbers, so that differences are smooth and a fit that was stopped continues. Errors of the
simulation are those of the first run.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtrc

from cldit.arrays import Floats
from cldit.comparison.shared import unshared
from cldit.comparison.shown import Shown, open_shown
from cldit.errors import StudyError
from cldit.gpu.device import Device
from cldit.io.content import digest
from cldit.io.exclusive import exclusive
from cldit.io.files import make_folder, write_text
from cldit.run import Run, Say, simulate
from cldit.run.content import trace_content
from cldit.run.simulate import reevaluated
from cldit.scene import Scene, dump_scene
from cldit.scene.keys import value_at
from cldit.scene.load import chosen_scene
from cldit.study.grid import ALIASES
from cldit.study.radiance import RadianceData

MOST = 6  # parameters
_STEP = 0.02  # of a parameter's range, for derivatives
_ENOUGH = 1e-3  # of a range, and of chi-square: steps smaller than that end the fit
_MOST_STEPS = 15
_UNIFORM = 12.0**-0.5  # standard deviation of a uniform distribution, of its range
_LEAST_P = 0.01  # of chi-square: below it a fit explains nothing
_NO_EFFECT = 0.05  # standard errors in any pixel, by the whole range: T_app in float32 has 0.02


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A key of the scene with its bounds, start, and prior (mean and standard deviation)."""

    key: str
    low: float
    high: float
    start: float
    prior: tuple[float, float] | None = None

    @classmethod
    def parse(cls, argument: str, scene: Scene) -> Parameter:
        """Reads `KEY=LOW:HIGH` or `KEY=LOW:HIGH:MEAN:DEVIATION`; it starts at the scene's value."""
        name, _, values = argument.partition("=")
        key = ALIASES.get(name.strip(), name.strip())
        try:
            numbers = [float(part) for part in values.split(":")]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 4) or not all(map(math.isfinite, numbers)):
            raise StudyError(
                f"--vary {argument}: allowed: KEY=LOW:HIGH, or KEY=LOW:HIGH:MEAN:DEVIATION with a "
                "prior, such as spray.injected_mass_kg=8e-6:12e-6"
            )
        low, high, *prior = numbers
        start = value_at(scene, key)
        if isinstance(start, bool) or not isinstance(start, int | float):
            raise StudyError(f"--vary {key}: is {start!r}; allowed: keys with a number")
        if isinstance(start, int) and not isinstance(start, bool) and key.endswith("seed"):
            raise StudyError(f"--vary {key}: a seed has no derivative; allowed: other numbers")
        if not low < high or not low <= start <= high:
            raise StudyError(
                f"--vary {argument}: the scene has {start:g}; allowed: bounds that rise and "
                "include it"
            )
        if prior and not prior[1] > 0.0:
            raise StudyError(f"--vary {argument}: deviation {prior[1]:g}; allowed: above 0")
        for bound in (low, high):
            scene.with_(**{key: bound})  # refuses what is not allowed
        prior_values = (prior[0], prior[1]) if prior else None
        return cls(key=key, low=low, high=high, start=float(start), prior=prior_values)


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """A parameter after the fit.

    error: standard deviation with the prior. interval: in which chi-square rises by less than 1,
    along the best values of the others; it ends at a bound where `open` (low, high) says so.
    determined: False if the data leave more than the uniform deviation of the range.
    """

    parameter: Parameter
    value: float
    error: float
    interval: tuple[float, float]
    open: tuple[bool, bool]
    determined: bool


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Result of a fit; covariance (P, P) and correlation in the order of the parameters.

    chi2_reduced, p_value: over 2 numbers a pixel. run: that of the best values. evaluations: number
    of runs that were used. weak: combination of parameters that the data determine least.
    """

    parameters: tuple[Fitted, ...]
    covariance: Floats = field(repr=False)
    chi2_reduced: float
    p_value: float
    pixels: int
    evaluations: int
    weak: str
    run: Run = field(repr=False)
    folder: Path

    @property
    def explained(self) -> bool:
        """False if chance hardly makes the residuals; the stated errors are then too small."""
        return self.p_value >= _LEAST_P

    @property
    def correlation(self) -> Floats:
        """Correlation (P, P) of the parameters."""
        sigma = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(sigma, sigma))

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "parameters": {
                fitted.parameter.key: {
                    "value": fitted.value,
                    "error": fitted.error,
                    "interval": list(fitted.interval),
                    "open": list(fitted.open),
                    "determined": fitted.determined,
                    "start": fitted.parameter.start,
                    "bounds": [fitted.parameter.low, fitted.parameter.high],
                    "prior": fitted.parameter.prior,
                }
                for fitted in self.parameters
            },
            "covariance": self.covariance.tolist(),
            "correlation": self.correlation.tolist(),
            "chi2_reduced": self.chi2_reduced,
            "p_value": self.p_value,
            "explained": self.explained,
            "pixels": self.pixels,
            "evaluations": self.evaluations,
            "weak": self.weak,
            "folder": str(self.folder),
        }


def fit(
    measured: str | Path | Run | Shown,
    scene: Scene | str | Path,
    vary: Sequence[Parameter | str],
    out: str | Path | None = None,
    *,
    acquired: bool = False,
    device: Device | None = None,
    cache: Path | None = None,
    progress: Say | None = None,
) -> Fit:
    """Fits values of a scene to a measurement, by least squares on radiance.

    Every evaluation is a run that is stored, so the same call continues after an interruption.

    Args:
        measured: evaluated images: measured data, an acquisition, or a run.
        scene: a scene, a shipped name, or a YAML file.
        vary: up to six keys with bounds, `KEY=LOW:HIGH`, and a prior if there is one,
            `KEY=LOW:HIGH:MEAN:DEVIATION`.
        out: folder of the runs, best.yaml and fit.json; None: runs/SCENE-fit.
        acquired: of a run, the recording of its rig is fitted.
        device: OpenCL device; None chooses.
        cache: as for `cldit.simulate`.
        progress: called with a line for each evaluation.

    Returns:
        Parameters with intervals, covariance (P, P), and the run of the best values.

    Raises:
        StudyError: a key, its bounds or its prior is not allowed, or it has no effect.
        ClditError: as `cldit.simulate` and `cldit.compare`.
    """
    scene = chosen_scene(scene)
    parameters = [
        Parameter.parse(value, scene) if isinstance(value, str) else value for value in vary
    ]
    keys = [parameter.key for parameter in parameters]
    if not 1 <= len(keys) <= MOST or len(set(keys)) < len(keys):
        raise StudyError(f"--vary: {', '.join(keys) or 'none'}; allowed: 1..{MOST} different keys")
    folder = Path("runs") / f"{scene.name}-fit" if out is None else Path(out)
    with exclusive(folder, "fit"):
        model = _Model(
            scene, tuple(parameters), folder, device, cache, progress or (lambda line: None)
        )
        return model.fit(open_shown(measured, acquired=acquired))


@dataclass
class _Model:
    """Runs of a scene as a function of its parameters, in units u of their ranges."""

    scene: Scene
    parameters: tuple[Parameter, ...]
    folder: Path
    device: Device | None
    cache: Path | None
    say: Say
    initial_run: Run | None = None
    runs: dict[str, Run] = field(default_factory=dict)
    evaluated: dict[tuple[float, ...], Floats] = field(default_factory=dict)
    data: RadianceData | None = None

    @property
    def low(self) -> Floats:
        return np.array([parameter.low for parameter in self.parameters])

    @property
    def span(self) -> Floats:
        return np.array([parameter.high - parameter.low for parameter in self.parameters])

    def run(self, u: Floats) -> Run:
        """The run at u: made, read from the folder, or evaluated from one with the same trace."""
        values = self.low + u * self.span
        changes = {
            parameter.key: float(f"{value:.12g}")
            for parameter, value in zip(self.parameters, values, strict=True)
        }
        scene = self.scene.with_(**changes)
        key = digest(trace_content(scene))
        if key in self.runs:
            return reevaluated(self.runs[key], scene)
        place = self.folder / "runs" / (key if self.initial_run is not None else f"first-{key}")
        run = simulate(scene, place, device=self.device, cache=self.cache, like=self.initial_run)
        self.runs[key] = run
        return run

    def residuals(self, u: Floats) -> Floats:
        """Differences in standard errors from the data and from the priors."""
        key = tuple(np.round(u, 12).tolist())
        if key not in self.evaluated:
            assert self.data is not None
            shown = open_shown(self.run(u))
            values = self.low + u * self.span
            priors = [
                (value - parameter.prior[0]) / parameter.prior[1]
                for parameter, value in zip(self.parameters, values, strict=True)
                if parameter.prior is not None
            ]
            self.evaluated[key] = np.concatenate([self.data.residuals(shown), priors])
            chi2 = float(self.evaluated[key] @ self.evaluated[key])
            words = ", ".join(f"{value:.6g}" for value in values)
            self.say(f"evaluation {len(self.evaluated)}: chi-square {chi2:.6g} at {words}")
        return self.evaluated[key]

    def jacobian(self, u: Floats) -> Floats:
        """Derivatives by u, from steps into the range."""
        residuals = self.residuals(u)
        columns = []
        for number in range(len(u)):
            step = _STEP if u[number] + _STEP <= 1.0 else -_STEP
            moved = u.copy()
            moved[number] += step
            columns.append((self.residuals(moved) - residuals) / step)
        return np.array(columns).T

    def fit(self, measured: Shown) -> Fit:
        """The best values, with their errors."""
        start = (
            np.array([parameter.start for parameter in self.parameters]) - self.low
        ) / self.span
        make_folder(self.folder)
        began = time.perf_counter()
        self.initial_run = self.run(start)
        self._cost(time.perf_counter() - began)
        shown = open_shown(self.initial_run)
        parts = unshared(measured, shown)
        self.data = RadianceData.of(parts.baseline, replace(parts.compared, scene=shown.scene))
        priors = sum(parameter.prior is not None for parameter in self.parameters)
        of_data = slice(0, len(self.residuals(start)) - priors)
        effect = np.max(np.abs(self.jacobian(start)[of_data]), axis=0)
        for parameter, largest in zip(self.parameters, effect, strict=True):
            if largest < _NO_EFFECT:
                raise StudyError(
                    f"--vary {parameter.key}: has no effect on the image; omit it, or widen its "
                    "bounds"
                )
        solved = least_squares(
            self.residuals,
            np.clip(start, 1e-6, 1.0 - 1e-6),
            jac=self.jacobian,
            bounds=(0.0, 1.0),
            xtol=_ENOUGH,
            ftol=_ENOUGH**2,
            gtol=None,
            max_nfev=_MOST_STEPS,
        )
        u, chi2 = solved.x, float(2.0 * solved.cost)
        slopes = self.jacobian(u)
        covariance = np.asarray(np.linalg.pinv(slopes.T @ slopes), np.float64)
        information = slopes[of_data].T @ slopes[of_data]
        values, vectors = np.linalg.eigh(information)
        with np.errstate(divide="ignore"):
            deviations = np.sqrt(np.sum(vectors**2 / np.maximum(values, 1e-300), axis=1))
        fitted = tuple(
            self._fitted(
                number, u, covariance, chi2, determined=bool(deviations[number] < _UNIFORM)
            )
            for number in range(len(u))
        )
        count = int(np.count_nonzero(self.data.where))
        degrees = 2 * count - len(u) + priors
        fitted_model = Fit(
            parameters=fitted,
            covariance=covariance * np.outer(self.span, self.span),
            chi2_reduced=chi2 / degrees,
            p_value=float(chdtrc(degrees, chi2)),
            pixels=count,
            evaluations=len(self.evaluated),
            weak=self._combination(vectors[:, 0]) if values[0] < _UNIFORM**-2 else "",
            run=self.run(u),
            folder=self.folder,
        )
        write_text(self.folder / "best.yaml", dump_scene(fitted_model.run.scene))
        write_text(self.folder / "fit.json", json.dumps(fitted_model.to_dict(), indent=1))
        return fitted_model

    def _cost(self, seconds: float) -> None:
        count = len(self.parameters)
        about = 4 * (count + 1) + 4 * count
        self.say(
            f"about {about} evaluations, of at most {seconds:.2g} s each as the first one: up to "
            f"{about * seconds / 60:.2g} min; stored ones are read"
        )

    def _fitted(
        self, number: int, u: Floats, covariance: Floats, chi2: float, *, determined: bool
    ) -> Fitted:
        """One parameter with its interval of rising chi-square."""
        parameter = self.parameters[number]
        sigma = math.sqrt(covariance[number, number])
        # The best values of the others follow this one along the covariance.
        along = covariance[:, number] / covariance[number, number]
        ends, bounded = [], []
        for way in (-1.0, 1.0):
            room = u[number] if way < 0 else 1.0 - u[number]
            step, rise = sigma, 0.0
            for _ in range(2):
                step = min(step, room)
                place = np.clip(u + way * step * along, 0.0, 1.0)
                residuals = self.residuals(place)
                rise = max(float(residuals @ residuals) - chi2, 1e-12)
                if step >= room and rise < 1.0:
                    break
                step /= math.sqrt(rise)  # a parabola through the best value
            bounded.append(bool(step >= room))
            ends.append(
                float(parameter.low + (u[number] + way * min(step, room)) * self.span[number])
            )
        return Fitted(
            parameter=parameter,
            value=float(self.low[number] + u[number] * self.span[number]),
            error=float(sigma * self.span[number]),
            interval=(ends[0], ends[1]),
            open=(bounded[0], bounded[1]),
            determined=determined,
        )

    def _combination(self, direction: Floats) -> str:
        """Parameters of a direction in u, by their share."""
        parts: Mapping[str, float] = {
            parameter.key: float(share)
            for parameter, share in zip(self.parameters, direction, strict=True)
            if abs(share) > 0.1
        }
        order = sorted(parts, key=lambda key: -abs(parts[key]))
        return ", ".join(f"{parts[key]:+.2f} {key}" for key in order)
