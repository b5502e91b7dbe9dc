"""Contract of drivers whose emulator closes sessions while they are idle, as instruments and
gateways do: a session with the instrument continues as if nothing had happened.
"""

from collections.abc import Mapping
from typing import Any

from cldit.rig.errors import RigError
from cldit.testing.bed import Make, opened
from cldit.testing.expect import expect

_FIRE = "fire"  # may be refused, because only the session that configured a burst sends it


def check_idle(make: Make, settings: Mapping[str, Any] | None = None) -> int:
    """Runs a session in which the emulator closes the connection before one step, for each step.

    `make` and `settings` are as for `cldit.testing.bed.opened`. Returns the number of sessions;
    raises ContractBroken with a line for each step that failed, returned something wrong, or after
    which the instrument is left on or has injected twice.
    """
    problems: list[str] = []
    with opened(make, settings) as bed:
        names = [step.name for step in bed.steps] if bed.hang_up is not None else []
    for number, name in enumerate(names):
        with opened(make, settings) as bed:
            assert bed.hang_up is not None
            bed.device.connect()
            for index, step in enumerate(bed.steps):
                if index == number:
                    bed.hang_up()
                try:
                    if not step.right(step.call()):
                        problems.append(f"closed before {name}: {step.name} returned a wrong value")
                except RigError as error:
                    if name != _FIRE:
                        problems.append(f"closed before {name}: {step.name}: {error}")
                    break
            bed.hang_up()
            bed.device.make_safe()
            if bed.left_on() or bed.injections > 1:
                state = f"left on: {bed.left_on()}, {bed.injections} injections"
                problems.append(f"closed before {name}: {state}")
    expect(not problems, "\n".join(problems))
    return len(names)
