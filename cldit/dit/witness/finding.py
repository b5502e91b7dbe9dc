"""Result of one witness, and the rule by which it ends the evaluation."""

from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass

from cldit.acquisition.witness_names import ACCEPTABLE, Acceptable
from cldit.errors import EvaluationError

LIMIT_K = 3.0  # of the black body: an evaluation beyond it needs the user's consent
WORTH_K = 0.05  # smaller findings widen the errors without a warning


@dataclass(frozen=True, kw_only=True)
class Witness:
    """Result of one comparison.

    name: for `accept`. compared: the comparison. says: the finding; empty if there is none. causes:
    those that fit it, the best first.
    remedy: what keeps a right result. setpoints, kelvin, noise_K: by background, in kelvin of the
    black body, if any. stands_out: far beyond its noise. severe: the evaluation ends unless the
    name is accepted.
    """

    name: Acceptable
    compared: str = ""
    says: str = ""
    causes: tuple[str, ...] = ()
    remedy: str = "correct the data"
    setpoints: tuple[float, ...] = ()
    kelvin: tuple[float, ...] = ()
    noise_K: tuple[float, ...] = ()
    stands_out: bool = False
    severe: bool = False

    @property
    def text(self) -> str:
        """Line for the report: `compared: 423 K +0.01 ± 0.02 K, ..; says`."""
        values = by_background(self.setpoints, self.kelvin, self.noise_K)
        parts = "; ".join(part for part in (values, self.says) if part)
        return f"{self.compared}: {parts}" if self.compared else parts

    def to_dict(self) -> dict[str, object]:
        """Plain data, with `text`."""
        return {**asdict(self), "text": self.text}


def refusal(name: Acceptable, message: str, remedy: str = "correct the data") -> Witness:
    """A finding that ends the evaluation unless its name is accepted."""
    return Witness(name=name, says=message, remedy=remedy, stands_out=True, severe=True)


def by_background(
    setpoints: Sequence[float], kelvin: Sequence[float], noise_K: Sequence[float]
) -> str:
    """Text of values by background, `423 K +0.01 ± 0.02 K, ...`."""
    return ", ".join(
        f"{setpoint:g} K {value:+.2f} ± {noise:.2f} K"
        for setpoint, value, noise in zip(setpoints, kelvin, noise_K, strict=True)
    )


def refuse(witnesses: Sequence[Witness], accept: Collection[str]) -> None:
    """Ends the evaluation if a witness is severe and not accepted."""
    unknown = sorted(set(accept) - set(ACCEPTABLE))
    if unknown:
        raise EvaluationError(f"accept: {', '.join(unknown)}; allowed: {', '.join(ACCEPTABLE)}")
    severe = [witness for witness in witnesses if witness.severe and witness.name not in accept]
    if severe:
        names = ", ".join(dict.fromkeys(witness.name for witness in severe))
        remedies = "; ".join(dict.fromkeys(witness.remedy for witness in severe))
        raise EvaluationError(
            "\n".join(witness.text for witness in severe)
            + f"\n{remedies}; `accept: [{names}]` (--accept) evaluates the data as they are"
        )
