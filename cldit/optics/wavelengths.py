"""Choice of the spectral nodes of a spray, by their errors along lines of sight.

Samples of the filter are grouped so that lines of sight through the spray have similar transmission
and emission within a group. The samples, once in order of wavelength and once in order of opacity,
are divided into K groups with the least variance over a dozen lines of sight (exactly, by dynamic
programming). The properties of a group are means over its light. T_app and emissivity of some
hundred lines of sight with K nodes and with all samples give the errors of K nodes, and the
smallest K within the bound is chosen.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from cldit.arrays import Floats
from cldit.errors import OpticsError
from cldit.io.content import code_digest
from cldit.io.tables import Arrays, cached, digest
from cldit.optics import mie
from cldit.optics.band import BandOptics, Droplets
from cldit.optics.droplets import droplet_table
from cldit.optics.line_radiance import Glow, belongs, emitted
from cldit.optics.node_count import AHEAD, enough, stays_K
from cldit.optics.response import Filter, edges_um, scene_filter
from cldit.optics.scene_phase import scene_phase
from cldit.optics.sightlines import Sightlines
from cldit.optics.spectral import Quadrature, SpectralNode, reference_temperature_K
from cldit.optics.spectrum import Spectrum, fuel_of
from cldit.optics.tolerance import kelvin_per_emissivity
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.scene.optics import Optics
from cldit.scene.schema import Scene
from cldit.spray.result import Spray

Groups = NDArray[np.intp]

MOST_NODES = 24  # unless the scene asks for more
PAPER_UM = (3.3, 3.5)  # filter of the paper, whose constants are means over it
_TYPICAL = 12  # lines of sight that groups are made by


@dataclass(frozen=True)
class Wavelengths:
    """The chosen nodes with the optical properties in each.

    errors_K: RMS error of T_app along lines of sight with 1, 2, .. nodes; empty if one is exact.
    errors_emissivity: likewise of emissivity.
    main: number of the node in which the spray hides or sends most light of these lines.
    """

    quadrature: Quadrature
    bands: tuple[BandOptics, ...]
    errors_K: tuple[float, ...] = ()
    main: int = 0
    errors_emissivity: tuple[float, ...] = ()

    @property
    def nodes(self) -> tuple[SpectralNode, ...]:
        """The nodes, in order."""
        return self.quadrature.nodes

    @property
    def error_K(self) -> float:
        """Estimated RMS error of T_app due to the nodes; 0 if one node is exact."""
        return stays_K(self.errors_K, len(self.nodes)) if self.errors_K else 0.0

    @property
    def error_emissivity(self) -> float:
        """Likewise of emissivity."""
        return stays_K(self.errors_emissivity, len(self.nodes)) if self.errors_K else 0.0


def _kept(optics: Optics, spray: Spray) -> tuple[str, ...]:
    """Keys of the constants of preset `paper` that a spray needs and a scene does not give."""
    droplets, gas = _phases(spray)
    keys = (("n", "k") if droplets else ()) + (("vapour_m2_mol",) if gas else ())
    defaults = Optics()
    return tuple(key for key in keys if getattr(optics, key) == getattr(defaults, key))


def _phases(spray: Spray) -> tuple[bool, bool]:
    """True for droplets, and for gas, with optical properties by wavelength."""
    droplets = spray.parcels is not None and len(spray.parcels.diameter_m) > 0
    gas = spray.vapour is not None and bool(np.any(spray.vapour.number_density_m3 > 0))
    return droplets, gas


def elsewhere(scene: Scene, spray: Spray) -> tuple[str, ...]:
    """Remark that constants of preset `paper` are used at wavelengths far from the paper's."""
    optics, (low, high) = scene.optics, edges_um(scene_filter(scene))
    if optics.preset != "paper" or not any(_phases(spray)):
        return ()
    out = []
    if not low <= optics.wavelength_um <= high:
        out.append(
            f"optics.wavelength_um: {optics.wavelength_um:g} is outside the filter, {low:g} to "
            f"{high:g} um; optical properties are those of that wavelength"
        )
    kept = _kept(optics, spray)
    # Further than 0.1 um beyond the paper's filter the C-H band has other constants.
    beyond = max(PAPER_UM[0] - low, high - PAPER_UM[1]) > 0.1
    foreign = any(key in kept for key in ("n", "k")) and not (
        PAPER_UM[0] <= optics.wavelength_um <= PAPER_UM[1]
    )
    if kept and (beyond or foreign):
        where = f"{low:g} to {high:g} um" if beyond else f"{optics.wavelength_um:g} um"
        out.append(
            f"optics.{', optics.'.join(kept)}: the paper's constants, for {PAPER_UM[0]:g} to "
            f"{PAPER_UM[1]:g} um, are used at {where}; give those of the filter, or `preset: "
            "spectral`"
        )
    return tuple(out)


