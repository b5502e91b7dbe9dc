"""Design of the experiment: backgrounds and numbers of shots that reach an error in the least time.

The trace gives the signals of every pixel for any background, the sensor their noise, and the scene
the scatter between injections. The two lines of a pixel (`cldit.dit.fit`) are fitted separately, so
with n injections and m references per background the variances of T_app and emissivity are exactly

    injections / n + references / m.

`Subject.variances` computes both numerators for a set of backgrounds from one fit without noise.
The rest is a search over sets, n and m for the least time. Both errors have a limit: with T_app
alone all backgrounds would be at the spray's own temperature, where shots of different amounts look
equal, and the emissivity would be unknown.
"""

import math
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np

from cldit.acquisition.plan import Plan, plan_from_scene
from cldit.arrays import Floats
from cldit.dit.outliers import LEAST_SHOTS
from cldit.dit.subject import Subject
from cldit.errors import EvaluationError
from cldit.rig.protocols import Stability
from cldit.scene.schema import Scene

MOST_SHOTS = 10_000  # of a kind, per background
LEAST_BACKGROUNDS = 3  # needed for a goodness of fit
_LEVELS = 7  # of the lowest and of the highest background: steps of 100 K over 253..873 K


@dataclass(frozen=True, kw_only=True)
class BlackBody:
    """A first-order black body with its limits and the rule for its stability."""

    limits_K: tuple[float, float]
    start_K: float
    time_constant_s: float
    stability: Stability

    def time_s(self, backgrounds_K: Iterable[float]) -> float:
        """Time until each background was within the tolerance and held, nearer end first."""
        stops = sorted(backgrounds_K)
        if abs(stops[-1] - self.start_K) < abs(stops[0] - self.start_K):
            stops.reverse()
        total, current_K = 0.0, self.start_K
        for background_K in stops:
            tolerances = abs(background_K - current_K) / self.stability.tolerance_K
            total += self.time_constant_s * math.log(max(tolerances, 1.0))
            total += self.stability.hold_s + self.stability.settle_s
            current_K = background_K
        return total


@dataclass(frozen=True, kw_only=True)
class Design:
    """A plan that reaches the wanted errors.

    error_K, emissivity_error: predicted standard errors at the quantile of pixels. time_s: includes
    waiting_s for the black body.
    """

    backgrounds_K: tuple[float, ...]
    shots: int
    references: int
    integration_time_s: float
    error_K: float
    emissivity_error: float
    time_s: float
    waiting_s: float


def temperatures_K(low_K: float, high_K: float, count: int) -> tuple[float, ...]:
    """`count` backgrounds in equal steps from `low_K` to `high_K`, to a tenth of a kelvin."""
    return tuple(round(float(each_K), 1) for each_K in np.linspace(low_K, high_K, count))


def background_sets(limits_K: tuple[float, float], count: int) -> Iterator[tuple[float, ...]]:
    """Sets of `count` different backgrounds in equal steps, of all lowest and highest levels."""
    for low_K, high_K in combinations(np.linspace(*limits_K, _LEVELS), 2):
        backgrounds = temperatures_K(low_K, high_K, count)
        if len(set(backgrounds)) == count:
            yield backgrounds


@dataclass(frozen=True, kw_only=True)
class Goal:
    """Standard errors that `quantile` of the pixels must stay below."""

    error_K: float
    emissivity_error: float = 0.02
    quantile: float = 0.9

    @property
    def wanted(self) -> Floats:
        """Limits (2,) of the errors of T_app [K] and emissivity."""
        return np.array([self.error_K, self.emissivity_error])

    def errors(self, variances: Floats, n: float, m: float) -> Floats:
        """Errors (2,) of T_app [K] and emissivity with n injections and m references.

        The `variances` (2, 2, P) are those of `Subject.variances`.
        """
        total = variances[:, 0] / n + variances[:, 1] / m
        return np.sqrt(np.quantile(total, self.quantile, axis=-1))

    def met(self, variances: Floats, n: float, m: float) -> bool:
        """True if the errors are within the limits; arguments as in `errors`."""
        return bool(np.all(self.errors(variances, n, m) <= self.wanted))


