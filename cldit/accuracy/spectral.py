"""The spectral part of a run: a trace for each node, what comes of them, and where it is kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from cldit.dit.maps import Maps
from cldit.gpu.device import Device
from cldit.medium.octree import Octree
from cldit.optics.node_count import stays_K
from cldit.optics.spectral import Quadrature
from cldit.optics.visible import VISIBLE_EMISSIVITY
from cldit.prepare.stages import Stage
from cldit.radiance.effective import effective_weights
from cldit.radiance.weights import Weights
from cldit.scene import Scene
from cldit.transport.energy_balance import EnergyBalance
from cldit.transport.phase import ScatteringTable
from cldit.transport.result import Audit
from cldit.transport.trace import Settings, Trace, settings_for, trace


@dataclass(frozen=True)
class Difference:
    """Difference of two maps of one scene, over the pixels of emissivity above 0.05 in both."""

    rms_K: float
    mean_K: float
    mean_emissivity: float
    pixels: int

    @classmethod
    def of(cls, maps: Maps, other: Maps) -> Difference | None:
        """`maps` minus `other`; None where no pixel has a temperature in both."""
        here = (maps.emissivity > VISIBLE_EMISSIVITY) & (other.emissivity > VISIBLE_EMISSIVITY)
        difference_K = maps.apparent_temperature_K.astype(float) - other.apparent_temperature_K
        here &= np.isfinite(difference_K)
        if not here.any():
            return None
        emissivity = maps.emissivity.astype(float) - other.emissivity
        return cls(
            rms_K=float(np.sqrt(np.mean(difference_K[here] ** 2))),
            mean_K=float(np.mean(difference_K[here])),
            mean_emissivity=float(np.mean(emissivity[here])),
            pixels=int(here.sum()),
        )


@dataclass(frozen=True)
class SpectralInfo:
    """How the filter was resolved.

    errors_K: estimated RMS error in T_app with 1, 2, .. nodes, on lines of sight through the spray;
    empty where one node is exact. nodes: mean wavelength, um, and share of the light at
    `reference_K` of those that were traced. from_paper: this run minus the same scene with the
    paper's optical properties.
    """

    reference_K: float
    nodes: tuple[tuple[float, float], ...]
    errors_K: tuple[float, ...] = ()
    from_paper: Difference | None = None

    @property
    def error_K(self) -> float:
        """Estimated error of the nodes that were traced: the largest from their number on."""
        return stays_K(self.errors_K, len(self.nodes)) if self.errors_K else 0.0

    @classmethod
    def of(
        cls, quadrature: Quadrature, errors_K: Sequence[float], from_paper: Difference | None
    ) -> SpectralInfo:
        """What a report says of the nodes.

        Args:
            quadrature: the nodes.
            errors_K: (M,) of the choice of wavelengths.
            from_paper: difference from the paper's optics, where that was asked for.
        """
        at = quadrature.reference_K
        nodes = tuple((node.wavelength_um, float(node.share(at))) for node in quadrature.nodes)
        return cls(at, nodes, tuple(errors_K), from_paper)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON; `from_dict` reads it."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> SpectralInfo:
        """Reads what `to_dict` gave."""
        other = data["from_paper"]
        return cls(
            float(data["reference_K"]),
            tuple((float(um), float(share)) for um, share in data["nodes"]),
            tuple(float(error) for error in data["errors_K"]),
            None if other is None else Difference(**other),
        )


@dataclass(frozen=True)
class NodeTraces:
    """Traces of all nodes, and their sums: weights and their errors for the whole filter.

    difference, audit: as in `Trace`; what a node does exactly adds nothing. None where a node does
        not know its own, or where nothing scatters.
    """

    traces: tuple[Trace, ...]
    weights: Weights
    difference: Weights | None
    audit: Audit | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)

    @property
    def scatters(self) -> bool:
        """Whether anything does."""
        return any(result.scatters for result in self.traces)

    @property
    def unaudited(self) -> tuple[str, ...]:
        """Why the error of traces is known in part only, each reason once."""
        return tuple(dict.fromkeys(one.unaudited for one in self.traces if one.unaudited))

    @property
    def short(self) -> tuple[str, ...]:
        """Where traces stopped short of the wanted accuracy, each once."""
        return tuple(dict.fromkeys(one.short for one in self.traces if one.short))

    @property
    def closure(self) -> EnergyBalance | None:
        """The worst of all nodes'."""
        found = [result.closure for result in self.traces if result.closure is not None]
        return max(found, key=lambda one: abs(one.largest), default=None)

    @property
    def spectral(self) -> tuple[Weights, ...]:
        """Weights of each node."""
        return tuple(result.weights for result in self.traces)