def _check_constants(scene: Scene, spray: Spray) -> None:
    """Refuses n-heptane's constants for another fuel."""
    kept, fuel = _kept(scene.optics, spray), fuel_of(scene, spray)
    if kept and fuel != "n-heptane":
        raise OpticsError(
            f"optics.{', optics.'.join(kept)}: the constants of preset `paper` are those of "
            f"n-heptane, and the fuel is {fuel}; give those of the fuel, or `preset: spectral`, "
            "with optics.liquid or optics.vapour if no data of it are shipped"
        )


def wavelengths(
    scene: Scene,
    spray: Spray,
    *,
    cache: Path | None,
    paper: bool = False,
    tolerance_K: float | None = None,
) -> Wavelengths:
    """Nodes for a scene: one with the preset `paper` and for sprays given as coefficients (grey).

    Args:
        cache: folder for Mie tables; None builds them anew.
        paper: True: the paper's properties, whatever the preset of the scene.
        tolerance_K: RMS error of T_app that the nodes may leave; None: that of the scene.
    """
    filter_um = scene_filter(scene)
    reference_K = reference_temperature_K(scene.background.temperatures_K)
    droplets, gas = _phases(spray)
    largest_m = float(spray.parcels.diameter_m.max()) if droplets and spray.parcels else 0.0
    if not paper and scene.optics.preset == "paper":
        _check_constants(scene, spray)
    if paper or scene.optics.preset == "paper" or not (droplets or gas):
        band = BandOptics.paper(scene.optics, filter_um, largest_m=largest_m, cache=cache)
        return Wavelengths(Quadrature.grey(filter_um, reference_K=reference_K), (band,))
    spectrum = Spectrum.of(scene, spray, filter_um)
    asymmetry = scene_phase(scene, spray, "spectral").asymmetry
    bound_K = scene.optics.bound_K if tolerance_K is None else tolerance_K

    def choose() -> Arrays:
        lines = Sightlines.through(spray, width_m=scene.domain.leaf_m)
        light = _light(spectrum, filter_um, reference_K)
        depths = _depths(spectrum, lines, asymmetry)
        groups, errors = _chosen(scene, bound_K, lines, spectrum, light, depths)
        through = emitted([_mean(depth, groups, light) for depth in depths])[0]
        hidden = (lines.count @ (1.0 - through)) * (light @ belongs(groups))
        choice = {"groups": groups.astype(float), "errors": errors}
        main = np.array([float(np.argmax(hidden))])
        return {**choice, "main": main, **_means(spectrum, lines, groups, light)}

    content = _content(scene, tolerance_K, spray, spectrum, asymmetry)
    arrays = cached(cache, kind="wavelengths", description=content, make=choose)
    quadrature = _quadrature(spectrum, arrays["groups"].astype(np.intp), filter_um, reference_K)
    names = ("wavelength_um", "vapour_m2_mol", "n", "k")
    means = zip(*(arrays[name].T for name in names), strict=True)
    bands = tuple(
        BandOptics(
            radiance=node.radiance,
            vapour_m2_mol=_absorption(spectrum.vapour_K, absorption),
            droplets=_tables(
                spectrum.liquid_K, wavelength_um, n, k, largest_m=largest_m, cache=cache
            ),
        )
        for node, (wavelength_um, absorption, n, k) in zip(quadrature.nodes, means, strict=True)
    )
    errors_K, errors_emissivity = map(tuple, arrays["errors"].tolist())
    main = int(arrays["main"][0])
    return Wavelengths(quadrature, bands, errors_K, main, errors_emissivity)


