"""Mie cross sections of droplets over their size, as a table for one wavelength and liquid.

The refractive index is m = n - ik. The table is even in ln x, x = pi d / wavelength, linear in
between, and kept on disk if a folder is given.

Error, 0.05 to 500 um at 3.4 um (x up to 460): for k >= 0.002 below 0.1 % of Q_sca and Q_abs and
0.001 of g at every diameter, for k >= 0.01 below 0.003 %. Below k = 0.002 whispering gallery
resonances become finer than any table. Few different diameters (`FEW`; a monodisperse spray) are
then solved exactly; with more, entries are means over 1 % of the diameter (a triangle of +-1 %),
which change the mean of a distribution 10 % wide by less than 0.1 %, and are within 0.1 % of those
means, Q_abs of itself at any k (resonances narrower than the samples: `mie.efficiencies`).
Each new table is checked at five sizes against miepython, a second program for Mie's solution.
`cldit show SCENE --part optics` prints the error for a scene.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from cldit.arrays import Floats
from cldit.errors import DropletError
from cldit.io.content import code_digest
from cldit.io.free_memory import parts
from cldit.io.tables import Arrays, cached
from cldit.optics import mie
from cldit.spray.sizes import FREE_DROP_M

SMALLEST_M = 0.05e-6
LARGEST_M = 500e-6
POINTWISE_K = 0.002  # from this k on, entries are values at single diameters
AVERAGED = 0.01  # half width in ln x of the means below it
FEW = 256  # different diameters that are solved one by one below it
_STEP = 3.3e-4  # in ln x; the errors above are those of linear interpolation between such steps
_SECOND_PROGRAM = 1e-6  # relative; both agree to 1e-8 above |m| x = 0.1 (test_miepython_agrees)


@dataclass(frozen=True)
class DropletTable:
    """Efficiencies over ln x; made by `droplet_table`.

    scattering, absorption: (N,) efficiencies over their Rayleigh forms, x^4 / (1 + x^4) and
    x/sqrt(1 + x^2), which keeps them of order one. asymmetry: (N,) g.
    """

    wavelength_um: float
    n: float
    k: float
    log_x_start: float
    log_x_step: float
    scattering: Floats
    absorption: Floats
    asymmetry: Floats

    @property
    def largest_m(self) -> float:
        """Largest diameter in the table."""
        log_x_end = self.log_x_start + self.log_x_step * (len(self.scattering) - 1)
        return float(np.exp(log_x_end)) * self.wavelength_um * 1e-6 / np.pi

    def efficiencies(self, diameter_m: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Q_ext, Q_sca and g, shaped as `diameter_m`.

        Below the table (x < 0.01, or d < 0.05 um) the Rayleigh limit continues it.
        """
        columns = (self.absorption, self.scattering, self.asymmetry)
        q_abs, q_sca, g = self._efficiencies(np.asarray(diameter_m, dtype=float), columns)
        return q_sca + q_abs, q_sca, g

    def _efficiencies(self, d: Floats, columns: tuple[Floats, ...]) -> list[Floats]:
        """Values of the given columns, of (absorption, scattering, asymmetry)."""
        if d.size and not (d.min() > 0 and d.max() <= self.largest_m * (1 + 1e-9)):
            bad = d[~((d > 0) & (d <= self.largest_m))].reshape(-1)[0]
            raise DropletError(
                f"droplet diameter: {bad:g} m is outside 0..{self.largest_m:g} m, the range of "
                f"the Mie table for {self.wavelength_um:g} um; allowed: up to {FREE_DROP_M:g} m, "
                f"and to a size parameter of {mie.SIZE_PARAMETERS[1]:g}"
            )
        results = [np.empty(d.shape) for _ in columns]
        flat, targets = d.reshape(-1), [result.reshape(-1) for result in results]
        for part in parts(d.size):
            for target, values in zip(targets, self._looked_up(flat[part], columns), strict=True):
                target[part] = values
        return results

    def _looked_up(self, d: Floats, columns: tuple[Floats, ...]) -> list[Floats]:
        x = d * (np.pi / (self.wavelength_um * 1e-6))
        place = (np.log(x) - self.log_x_start) / self.log_x_step
        end = len(self.scattering) - 1
        place = np.clip(place, 0.0, end)
        cell = np.minimum(place.astype(np.intp), end - 1)
        part = place - cell
        x2 = x * x
        values = [_between(column, cell, part) for column in columns]
        values[0] *= x / np.sqrt(1 + x2)
        values[1] *= x2 * x2 / (1 + x2 * x2)
        return values

    def cross_sections(self, diameter_m: ArrayLike) -> tuple[Floats, Floats]:
        """C_abs and C_sca in m2, shaped as `diameter_m`; raises as `efficiencies`.

        Exact if k < 0.002 and at most `FEW` diameters differ, otherwise from the table.
        """
        d = np.asarray(diameter_m, dtype=float)
        q_abs, q_sca = self._efficiencies(d, (self.absorption, self.scattering))
        if self.k < POINTWISE_K:
            distinct, copy = np.unique(d, return_inverse=True)
            x = distinct * (np.pi / (self.wavelength_um * 1e-6))
            solved = np.log(np.maximum(x, 1e-300)) >= self.log_x_start
            if 0 < len(distinct) <= FEW and np.any(solved):
                exact = mie.efficiencies(n=self.n, k=self.k, x=x[solved])
                place = np.cumsum(solved)[copy].reshape(d.shape) - 1
                these = solved[copy].reshape(d.shape)
                q_abs = np.where(these, exact.absorption[place], q_abs)
                q_sca = np.where(these, exact.scattering[place], q_sca)
        area = d * d
        area *= np.pi / 4
        q_abs *= area
        q_sca *= area
        return q_abs, q_sca


