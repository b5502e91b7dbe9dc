"""Checks a plan against the capabilities that the instruments declare."""

from collections.abc import Callable
from functools import partial

from cldit.acquisition.plan import Plan, Shot
from cldit.constants import ZERO_CELSIUS_K
from cldit.rig.checks import check_burst, check_exposure
from cldit.rig.clock import SimulatedClock
from cldit.rig.errors import ConfigRejected, OutOfLimits, RigError
from cldit.rig.load import Rig
from cldit.rig.protocols import Limits, TriggerInfo, TriggerMode
from cldit.scene.delays import SAME_s, delay_text


def impossible(rig: Rig, plan: Plan, *, connected: bool) -> list[RigError]:
    """Problems of a plan that are known before any setting is written, one error each.

    Without `connected` instruments the camera is not asked.
    """
    problems: list[RigError] = []

    def asked(check: Callable[[], object]) -> None:
        try:
            check()
        except RigError as error:
            problems.append(error)

    asked(lambda: _check_backgrounds(rig.background.limits, plan))
    asked(lambda: _check_filters(rig, plan, connected=connected))
    for shot in {shot.delay: shot for shot in plan.steps()}.values():
        asked(partial(_check_times, plan, shot))
    if connected:
        can = rig.camera.capabilities
        asked(lambda: _check_clock(rig))
        asked(lambda: _check_spray(rig, plan))
        asked(lambda: check_exposure(can, plan.integration_time_s))
        asked(lambda: external_trigger(can.trigger_modes, plan.frames))
        if plan.frames > 1 and plan.frame_timeout_s < can.minimum_period_s:
            problems.append(_too_short("the camera's period", can.minimum_period_s, plan))
    return problems


def together(problems: list[RigError]) -> RigError:
    """One error for several; of their class, where they have one."""
    if len(problems) == 1:
        return problems[0]
    kinds = {type(problem) for problem in problems}
    kind = kinds.pop() if len(kinds) == 1 else RigError
    return kind("\n".join(map(str, problems)))


def _check_clock(rig: Rig) -> None:
    real = [name for name, device in rig.devices.items() if not device.identify().simulated]
    if real and isinstance(rig.clock, SimulatedClock):
        raise ConfigRejected(
            f"clock.model: simulated, but {', '.join(real)} is real; use `clock: {{model: system}}`"
        )


def _check_backgrounds(limits: Limits, plan: Plan) -> None:
    outside = [
        f"backgrounds_K: {temperature:g} is outside {limits.low_K:g}..{limits.high_K:g}"
        + _celsius(temperature, limits)
        for temperature in plan.backgrounds_K
        if not limits.low_K <= temperature <= limits.high_K
    ]
    if outside:
        raise OutOfLimits("the background cannot take the plan:\n" + "\n".join(outside))


def _check_filters(rig: Rig, plan: Plan, *, connected: bool) -> None:
    """The plan names filters if, and only if, the rig has a wheel with them."""
    wheel = rig.filter_wheel
    if wheel is None and plan.filters:
        raise ConfigRejected(
            f"filters: {', '.join(plan.filters)}: the rig has no filter wheel; allowed: no filters"
        )
    if wheel is None or not connected:
        return
    names = [item.name for item in wheel.filters]
    allowed = f"allowed: {', '.join(names)}, those of the filter wheel"
    if not plan.filters:
        raise ConfigRejected(f"filters: none: the rig has a filter wheel; {allowed}")
    if unknown := [name for name in plan.filters if name not in names]:
        raise ConfigRejected(f"filters: {', '.join(unknown)}: no such filter; {allowed}")


def _celsius(temperature: float, limits: Limits) -> str:
    """A hint where a temperature below the limits would do as one in degrees Celsius."""
    kelvin = temperature + ZERO_CELSIUS_K
    meant = temperature < limits.low_K and limits.low_K <= kelvin <= limits.high_K
    return f" K; {temperature:g} °C are {kelvin:g} K" if meant else ""


def _check_spray(rig: Rig, plan: Plan) -> None:
    """A simulated scene has its spray at some times only, which its generator says."""
    available = rig.trigger.read_configuration().get("spray_times_s")
    if available is None or plan.shots == 0 or len(plan.delays) == len(available) == 1:
        return
    if len(plan.delays) == 1 and not available:
        return
    start_s = plan.trigger.injector_delay_s
    lacking = [
        delay_text(delay_s)
        for delay_s in plan.delays
        if not any(abs(delay_s - start_s - time_s) < SAME_s for time_s in available)
    ]
    if lacking:
        times = ", ".join(map(delay_text, available)) or "one time"
        only = " only" if len(available) < 2 else ""
        raise ConfigRejected(
            f"delays_s: the simulated scene has its spray at {times}{only}, not at "
            f"{', '.join(lacking)} after the injector; trace a run at each delay (`plan.delays_s` "
            "of a scene), and list them as `runs` in the settings of the bench"
        )


def _check_times(plan: Plan, shot: Shot) -> None:
    """The burst of a shot, and whether it is over before its image counts as missing."""
    burst = plan.burst(shot)
    check_burst(burst)
    delays = (burst.camera_delay_s, burst.injector_delay_s)
    last_s = max(delay + width for delay, width in zip(delays, burst.widths_s, strict=True))
    shot_s = max(last_s, burst.camera_delay_s + plan.integration_time_s)
    if plan.frame_timeout_s < shot_s:
        raise _too_short("a shot", shot_s, plan)


def _too_short(subject: str, needed_s: float, plan: Plan) -> OutOfLimits:
    return OutOfLimits(
        f"frame_timeout_s: {plan.frame_timeout_s:g} is shorter than {subject}, {needed_s:g}; every "
        "image would count as missing"
    )


def external_trigger(modes: frozenset[TriggerMode], frames: int) -> TriggerInfo:
    """Trigger mode of a shot of `frames` images, from a camera's `modes`; raises ConfigRejected if
    it has no external trigger.
    """
    for mode in (TriggerMode.EXTERNAL_EDGE, TriggerMode.EXTERNAL_LEVEL):
        if mode in modes:
            return TriggerInfo(mode, n_frames=frames, frames_per_trigger=frames)
    raise ConfigRejected("camera: has no external trigger, which every shot needs")
