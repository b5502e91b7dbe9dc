"""What a run states as its own error of T_app, and what it says where that is more than asked."""

from __future__ import annotations

from dataclasses import dataclass

from cldit.dit.accuracy import temperature_error_K
from cldit.dit.maps import Maps
from cldit.optics.response import scene_filter
from cldit.radiance.boundary import Surroundings
from cldit.run.spectral import NodeTraces
from cldit.scene import Scene
from cldit.scene.transport import Transport

# Where no audit tells what two pictures of `source` share, as what was solved for. On `gdi`, asked
# for 0.05 to 0.3 K, errors were 0.9 to 1.6 times what the pictures differ by.
_SHARED = 1.3


@dataclass(frozen=True)
class StatedError:
    """RMS errors of T_app.

    halves_K: from the difference of two pictures, each of half of the directions or samples; NaN
    where no pixel has a T_app. What pictures of `source` share is allowed for, if not audited.
    audit_K: from pixels that were traced by `path` as well, which sees what both pictures simplify;
    0 where none were.
    """

    halves_K: float
    audit_K: float = 0.0

    @classmethod
    def of(cls, scene: Scene, result: NodeTraces, maps: Maps) -> StatedError | None:
        """None where nothing scatters, and for `branching`, which does not know its error.

        Args:
            scene: what was traced.
            result: its traces.
            maps: of the same run.
        """
        if result.difference is None:
            return None
        halves = temperature_error_K(
            maps,
            result.difference,
            surroundings=Surroundings.from_scene(scene),
            filter_um=scene_filter(scene),
        )
        alone = scene.transport.method == "source" and not result.audit_K
        return cls(_SHARED * halves if alone else halves, result.audit_K)

    @property
    def error_K(self) -> float:
        """The larger of both errors [K]."""
        return max(self.halves_K, self.audit_K)

    def remarks(self, asked: Transport) -> tuple[str, ...]:
        """That the error, as it is printed, is more than `asked` for, what it is made of, and what
        can be done; nothing where it is not."""
        if not float(f"{self.error_K:.2g}") > asked.accuracy_K:
            return ()
        if asked.method == "source":
            finer = "a smaller transport.accuracy_K"
            if asked.directions is not None:
                finer = "more transport.directions"
            why = f"directions and chains make it; allowed is {finer}"
            if self.audit_K > self.halves_K:
                why = (
                    f"the audit by path tracing finds it, where directions and chains make some "
                    f"{self.halves_K:.2g} K; allowed is {finer} for that part, and "
                    "transport.method: path for the rest"
                )
        else:
            why = "it is the samples' noise; allowed is a larger transport.max_samples, or less "
            why += "accuracy"
        return (
            f"stated error {self.error_K:.2g} K RMS, more than transport.accuracy_K: "
            f"{asked.accuracy_K:g} asks for: {why}",
        )