def _between(values: Floats, cell: NDArray[np.intp], part: Floats) -> Floats:
    below = values[cell]
    return np.asarray(below + part * (values[cell + 1] - below))


def droplet_table(
    *, wavelength_um: float, n: float, k: float, cache: Path | None, largest_m: float = LARGEST_M
) -> DropletTable:
    """The table for droplets of refractive index n - ik, from 0.05 um to 500 um and below.

    For larger droplets, `largest_m`, it reaches to 5 mm, or to a size parameter of 1e4, up to which
    Mie's solution is computed (10 mm at 3.4 um). Tables are kept by content in the folder
    `cache`; None keeps none.
    """
    if not (wavelength_um > 0 and n > 0 and k >= 0 and np.isfinite(wavelength_um + n + k)):
        raise DropletError(
            f"droplet optics: wavelength {wavelength_um:g} um, n = {n:g}, k = {k:g}; allowed: "
            "finite numbers, wavelength and n above 0, k not below 0"
        )
    end_m, end = LARGEST_M, ""
    if largest_m > LARGEST_M:
        largest_x = mie.SIZE_PARAMETERS[1] * np.exp(-2 * AVERAGED)  # means reach beyond the end
        end_m = float(min(FREE_DROP_M, largest_x * wavelength_um * 1e-6 / np.pi))
        end = f" {end_m!r}"
    arrays = cached(
        cache,
        kind="mie",
        description=f"{code_digest('optics')} {wavelength_um!r} {n!r} {k!r}{end}",
        make=lambda: _solve(wavelength_um=wavelength_um, n=n, k=k, end_m=end_m),
    )
    start, step = (float(value) for value in arrays["axis"])
    columns = (arrays[name] for name in ("scattering", "absorption", "asymmetry"))
    return DropletTable(wavelength_um, n, k, start, step, *columns)


def scaled(x: Floats, solved: mie.Efficiencies) -> tuple[Floats, Floats, Floats]:
    """Q_sca and Q_abs over their Rayleigh forms, and g, (N,), of the solution at sizes `x` (N,)."""
    x4 = x**4
    scattering = solved.scattering * (1 + x4) / x4
    return scattering, solved.absorption * np.sqrt(1 + x * x) / x, solved.asymmetry


def check_by_miepython(*, n: float, k: float, largest_x: float) -> None:
    """Compares Mie's solution at five sizes with miepython; raises DropletError if they differ."""
    import miepython  # half of a second, for the tables that few runs make

    x = np.geomspace(1.0, min(max(largest_x, 1.0), 100.0), 5)
    solved = mie.efficiencies(n=n, k=k, x=x)
    extinction, scattering, _, asymmetry = miepython.efficiencies_mx(complex(n, -k), x)
    for name, values, reference in (
        ("Q_ext", solved.extinction, extinction),
        ("Q_sca", solved.scattering, scattering),
        ("g Q_sca", solved.asymmetry * solved.scattering, asymmetry * scattering),
    ):
        # Below an efficiency of 1e-9 a droplet is as good as absent, as at n = 1, k = 0.
        scale = np.maximum(np.maximum(extinction, np.abs(reference)), 1e-9)
        difference = np.abs(values - reference) / scale
        if not np.all(difference <= _SECOND_PROGRAM):
            worst = int(np.argmax(difference))
            raise DropletError(
                f"Mie: {name} at x = {x[worst]:.3g}, m = {n:g} - {k:g}i is {values[worst]:.8g}, by "
                f"miepython {reference[worst]:.8g}; allowed: {_SECOND_PROGRAM:g} apart. Is NumPy "
                "or miepython damaged?"
            )