def node_settings(
    scene: Scene, quadrature: Quadrature, phases: Sequence[ScatteringTable | None]
) -> list[Settings]:
    """How each node is traced, so that all together are as accurate as the scene asks for.

    The nodes get directions of their own, so that their errors are independent, and the picture,
    their sum, has less of them: K nodes of equal light need some K^-3/4 of the directions that one
    needs (a trace's error falls with their number to the power of about 2/3).

    Args:
        scene: what is traced.
        quadrature: its nodes.
        phases: phase function of each node; None is isotropic.

    Returns:
        Settings of each node.
    """
    spec = scene.transport
    light = np.array([float(node.share(quadrature.reference_K)) for node in quadrature.nodes])
    nodes = 1.0 / float(np.sum(light**2))
    out = []
    for number, phase in enumerate(phases):
        one = settings_for(scene, phase)
        final = one.final_directions
        if spec.directions is None and len(phases) > 1:
            final = min(final, max(32, 8 * round(final / 8 * nodes**-0.75)))
        out.append(
            replace(
                one,
                directions=min(one.directions, final // 2),
                final_directions=final,
                accuracy_K=one.accuracy_K * nodes**0.5,
                seed=one.seed + number,
            )
        )
    return out


def trace_nodes(
    trees: list[Octree],
    quadrature: Quadrature,
    scene: Scene,
    device: Device,
    settings: Sequence[Settings],
    *,
    report: Callable[[str], None] | None,
) -> NodeTraces:
    """Traces each node; the list of trees is emptied as it goes, so that memory holds few of them.

    Args:
        trees: medium of each node.
        quadrature: the nodes.
        scene, device: as in `trace`.
        settings: of each node.
        report: takes messages.

    Raises:
        TransportError, DeviceError, KernelError: as `trace`.
    """
    total = len(trees)
    traces: list[Trace] = []
    for number in range(total):
        if report is not None and total > 1:
            report(f"wavelength {number + 1} of {total}")
        # All nodes' errors in the same pixels, where they add as they do in the picture.
        drawn = next((one.audit.sample for one in traces if one.audit is not None), None)
        traces.append(
            trace(trees.pop(0), scene, device, settings[number], report=report, audit_sample=drawn)
        )
    return summed(traces, quadrature, scene)


def summed(traces: Sequence[Trace], quadrature: Quadrature, scene: Scene) -> NodeTraces:
    """Traces of all nodes with what they give together.

    Args:
        traces: of each node.
        quadrature: the nodes.
        scene: whose temperatures of walls and patches weigh the nodes.

    Returns:
        The traces and their sums.
    """
    seconds: dict[str, float] = {}
    counts: dict[str, int] = {}
    for result in traces:
        for name, value in result.seconds.items():
            seconds[name] = seconds.get(name, 0.0) + value
        for name, total in result.counts.items():
            # Sweeps add up; the numbers of cells are the same in all nodes.
            counts[name] = counts.get(name, 0) + total if name == "sweeps" else total

    def combined(parts: Sequence[Weights]) -> Weights:
        return effective_weights(
            parts,
            quadrature.nodes,
            background_K=quadrature.reference_K,
            wall_K=scene.walls.temperature_K,
            patches_K={patch.name: patch.temperature_K for patch in scene.patches},
        )

    def error(parts: Sequence[Weights | None]) -> Weights | None:
        """Error of the sum; None where a node that scatters does not know its own."""
        some = next((one for one in parts if one is not None), None)
        known = [one is not None or not t.scatters for one, t in zip(parts, traces, strict=True)]
        if some is None or not all(known):
            return None
        nothing = some.map(np.zeros_like)
        return combined([nothing if one is None else one for one in parts])

    found = [result.audit for result in traces]
    sample = next((audit.sample for audit in found if audit is not None), None)
    one, other = (
        error([None if audit is None else audit.errors[half] for audit in found]) for half in (0, 1)
    )
    audit = None
    if sample is not None and one is not None and other is not None:
        audit = Audit(sample, (one, other))
    return NodeTraces(
        traces=tuple(traces),
        weights=combined([result.weights for result in traces]),
        difference=error([result.weights_difference for result in traces]),
        audit=audit,
        seconds=seconds,
        counts=counts,
    )


def traced_stages(result: NodeTraces, order: int | None) -> list[Stage]:
    """What the traces did, step by step, and how long it took.

    Args:
        result: of all wavelengths.
        order: of scattering, at which the trace ended; None: it did not.

    Returns:
        The steps in the order in which they are done.
    """
    counts = result.counts
    iterations = [one.solution.iterations for one in result.traces if one.solution is not None]
    samples = f"{counts['samples']} samples a pixel" if "samples" in counts else ""
    notes = {
        "audit": "of some pixels, by path tracing",
        "gather": samples,
        "subpixels": "more rays through some pixels",
    }
    scattering = []
    if order is not None:
        scattering.append(f"up to order {order}, beyond it the wall is seen")
    if iterations:
        scattering.append(f"{counts['sweeps']} sweeps; {sum(iterations)} iterations")
    if "gather" not in result.seconds and samples:
        scattering.append(samples)
    if "scattered_rays" in counts:
        scattering.append(f"{counts['scattered_rays']} rays started by scattering")
    notes["scattering"] = "; ".join(scattering)
    usual = ("compile", "scattering", "image")
    others = ("gather", "audit", "subpixels")
    steps = [*usual, *(name for name in others if name in result.seconds)]
    return [
        Stage(name, result.seconds[name], notes.get(name, ""))
        if name in result.seconds
        else Stage(name, 0.0, "left out: nothing scatters")
        for name in steps
    ]
