"""Choice among a case's times: a number that it has, the latest, or the nearest."""

from collections.abc import Iterable, Sequence

from cldit.errors import SprayError

CaseTime = float | str  # a number, `latest`, or `nearest` and a number (cldit.scene.values)
TIME_TOLERANCE = 1e-6  # relative; OpenFOAM writes times with six digits, foamToVTK as float32


def wanted_time(wanted: CaseTime | None) -> tuple[float | None, bool]:
    """Splits a wanted time into its number (None: the latest) and whether the nearest will do."""
    if wanted is None or wanted == "latest":
        return None, False
    if isinstance(wanted, str):
        return float(wanted.removeprefix("nearest")), True
    return wanted, False


def choose_time(source: str, times: Iterable[float], wanted: CaseTime | None) -> float:
    """Returns the time asked for, else the latest; a number must match within `TIME_TOLERANCE`."""
    known = sorted(set(times))
    if not known:
        raise SprayError(f"{source}: no time with results")
    number, nearest = wanted_time(wanted)
    if number is None:
        return known[-1]
    best = min(known, key=lambda time: abs(time - number))
    if not nearest and abs(best - number) > max(TIME_TOLERANCE * abs(number), 1e-15):
        shown = ", ".join(f"{time:.7g}" for time in known[:20]) + (", ..." if known[20:] else "")
        raise SprayError(
            f"{source}: no time {number:g} s (spray.time_s); available: {shown}; the nearest is "
            f"{abs(best - number):.3g} away: `nearest {number:g}` takes it"
        )
    return best


def choose_times(
    source: str, times: Iterable[float], wanted: str | Sequence[CaseTime]
) -> tuple[float, ...]:
    """Chooses several times, ascending, each once.

    `wanted` is `all`; a slice of Python's over the sorted times (`::5`, `10:`, `-3:`); or single
    times, each as `choose_time` takes it.
    """
    known = sorted(set(times))
    if isinstance(wanted, str):
        some = slice(None) if wanted == "all" else _slice(source, wanted)
        chosen = known[some]
    else:
        chosen = sorted({choose_time(source, known, each) for each in wanted})
    if not chosen:
        raise SprayError(f"{source}: {wanted}: selects none of its {len(known)} times")
    return tuple(chosen)


def _slice(source: str, text: str) -> slice:
    parts = text.split(":")
    try:
        numbers = [int(part) if part.strip() else None for part in parts]
        if len(parts) not in (2, 3) or numbers[2:] == [0]:
            raise ValueError
    except ValueError as error:
        raise SprayError(
            f"{source}: times {text!r}; allowed: `all`, a list of times, or a slice such as "
            "`::5` (every fifth), `10:` or `-3:`"
        ) from error
    return slice(*numbers)


def time_remarks(taken: float | None, wanted: CaseTime | None) -> tuple[str, ...]:
    """Remark on how far the nearest time, `taken`, is from the one asked for."""
    number, nearest = wanted_time(wanted)
    if not nearest or number is None or taken is None or taken == number:
        return ()
    return (f"Time {taken:.9g} is the nearest to {number:.9g}: {abs(taken - number):.3g} away.",)