def _solve(*, wavelength_um: float, n: float, k: float, end_m: float) -> Arrays:
    largest_x = np.pi * end_m * 1e6 / wavelength_um
    check_by_miepython(n=n, k=k, largest_x=largest_x)
    end = np.log(largest_x)
    start = min(np.log(0.01), np.log(np.pi * SMALLEST_M * 1e6 / wavelength_um), end - 1)
    count = int((end - start) / _STEP) + 1
    step = (end - start) / (count - 1)
    if k >= POINTWISE_K:
        # Absorption k makes every feature wider than k / n in ln x.
        # From k / n = 0.015 on, every eighth step is solved and splined between.
        smooth, coarser = 0.015, 8
        entries = np.arange(count)[:: coarser if k >= smooth * n else 1]
        entries = np.union1d(entries, [count - 1])
        x = np.exp(start + step * entries)
        solved = scaled(x, mie.efficiencies(n=n, k=k, x=x))
        scattering, absorption, g = (
            np.asarray(scipy.interpolate.CubicSpline(entries, column)(np.arange(count)))
            for column in solved
        )
    else:
        # Resonances of smaller k are narrower, and have more samples of a step.
        finer = next(samples for least_k, samples in {0.0005: 2, 0.0: 8}.items() if k >= least_k)
        beyond = int(np.ceil(AVERAGED / step)) * finer
        samples = np.arange(-beyond, (count - 1) * finer + beyond + 1)
        x = np.exp(start + step / finer * samples)
        reach = np.abs(np.arange(-beyond, beyond + 1)) * step / finer
        shape = np.maximum(1 - reach / AVERAGED, 0.0)
        shape /= shape.sum()
        solved_at = mie.efficiencies(n=n, k=k, x=x, spacing=step / finer)
        scattering, absorption, g = scaled(x, solved_at)
        means = [
            np.convolve(column, shape, "valid")[::finer]
            for column in (scattering, absorption, g * scattering)
        ]
        g = np.divide(means[2], means[0], out=np.zeros(count), where=means[0] > 0)
        scattering, absorption = means[:2]
    return {
        "axis": np.array([start, step]),
        "scattering": np.maximum(scattering, 0.0),
        "absorption": np.maximum(absorption, 0.0),
        "asymmetry": g,
    }


def resolved(*, n: float, k: float, span: float, minimum: int) -> int:
    """Number of samples over a span of ln x that resolve any resonance of the index n - ik.

    With two per half width k / n, means of Mie's solutions are exact. Below k = 1e-7 that is too
    many, and `mie.efficiencies` needs the spacing. `minimum` is the smallest number.
    """
    # 6e5 is 2 span n / k of a mean at n = 1.4 and k = 1e-7.
    return max(minimum, int(min(2.0 * span * n / k, 6e5)) if k > 0 else minimum)


def table_error(table: DropletTable, *, samples: int = 400) -> tuple[float, float, float]:
    """Largest relative errors of Q_sca and Q_abs, and error of g, at random diameters, even in
    ln d, against Mie's solution.

    Below `POINTWISE_K` the solution is averaged as the entries are, at fewer diameters.
    """
    random = np.random.default_rng(1)
    low = table.log_x_start
    high = low + table.log_x_step * (len(table.scattering) - 1)
    offsets: Floats = np.zeros(1)
    spacing = 0.0
    if table.k < POINTWISE_K:
        count = resolved(n=table.n, k=table.k, span=2 * AVERAGED, minimum=600)
        samples = int(np.clip(2e6 / count, 4, max(samples // 8, 1)))
        spacing = 2 * AVERAGED / count
        offsets = np.asarray(spacing * (np.arange(count) + 0.5) - AVERAGED, np.float64)
    weight = np.maximum(1.0 - np.abs(offsets) / AVERAGED, 0.0)
    weight /= weight.sum()
    centres = np.exp(random.uniform(low, high, samples))
    tabulated = np.array(table.efficiencies(centres * table.wavelength_um * 1e-6 / np.pi))
    errors = np.zeros((samples, 3))
    for number, (x, (q_ext, q_sca, g)) in enumerate(zip(centres, tabulated.T, strict=True)):
        samples_x = x * np.exp(offsets)
        flat = mie.efficiencies(n=table.n, k=table.k, x=samples_x, spacing=spacing)
        scattering, absorption, asymmetry = scaled(samples_x, flat)
        exact_sca = weight @ scattering * x**4 / (1 + x**4)
        exact_abs = weight @ absorption * x / np.sqrt(1 + x**2)
        exact_g = weight @ (asymmetry * scattering) / (weight @ scattering)
        lost = abs((q_ext - q_sca) / exact_abs - 1.0) if exact_abs > 0 else q_ext - q_sca
        errors[number] = abs(q_sca / exact_sca - 1.0), lost, abs(g - exact_g)
    scattering, absorption, asymmetry = errors.max(axis=0).tolist()
    return scattering, absorption, asymmetry