def _content(
    scene: Scene,
    tolerance_K: float | None,
    spray: Spray,
    spectrum: Spectrum,
    asymmetry: float | None,
) -> str:
    """Digest of everything that the choice of wavelengths depends on."""
    arrays = [*vars(spectrum).values()]
    if spray.parcels is not None:
        p = spray.parcels
        arrays += [p.position_m, p.diameter_m, p.droplets, p.temperature_K]
    if spray.vapour is not None:
        gas = spray.vapour
        arrays += [gas.cells.lower_m, gas.cells.upper_m, gas.number_density_m3, gas.temperature_K]
    sensor = scene.camera.sensor
    optics = scene.optics.model_dump()
    if tolerance_K is not None:
        optics["spectral_error_K"] = tolerance_K
    where = (optics, sensor.quantum_efficiency, scene.background.temperatures_K)
    per_K = kelvin_per_emissivity(scene)
    further = (scene.walls.temperature_K, scene.domain.leaf_m, asymmetry)
    return f"{code_digest('optics')} {where!r} {further!r} {per_K!r} {digest(*arrays)}"


def _light(spectrum: Spectrum, filter_um: Filter, reference_K: float) -> Floats:
    """(S,) light of a black body in every sample."""
    count = len(spectrum.part)
    fine = _quadrature(spectrum, np.arange(count), filter_um, reference_K)
    return np.asarray(np.array(fine.members) @ fine.light)


def _quadrature(
    spectrum: Spectrum, groups: Groups, filter_um: Filter, reference_K: float
) -> Quadrature:
    members = spectrum.members(groups, int(groups.max()) + 1)
    return Quadrature(
        filter_um,
        tuple(spectrum.edges_um.tolist()),
        tuple(tuple(row) for row in members.tolist()),
        reference_K,
    )


def _means(spectrum: Spectrum, lines: Sightlines, groups: Groups, light: Floats) -> Arrays:
    """Properties of K groups of samples by name; (K,), and (M, K) or (P, K) as in `Spectrum`."""
    wavelength = _mean(spectrum.middles_um[None, :], groups, light)[0]
    n = _mean(spectrum.n, groups, light)
    k = _mean(spectrum.k, groups, light)
    sizes = lines.count @ lines.droplet_m2.sum(axis=1)
    for row in range(len(spectrum.liquid_K)):
        fine = _efficiencies(spectrum.middles_um, spectrum.n[row], spectrum.k[row], lines)[0]
        targets = _mean((sizes @ fine)[None, :], groups, light)[0]
        for group, target in enumerate(targets):
            fitted_k = _index_absorbing(
                target,
                sizes,
                lines,
                wavelength_um=wavelength[group],
                n=n[row, group],
                among=spectrum.k[row, groups == group],
            )
            k[row, group] = k[row, group] if fitted_k is None else fitted_k
    vapour = _mean(spectrum.vapour_m2_mol, groups, light)
    return {"wavelength_um": wavelength, "vapour_m2_mol": vapour, "n": n, "k": k}


def _absorption(vapour_K: Floats, values: Floats) -> Callable[[Floats], Floats]:
    """Molar absorption over the temperature, from values (M,) at temperatures (M,); 0 without."""
    knots, values = (vapour_K, values) if len(vapour_K) else np.zeros((2, 1))
    return partial(_between, knots, values)


