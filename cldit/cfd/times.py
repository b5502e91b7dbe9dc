"""Choice among a case's times: a number that it has, the latest, or the nearest."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from cldit.cfd.case import only_claimant
from cldit.cfd.tolerances import ROUNDED
from cldit.errors import SprayError

CaseTime = float | str  # a number, `latest`, or `nearest` and a number (cldit.scene.values)


def wanted_time(requested: CaseTime | None) -> tuple[float | None, bool]:
    """Splits a requested time: its number (None: the latest), and True if the nearest is enough."""
    if requested is None or requested == "latest":
        return None, False
    if isinstance(requested, str):
        return float(requested.removeprefix("nearest")), True
    return requested, False


def choose_time(source: str, times: Iterable[float], requested: CaseTime | None) -> float:
    """Returns the time asked for, else the latest; a number must match within `ROUNDED`."""
    steps = sorted(set(times))
    if not steps:
        raise SprayError(f"{source}: no time with results")
    number, nearest = wanted_time(requested)
    if number is None:
        return steps[-1]
    best = min(steps, key=lambda time: abs(time - number))
    if not nearest and abs(best - number) > max(ROUNDED * abs(number), 1e-15):
        shown = ", ".join(f"{time:.7g}" for time in steps[:20]) + (", ..." if steps[20:] else "")
        raise SprayError(
            f"{source}: no time {number:g} s (spray.time_s); available: {shown}; the nearest is "
            f"{abs(best - number):.3g} away: `nearest {number:g}` takes it"
        )
    return best


def choose_file(
    source: str, by_time: Mapping[float, Iterable[Path]], requested: CaseTime | None, role: str = ""
) -> tuple[float, Path]:
    """Returns `choose_time`, and the only file of that time in a `role`."""
    time = choose_time(source, by_time, requested)
    return time, only_claimant(f"{role}time {time:g}", by_time[time])


def stated_time(source: str, times: Iterable[float], requested: CaseTime | None) -> float | None:
    """Returns `choose_time` of the times that a case states; None if it states none."""
    steps = list(times)
    if not steps and requested not in (None, "latest"):
        raise SprayError(f"{source}: does not state its time; remove spray.time_s")
    return choose_time(source, steps, requested) if steps else None


def choose_times(
    source: str, times: Iterable[float], requested: str | Sequence[CaseTime]
) -> tuple[float, ...]:
    """Chooses several times, ascending, each once.

    `requested` is `all`; a slice of Python's over the sorted times (`::5`, `10:`, `-3:`); or single
    times, each as `choose_time` takes it.
    """
    steps = sorted(set(times))
    if isinstance(requested, str):
        selection = slice(None) if requested == "all" else _slice(source, requested)
        chosen = steps[selection]
    else:
        chosen = sorted({choose_time(source, steps, time) for time in requested})
    if not chosen:
        raise SprayError(f"{source}: {requested}: selects none of its {len(steps)} times")
    return tuple(chosen)


def _slice(source: str, selection: str) -> slice:
    parts = selection.split(":")
    try:
        numbers = [int(part) if part.strip() else None for part in parts]
        if len(parts) not in (2, 3) or numbers[2:] == [0]:
            raise ValueError
    except ValueError as error:
        raise SprayError(
            f"{source}: times {selection!r}; allowed: `all`, a list of times, or a slice such as "
            "`::5` (every fifth), `10:` or `-3:`"
        ) from error
    return slice(*numbers)


def time_remarks(taken: float | None, requested: CaseTime | None) -> tuple[str, ...]:
    """Remark on how far the nearest time, `taken`, is from the one asked for."""
    number, nearest = wanted_time(requested)
    if not nearest or number is None or taken is None or taken == number:
        return ()
    return (f"Time {taken:.9g} is the nearest to {number:.9g}: {abs(taken - number):.3g} away.",)
