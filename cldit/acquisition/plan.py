"""Plan of an acquisition as frozen data: backgrounds x filters x delays x {reference, injection} x
shots.
"""

import hashlib
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ValidationError, field_validator, model_validator

from cldit.errors import SceneError
from cldit.io.plain_data import dump_yaml, read_mapping
from cldit.rig.protocols import Burst, FilterName, Stability
from cldit.scene.camera import USUAL_INTEGRATION_S
from cldit.scene.checks import Section, Within, describe
from cldit.scene.delays import SAME_s, delay_text
from cldit.scene.schema import Scene
from cldit.scene.values import Backgrounds

Kind = Literal["reference", "injection"]
Seconds = Annotated[float, Within(0.0, 1e6)]


class TriggerSection(Section):
    """Delays and pulse widths of one shot, from the generator's start."""

    camera_delay_s: Annotated[float, Within(0.0, 1.0)] = 0.95e-3
    """Delay of the camera's pulse from the generator's start; unused if `delays_s` are given."""
    injector_delay_s: Annotated[float, Within(0.0, 1.0)] = 0.0
    """Delay of the injector's pulse from the generator's start."""
    camera_width_s: Annotated[float, Within(1e-7, 1.0)] = 1e-4
    """Width of the camera's pulse."""
    injector_width_s: Annotated[float, Within(1e-7, 1.0)] = 1.5e-3
    """Width of the injector's pulse."""


@dataclass(frozen=True)
class Shot:
    """One image to take. `background`, `delay` and `filter` are indices into the plan's
    temperatures, `delays` and `filters`."""

    id: str
    background: int
    background_K: float
    kind: Kind
    number: int
    delay: int = 0
    filter: int = 0


@dataclass(frozen=True)
class Group:
    """Shots that are evaluated together: those of one filter and one delay, by their indices."""

    filter: int = 0
    delay: int = 0