def _tables(
    liquid_K: Floats,
    wavelength_um: float,
    n: Floats,
    k: Floats,
    *,
    largest_m: float,
    cache: Path | None,
) -> Droplets | None:
    """Droplets up to `largest_m` with indices n - ik (P,) at temperatures (P,); None without."""
    tables = [
        droplet_table(
            wavelength_um=float(wavelength_um),
            n=float(real),
            k=float(imaginary),
            cache=cache,
            largest_m=largest_m,
        )
        for real, imaginary in zip(n, k, strict=True)
    ]
    return Droplets(liquid_K, tuple(tables)) if tables else None


def _between(knots_K: Floats, values: Floats, temperature_K: Floats) -> Floats:
    return np.asarray(np.interp(temperature_K, knots_K, values))


def _mean(values: Floats, groups: Groups, light: Floats) -> Floats:
    """(..., K) means of (..., S) over the light of each group."""
    weight = belongs(groups) * light[:, None]
    return np.asarray(values @ (weight / weight.sum(axis=0)))


def _efficiencies(
    wavelength_um: Floats,
    n: Floats,
    k: Floats,
    lines: Sightlines,
    *,
    asymmetry: float | None = None,
) -> tuple[Floats, Floats]:
    """Q_abs and (1 - g) Q_sca (D, S) of the lines' sizes, one refractive index a wavelength.

    Light scattered forward is not lost from a line: by similarity, droplets scatter like isotropic
    ones of (1 - g) Q_sca. asymmetry: g; None: by Mie's theory.
    """
    absorbed, turned = np.zeros((2, len(lines.diameter_m), len(wavelength_um)))
    for sample, index in enumerate(zip(wavelength_um, n, k, strict=True)):
        x = np.pi * lines.diameter_m / (index[0] * 1e-6)
        solved = mie.efficiencies(n=float(index[1]), k=float(index[2]), x=x)
        g = solved.asymmetry if asymmetry is None else asymmetry
        absorbed[:, sample], turned[:, sample] = solved.absorption, (1.0 - g) * solved.scattering
    return absorbed, turned


def _index_absorbing(
    target: float,
    sizes_m2: Floats,
    lines: Sightlines,
    *,
    wavelength_um: float,
    n: float,
    among: Floats,
) -> float | None:
    """The k within `among` that absorbs `target`, sum of Q_abs over sizes; None if none does."""

    def too_much(k: float) -> float:
        at = np.array([wavelength_um]), np.array([n]), np.array([k])
        return float(sizes_m2 @ _efficiencies(*at, lines)[0][:, 0]) - target

    low, high = float(among.min()), float(among.max())
    if not too_much(low) < 0.0 < too_much(high):
        return None
    return float(scipy.optimize.brentq(too_much, low, high, rtol=1e-6))


def _depths(
    spectrum: Spectrum, lines: Sightlines, asymmetry: float | None
) -> tuple[Floats, Floats, Floats]:
    """Optical depths (L, Y, S) of vapour absorption, droplet absorption and scattering."""
    count = len(spectrum.part)
    vapour = np.zeros((*lines.vapour_mol_m2.shape, count))
    if len(spectrum.vapour_K):
        for sample in range(count):
            vapour[..., sample] = _between(
                spectrum.vapour_K, spectrum.vapour_m2_mol[:, sample], lines.vapour_K
            )
        vapour *= lines.vapour_mol_m2[..., None]
    if not len(spectrum.liquid_K):
        return vapour, np.zeros_like(vapour), np.zeros_like(vapour)
    middle = len(spectrum.liquid_K) // 2
    absorbed, scattered = _efficiencies(
        spectrum.middles_um, spectrum.n[middle], spectrum.k[middle], lines, asymmetry=asymmetry
    )
    return vapour, lines.droplet_m2 @ absorbed, lines.droplet_m2 @ scattered