def _fewest(variances: Floats, goal: Goal) -> tuple[int, int] | None:
    """Numbers of shots and references with the least sum; None: too many."""

    def enough(n: int) -> int | None:
        """Number of references that n shots need."""
        if not goal.met(variances, n, MOST_SHOTS):
            return None
        met = partial(goal.met, variances, n)
        return bisect_left(range(MOST_SHOTS), True, lo=LEAST_SHOTS, key=met)

    best: tuple[int, int] | None = None
    n = LEAST_SHOTS
    while n <= MOST_SHOTS and (best is None or n < sum(best)):
        m = enough(n)
        if m is not None and (best is None or n + m < sum(best)):
            best = (n, m)
        n += max(1, n // 12)
    return best


def designs(
    subject: Subject,
    blackbody: BlackBody,
    goal: Goal,
    *,
    shot_s: float,
    counts: Sequence[int] = (2, 3, 4, 5, 6, 7),
) -> list[Design]:
    """The fastest design for each number of backgrounds in `counts`, fastest first.

    The exposure suits the hottest background of a set, so that none saturates the sensor. A shot
    takes `shot_s`.
    """
    low_K, high_K = blackbody.limits_K
    fastest: list[Design] = []
    smallest = np.array([np.inf, np.inf])
    for count in counts:
        best: Design | None = None
        for backgrounds in background_sets(blackbody.limits_K, count):
            variances = subject.variances(backgrounds)
            smallest = np.fmin(smallest, goal.errors(variances, MOST_SHOTS, MOST_SHOTS))
            fewest = _fewest(variances, goal)
            if fewest is None:
                continue
            shots, bare = fewest
            waiting_s = blackbody.time_s(backgrounds)
            time_s = waiting_s + count * (shots + bare) * shot_s
            if best is None or time_s < best.time_s:
                error_K, emissivity = goal.errors(variances, shots, bare)
                best = Design(
                    backgrounds_K=backgrounds,
                    shots=shots,
                    references=bare,
                    integration_time_s=subject.exposure(backgrounds[-1]).integration_time_s,
                    error_K=float(error_K),
                    emissivity_error=float(emissivity),
                    time_s=time_s,
                    waiting_s=waiting_s,
                )
        if best is not None:
            fastest.append(best)
    if not fastest:
        raise EvaluationError(
            f"error: {goal.error_K:g} K in T_app and {goal.emissivity_error:g} in emissivity are "
            f"not reached with {MOST_SHOTS} shots of either kind at backgrounds from "
            f"{low_K:g} to {high_K:g} K; the smallest are {smallest[0]:.3g} K and "
            f"{smallest[1]:.2g}. Allow a longer integration time, a wider filter, hotter "
            "backgrounds, or a larger error"
        )
    return sorted(fastest, key=lambda design: design.time_s)


def chosen(fastest: Sequence[Design]) -> Design:
    """The fastest design with enough backgrounds for a goodness of fit, if any."""
    fitting = [design for design in fastest if len(design.backgrounds_K) >= LEAST_BACKGROUNDS]
    return (fitting or list(fastest))[0]


def plan_of(design: Design, scene: Scene) -> Plan:
    """The acquisition plan of a design."""
    base = plan_from_scene(scene, integration_time_s=design.integration_time_s)
    return Plan.model_validate(
        {
            **base.model_dump(),
            "backgrounds_K": design.backgrounds_K,
            "shots": design.shots,
            "references": design.references,
        }
    )


def shot_time_s(scene: Scene) -> float:
    """Time of one shot of a scene's plan, without overhead of camera and injector."""
    plan = plan_from_scene(scene)
    trigger = plan.trigger
    return plan.pause_s + max(
        plan.integration_time_s + trigger.camera_delay_s,
        trigger.injector_delay_s + trigger.injector_width_s,
    )


def error_against_time(
    subject: Subject, design: Design, goal: Goal, *, shot_s: float
) -> tuple[Floats, Floats]:
    """Time [s] and error of T_app [K], (N,) each, with other numbers of shots of a design."""
    variances = subject.variances(design.backgrounds_K)
    factor = np.geomspace(1.0 / min(design.shots, design.references), 100.0, 60)
    errors = [goal.errors(variances, f * design.shots, f * design.references)[0] for f in factor]
    each_s = len(design.backgrounds_K) * (design.shots + design.references) * shot_s
    return design.waiting_s + factor * each_s, np.array(errors)
