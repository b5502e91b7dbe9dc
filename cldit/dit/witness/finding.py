"""What one witness says, and when the evaluation ends because of it."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass

from scipy.special import ndtri, stdtrit

from cldit.acquisition.witness_names import ACCEPTABLE, Acceptable
from cldit.errors import EvaluationError

LIMIT_K = 3.0  # of the black body: an evaluation beyond it needs the user's word
WORTH_K = 0.05  # below it a finding widens the errors and is no alarm
_CHANCE = 3e-7  # one side of five standard deviations


@dataclass(frozen=True, kw_only=True)
class Witness:
    """What one comparison found.

    name: by which `accept` lets it pass. compared: with what. says: what it names; empty where
    nothing stands out. setpoints, kelvin, noise_K: by background, of the black body's temperature;
    empty where nothing is in kelvin. stands_out: far beyond its noise. severe: the evaluation ends
    unless the name is accepted.
    """

    name: Acceptable
    compared: str = ""
    says: str = ""
    setpoints: tuple[float, ...] = ()
    kelvin: tuple[float, ...] = ()
    noise_K: tuple[float, ...] = ()
    stands_out: bool = False
    severe: bool = False

    @property
    def text(self) -> str:
        """A line for the reader: `compared: 423 K +0.01 ± 0.02 K, ..; says`."""
        found = by_background(self.setpoints, self.kelvin, self.noise_K)
        said = "; ".join(one for one in (found, self.says) if one)
        return f"{self.compared}: {said}" if self.compared else said

    def to_dict(self) -> dict[str, object]:
        """All of it, `text` included."""
        return {**asdict(self), "text": self.text}


def sure(degrees: int) -> float:
    """How many standard errors are no chance, where the error comes from so many degrees."""
    return -float(stdtrit(degrees, _CHANCE) if degrees > 0 else ndtri(_CHANCE))


def by_background(
    setpoints: Sequence[float], kelvin: Sequence[float], noise_K: Sequence[float]
) -> str:
    """`423 K +0.01 ± 0.02 K, ...`.

    Args:
        setpoints: K of them.
        kelvin, noise_K: K values and their noise.
    """
    return ", ".join(
        f"{setpoint:g} K {value:+.2f} ± {noise:.2f} K"
        for setpoint, value, noise in zip(setpoints, kelvin, noise_K, strict=True)
    )


def refuse(witnesses: Sequence[Witness], accept: Collection[str]) -> None:
    """Ends the evaluation where a witness is severe and not accepted.

    Args:
        witnesses: all of them.
        accept: names that pass.

    Raises:
        EvaluationError: says what was found and how to go on all the same; or a name is unknown.
    """
    unknown = sorted(set(accept) - set(ACCEPTABLE))
    if unknown:
        raise EvaluationError(f"accept: {', '.join(unknown)}; allowed are {', '.join(ACCEPTABLE)}")
    found = [one for one in witnesses if one.severe and one.name not in accept]
    if found:
        names = ", ".join(dict.fromkeys(one.name for one in found))
        raise EvaluationError(
            "\n".join(one.text for one in found)
            + f"\nmend the data; or write `accept: [{names}]` (--accept) to evaluate all the same"
        )