def _chosen(
    scene: Scene,
    bound_K: float,
    lines: Sightlines,
    spectrum: Spectrum,
    light: Floats,
    depths: tuple[Floats, Floats, Floats],
) -> tuple[Groups, Floats]:
    """The groups, and errors (2, K) of T_app and emissivity with 1, 2, .. K nodes, by the lines'
    optical depths (L, Y, S)."""
    filter_um = scene_filter(scene)
    reference_K = reference_temperature_K(scene.background.temperatures_K)
    samples = np.arange(len(light))
    glow = Glow.of(scene, lines, _quadrature(spectrum, samples, filter_um, reference_K))
    exact, emissivity = glow.apparent(depths, filter_um)
    seen = emissivity > min(VISIBLE_EMISSIVITY, 0.5 * float(emissivity.max()))
    parts = (np.arange(_TYPICAL) + 0.5) / _TYPICAL * lines.count.sum()
    typical = np.unique(np.searchsorted(np.cumsum(lines.count), parts))
    looks = _looks([depth[typical] for depth in depths])
    through = looks[: len(typical)].sum(axis=0)
    limit = min(max(scene.optics.wavelengths or 0, MOST_NODES), len(light))
    tried = min(limit + AHEAD, len(light))
    orders = [samples, np.argsort(-through, kind="stable")]
    cuts = [_cuts(looks[:, order], light[order], tried) for order in orders]
    groupings: list[Groups] = []
    errors: list[Floats] = []
    per_K = np.array([1.0, kelvin_per_emissivity(scene)])
    for count in range(1, tried + 1):
        tries = []
        for order, cut in zip(orders, cuts, strict=True):
            groups = np.empty(len(light), np.intp)
            groups[order] = np.repeat(np.arange(count), np.diff([*cut[count], len(light)]))
            vapour, absorbed, scattered = (_mean(depth, groups, light) for depth in depths)
            got = glow.gathered(groups).apparent((vapour, absorbed, scattered), filter_um)
            deviation = np.subtract(got, (exact, emissivity))[:, seen]
            square = np.average(deviation**2, axis=1, weights=lines.count[seen])
            tries.append((np.sqrt(square), groups))
        error, groups = min(tries, key=lambda pair: float(np.max(per_K * pair[0])))
        groupings.append(groups)
        errors.append(error)
    requested = scene.optics.wavelengths
    if requested is None:
        requested = enough(np.max(per_K * errors, axis=1), bound_K=bound_K, limit=limit)
    return groupings[min(requested, limit) - 1], np.transpose(errors)


def _looks(depths: list[Floats]) -> Floats:
    """(F, S): transmission and emission of typical lines in each sample."""
    through, (vapour, liquid, scattered) = emitted(depths)
    rows = [through, *vapour, *liquid, scattered.sum(axis=1)]
    return np.concatenate(rows)


def _cuts(looks: Floats, light: Floats, limit: int) -> list[list[int]]:
    """Best divisions of ordered samples into 1 .. `limit` groups.

    Entry K lists the first sample of each of K groups (entry 0 is empty). They minimise the
    light-weighted squared deviations of `looks` (F, S) from the groups' means exactly.
    """
    count = len(light)
    weight = np.concatenate([[0.0], np.cumsum(light)])
    within = weight[None, :] - weight[:, None]
    safe = np.where(within > 0, within, 1.0)
    cost = np.zeros((count + 1, count + 1))  # of a group from sample i up to, not with, sample j
    for values in looks:
        moment_1 = np.concatenate([[0.0], np.cumsum(light * values)])
        moment_2 = np.concatenate([[0.0], np.cumsum(light * values**2)])
        sums = moment_1[None, :] - moment_1[:, None]
        cost += (moment_2[None, :] - moment_2[:, None]) - sums**2 / safe
    cost[np.tri(count + 1, dtype=bool)] = np.inf  # no empty groups
    best = cost[0].copy()
    predecessors: list[NDArray[np.intp]] = []
    cuts: list[list[int]] = [[], [0]]
    for groups in range(2, limit + 1):
        total = best[:, None] + cost
        predecessors.append(total.argmin(axis=0))
        best = total.min(axis=0)
        starts = [count]
        for step in reversed(range(groups - 1)):
            starts.append(int(predecessors[step][starts[-1]]))
        cuts.append([0, *reversed(starts[1:])])
    return cuts
