"""Spread of the model itself: how far T_app moves with what is assumed, not computed.

It is no error of the simulation, and is stated beside it, never in the sum.
"""

from __future__ import annotations

from cldit.accuracy.errors import Cause
from cldit.run.spectral import Difference
from cldit.scene import Scene
from cldit.scene.spray import ConeSpray, LagrangianSpray


def model_spread(scene: Scene, from_paper: Difference | None) -> tuple[Cause, ...]:
    """Spread by the spray model, and by optical data where the paper's were traced as well."""
    if isinstance(scene.spray, ConeSpray | LagrangianSpray):
        how = (
            "which spray model: compare `cldit run gdi` and `cldit run gdi-flow`, or `cldit study`"
        )
        spray = Cause("spray model", None, how)
    else:
        spray = Cause("spray model", None, "the spray is given; its own model says")
    if from_paper is None:
        how = "which n, k and vapour: optics.preset: spectral compares them with the paper's"
        return (spray, Cause("optical data", None, how))
    return (
        spray,
        Cause("optical data", from_paper.rms_K, "RMS against the paper's n, k and vapour"),
    )
