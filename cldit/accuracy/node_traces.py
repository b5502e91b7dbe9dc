"""Traces of the nodes of the filter: their settings, and their sum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from cldit.arrays import Ints
from cldit.optics.spectral import Quadrature
from cldit.prepare.stages import Stage
from cldit.radiance.effective import effective_weights
from cldit.radiance.point_spread import blur_of
from cldit.radiance.weights import Weights
from cldit.scene import Scene
from cldit.transport.energy_balance import EnergyBalance
from cldit.transport.phase import ScatteringTable
from cldit.transport.result import Audit
from cldit.transport.trace import Trace, TraceSettings, settings_for


@dataclass(frozen=True)
class NodeTraces:
    """Traces of all nodes, and their sums: weights and their errors for the whole filter.

    spectral: weights of each node; they and their sum have the point spread of the lens, which
    `traces`, difference and audit have not. difference, audit: as in `Trace`; exact nodes add
    nothing. None if a node has no estimate of its own, or if nothing scatters.
    """

    traces: tuple[Trace, ...]
    spectral: tuple[Weights, ...]
    weights: Weights
    difference: Weights | None
    audit: Audit | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)

    @property
    def scatters(self) -> bool:
        """True if anything scatters."""
        return any(result.scatters for result in self.traces)

    @property
    def unaudited(self) -> tuple[str, ...]:
        """Reasons why the error of traces is known in part only, each once."""
        return tuple(dict.fromkeys(result.unaudited for result in self.traces if result.unaudited))

    @property
    def short(self) -> tuple[str, ...]:
        """Remarks on traces that stopped short of the accuracy asked for, each once."""
        return tuple(dict.fromkeys(result.short for result in self.traces if result.short))

    @property
    def closure(self) -> EnergyBalance | None:
        """The largest residual of all nodes."""
        balances = [result.closure for result in self.traces if result.closure is not None]
        return max(balances, key=lambda balance: abs(balance.largest), default=None)

    @property
    def rays(self) -> Ints | None:
        """(H, W) rays across each pixel, the same for all nodes; None: those of the scene."""
        return self.traces[0].rays


def node_settings(
    scene: Scene,
    quadrature: Quadrature,
    phases: Sequence[ScatteringTable | None],
    *,
    tolerance_K: float | None = None,
    more_ordinates: float = 1.0,
) -> list[TraceSettings]:
    """Settings of each node's trace, with which the sum of all is as accurate as asked for.

    The nodes get directions of their own, so that their errors are independent, and partly cancel
    in the sum: K nodes of equal light need some K^-3/4 of the directions that one needs (the error
    of a trace falls with their number to the power of about 2/3). `tolerance_K` is the error of
    the sum; None: the scene's. `more_ordinates` multiplies the ordinates that it needs.
    """
    spec = scene.transport
    light = np.array([float(node.share(quadrature.reference_K)) for node in quadrature.nodes])
    nodes = 1.0 / float(np.sum(light**2))
    out = []
    for number, phase in enumerate(phases):
        setting = settings_for(scene, phase, tolerance_K=tolerance_K)
        final = setting.final_directions
        if spec.directions is None and len(phases) > 1:
            final = min(final, max(32, 8 * round(final / 8 * nodes**-0.75)))
        final = round(final * more_ordinates)
        out.append(
            replace(
                setting,
                directions=min(round(setting.directions * more_ordinates), final // 2),
                final_directions=final,
                accuracy_K=setting.accuracy_K * nodes**0.5,
                seed=setting.seed + number,
            )
        )
    return out


def summed(traces: Sequence[Trace], quadrature: Quadrature, scene: Scene) -> NodeTraces:
    """Traces of all nodes and their sums, for the scene's temperatures of walls and patches."""
    seconds = {name: 0.0 for result in traces for name in result.seconds}
    counts = {name: number for result in traces for name, number in result.counts.items()}
    if "sweeps" in counts:  # which add up; the numbers of cells are the same in all nodes
        counts["sweeps"] = sum(result.counts.get("sweeps", 0) for result in traces)
    for result in traces:
        for name, value in result.seconds.items():
            seconds[name] += value

    def combined(parts: Sequence[Weights]) -> Weights:
        return effective_weights(
            parts,
            quadrature.nodes,
            background_K=quadrature.reference_K,
            wall_K=scene.walls.temperature_K,
            patches_K={patch.name: patch.temperature_K for patch in scene.patches},
        )

    def error(parts: Sequence[Weights | None]) -> Weights | None:
        """Error of the sum; None if a node that scatters has no estimate of its own."""
        present = next((weights for weights in parts if weights is not None), None)
        pairs = zip(parts, traces, strict=True)
        complete = [weights is not None or not t.scatters for weights, t in pairs]
        if present is None or not all(complete):
            return None
        nothing = present.map(np.zeros_like)
        return combined([nothing if weights is None else weights for weights in parts])

    audits = [result.audit for result in traces]
    sample = next((audit.sample for audit in audits if audit is not None), None)
    error_a, error_b = (
        error([None if audit is None else audit.errors[n] for audit in audits]) for n in (0, 1)
    )
    audit = None
    if sample is not None and error_a is not None and error_b is not None:
        audit = Audit(sample, (error_a, error_b))
    blur = blur_of(scene)
    spectral = tuple(blur(result.weights) for result in traces)
    return NodeTraces(
        traces=tuple(traces),
        spectral=spectral,
        weights=combined(spectral),
        difference=error([result.weights_difference for result in traces]),
        audit=audit,
        seconds=seconds,
        counts=counts,
    )


def traced_stages(result: NodeTraces, order: int | None) -> list[Stage]:
    """Steps of the traces in order, with times; `order` of scattering is the last, None: all."""
    counts = result.counts
    iterations = [node.iterations for node in result.traces if node.iterations is not None]
    samples = f"{counts['samples']} samples a pixel" if "samples" in counts else ""
    notes = {"audit": "of some pixels, by path tracing", "gather": samples}
    if result.rays is not None:
        number = result.rays**2
        notes["image"] = f"{number.mean():.3g} rays a pixel, up to {number.max()}"
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
    optional = (name for name in ("gather", "audit") if name in result.seconds)
    return [
        Stage(name, result.seconds[name], notes.get(name, ""))
        if name in result.seconds
        else Stage(name, 0.0, "skipped: nothing scatters")
        for name in ("compile", "scattering", "image", *optional)
    ]