class Plan(Section):
    """A measurement. Two plans with one hash take the same images."""

    backgrounds_K: Backgrounds
    """Set points of the black body, 1 to 1000 of them."""
    shots: Annotated[int, Within(0, 100_000)] = 5
    """Injections at each background."""
    references: Annotated[int, Within(0, 100_000)] = 5
    """Images without injection at each background."""
    delays_s: tuple[Annotated[float, Within(0.0, 1.0)], ...] = ()
    """Delays of the camera's pulse from the generator's start, up to 100. At each background, shots
    and references are taken at every delay; `trigger.camera_delay_s` by default."""
    filters: tuple[FilterName, ...] = ()
    """Names of filters of the rig's wheel. At each background, shots and references are taken with
    every filter and, with each, at every delay; required if the rig has a wheel."""
    frames: Annotated[int, Within(1, 1000)] = 1
    """Images of each shot: one trigger, then the camera's own rate."""
    integration_time_s: Annotated[float, Within(1e-9, 10.0)] = 25e-6
    """Exposure of every image."""
    interleave: bool = True
    """References and injections alternate at each background (ABBA), so that slow drift cancels in
    their difference; false: all references first."""
    order: Literal["fastest", "given"] = "fastest"
    """Order of the backgrounds; `fastest`: the shortest path of the black body."""
    pause_s: Seconds = 1.0
    """Pause ahead of each shot, to scavenge the vessel."""
    frame_timeout_s: Annotated[float, Within(1e-3, 3600.0)] = 5.0
    """Time after which an image counts as missing."""
    drift_K: Annotated[float, Within(1e-3, 100.0)] = 0.5
    """Largest deviation of the black body during a shot; a shot beyond it is rejected."""
    retakes: Annotated[int, Within(0, 100)] = 3
    """Number of retakes of a rejected shot."""
    expect_fuel: bool = True
    """Reject an injection that equals the reference."""
    stability: Stability = Stability()
    """Criterion of a stable background."""
    trigger: TriggerSection = TriggerSection()
    """Pulses of a shot."""

    @field_validator("delays_s")
    @classmethod
    def _apart(cls, delays_s: tuple[float, ...]) -> tuple[float, ...]:
        if len(delays_s) > 100:
            raise ValueError(f"{len(delays_s)} delays, allowed: 0..100")
        for earlier_s, later_s in pairwise(sorted(delays_s)):
            if later_s - earlier_s < SAME_s:
                raise ValueError(
                    f"{earlier_s:g} and {later_s:g} are closer than {SAME_s:g} s; "
                    "give each delay once"
                )
        return delays_s

    @field_validator("filters")
    @classmethod
    def _different(cls, filters: tuple[str, ...]) -> tuple[str, ...]:
        if twice := [name for name in filters if filters.count(name) > 1]:
            raise ValueError(f"{twice[0]} twice; allowed: each filter once")
        return filters

    @model_validator(mode="after")
    def _possible(self) -> "Plan":
        if self.shots + self.references == 0:
            raise ValueError("shots, references: both are 0; allowed: 1 or more in all")
        if self.drift_K < self.stability.tolerance_K:
            raise ValueError(
                f"drift_K: {self.drift_K:g} is less than stability.tolerance_K, "
                f"{self.stability.tolerance_K:g}; every shot would be rejected"
            )
        return self

    @property
    def delays(self) -> tuple[float, ...]:
        """Every delay of the camera's pulse, in seconds, one or more, in the order of recording."""
        return self.delays_s or (self.trigger.camera_delay_s,)

    @property
    def groups(self) -> tuple[Group, ...]:
        """Every filter with every delay, in the order of recording."""
        return tuple(
            Group(number, delay)
            for number in range(max(len(self.filters), 1))
            for delay in range(len(self.delays))
        )

    def filter_name(self, part: Shot | Group) -> str | None:
        """Name of the filter of a shot or a group; None for a plan without a filter wheel."""
        return self.filters[part.filter] if self.filters else None

    def hash(self) -> str:
        """SHA-256 of the plan as canonical JSON, without the order of the kinds: ids say which.

        One delay gives the same hash in either key, and the hash of plans without `delays_s`; a
        plan without filters has the hash that it had before there were any.
        """
        plain = self.model_dump(mode="json", exclude={"interleave"})
        plain["trigger"]["camera_delay_s"] = self.delays[0]
        if len(self.delays) == 1:
            del plain["delays_s"]
        if not self.filters:
            del plain["filters"]
        data = json.dumps(plain, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(data.encode()).hexdigest()

    def steps(self) -> tuple[Shot, ...]:
        """Every shot, background by background as given, in the order in which they are taken.

        Before a background, one filter follows the other, and with each filter one delay the other,
        each with its own references, of which one is first. Ids are `b00_ref_00`, `b00_inj_03`,
        with several delays `b00_d01_inj_03`, with several filters `b00_f01_d01_inj_03`: they tell
        background, filter, delay and shot, and do not depend on the order in which shots are taken.
        """
        kinds = self._kinds()
        wide = max(2, len(str(len(self.backgrounds_K) - 1)))
        digits = {
            "reference": max(2, len(str(self.references - 1))),
            "injection": max(2, len(str(self.shots - 1))),
        }

        def place(group: Group) -> str:
            many = (("f", group.filter, self.filters), ("d", group.delay, self.delays))
            return "".join(f"{key}{at:02d}_" for key, at, values in many if len(values) > 1)

        return tuple(
            Shot(
                f"b{index:0{wide}d}_{place(group)}{kind[:3]}_{number:0{digits[kind]}d}",
                index,
                temperature_K,
                kind,
                number,
                group.delay,
                group.filter,
            )
            for index, temperature_K in enumerate(self.backgrounds_K)
            for group in self.groups
            for kind, number in kinds
        )

    def _kinds(self) -> tuple[tuple[Kind, int], ...]:
        """Kind and number of each shot before one background, of one group."""
        counts: tuple[tuple[Kind, int], ...] = (
            ("reference", self.references),
            ("injection", self.shots),
        )
        order: list[Kind] = [kind for kind, count in counts for _ in range(count)]
        if self.interleave and self.references and self.shots:
            order = _interleaved(self.references, self.shots)
        numbers = {kind: iter(range(count)) for kind, count in counts}
        return tuple((kind, next(numbers[kind])) for kind in order)

    def background_order(self, missing: Iterable[int], *, present_K: float) -> tuple[int, ...]:
        """The order in which to visit the backgrounds `missing` (indices), from `present_K` on.

        `fastest` goes to the nearer end of the range first and from there through it once.
        """
        indices = sorted(set(missing))
        if self.order == "given" or not indices or not math.isfinite(present_K):
            return tuple(indices)
        upwards = sorted(indices, key=lambda index: self.backgrounds_K[index])
        to_low = abs(present_K - self.backgrounds_K[upwards[0]])
        to_high = abs(present_K - self.backgrounds_K[upwards[-1]])
        return tuple(upwards if to_low <= to_high else reversed(upwards))

    def from_filter(self, shots: Iterable[Shot], present: str | None) -> tuple[Shot, ...]:
        """The `shots` of one background with those of the `present` filter first, so that the wheel
        moves once less."""
        return tuple(sorted(shots, key=lambda shot: self.filter_name(shot) != present))

    def burst(self, shot: Shot) -> Burst:
        """Pulses of the trigger generator for one shot: one pulse, never more."""
        return Burst(
            n=1,
            camera_delay_s=self.delays[shot.delay],
            injector_delay_s=self.trigger.injector_delay_s,
            widths_s=(self.trigger.camera_width_s, self.trigger.injector_width_s),
            inject=shot.kind == "injection",
        )

    def describe(self, shot: Shot) -> str:
        """A shot in words: `440 K, injection 3`; with several filters or delays, these too."""
        where = "".join(f"{word}, " for word in self.words(shot))
        return f"{shot.background_K:g} K, {where}{shot.kind} {shot.number + 1}"

    def words(self, part: Shot | Group) -> tuple[str, ...]:
        """Filter and delay of a shot or a group, as far as the plan has several."""
        name = (self.filters[part.filter],) if len(self.filters) > 1 else ()
        delay = (delay_text(self.delays[part.delay]),) if len(self.delays) > 1 else ()
        return (*name, *delay)

    def dump(self) -> str:
        """The plan as YAML, every default written out."""
        return dump_yaml(self.model_dump(mode="json"))


def _interleaved(references: int, injections: int) -> list[Kind]:
    """Order of the kinds in which a steady rise has the same effect on the mean of either kind.

    The less frequent kind is spread evenly, rounded down and up in turn (R I I R R I I R for equal
    numbers). A reference comes first, because injections are compared with it.
    """
    total = references + injections
    smaller = min(references, injections)
    even = (np.arange(smaller) + 0.5) * total / smaller - 0.5
    down = np.arange(smaller) % 2 == (0 if references <= injections else 1)
    at = np.where(down, np.floor(even), np.ceil(even))
    if references <= injections and at[0] > 0:
        at = np.rint(np.linspace(0.0, total - 1.0, smaller)) if smaller > 1 else np.zeros(1)
    rarer: Kind = "reference" if references <= injections else "injection"
    frequent: Kind = "injection" if references <= injections else "reference"
    chosen = set(at.astype(int).tolist())
    return [rarer if number in chosen else frequent for number in range(total)]


def parse_plan(data: dict[str, Any], *, source: str = "plan") -> Plan:
    """A plan from plain `data`; raises SceneError that names `source` and every key that is not
    allowed.
    """
    try:
        return Plan.model_validate(data)
    except ValidationError as error:
        raise SceneError(f"{source}:\n{describe(Plan, error.errors())}") from error


def load_plan(path: str | Path) -> Plan:
    """A plan from a YAML file; raises as `parse_plan`."""
    return parse_plan(read_mapping(Path(path)), source=str(path))


def plan_from_scene(scene: Scene, *, integration_time_s: float = USUAL_INTEGRATION_S) -> Plan:
    """The plan that a scene asks for, with `integration_time_s` as exposure."""
    # 20 time constants bring a first-order black body from anywhere to within a millikelvin.
    timeout_s = max(3600.0, 20.0 * scene.rig.background_time_constant_s)
    trigger = TriggerSection()
    if scene.spray.model == "cone":
        trigger = TriggerSection(
            camera_delay_s=scene.spray.time_s, injector_width_s=scene.spray.injection_duration_s
        )
    return Plan(
        backgrounds_K=scene.background.temperatures_K,
        shots=scene.plan.shots,
        references=scene.plan.references,
        delays_s=scene.plan.delays_s,
        expect_fuel=False,  # a scene may well be one in which nothing can be seen
        integration_time_s=integration_time_s,
        stability=Stability(timeout_s=timeout_s),
        trigger=trigger,
    )
