"""Makes all devices of a rig safe, and believes none of them that says nothing."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from cldit.rig.errors import NotSafe
from cldit.rig.protocols import Device, Safety

STILL_ON = {
    "camera": "the camera may still be armed",
    "background": "the black body may still be hot",
    "trigger": "the generator may still inject on a trigger",
}


@dataclass(frozen=True)
class RigSafety:
    """What making a rig safe did. did: in words, by device; problems: a line a device that may
    still be on."""

    did: dict[str, str]
    problems: list[str]

    @property
    def moved(self) -> bool:
        """Whether there was anything to make safe."""
        return bool(self.did or self.problems)


def make_safe(
    devices: Mapping[str, Device],
    connected: Collection[str],
    *,
    connect_s: float | None = None,
) -> RigSafety:
    """Makes each device safe by itself, the last one first: one that is dead must not keep the
    others hot.

    Args:
        devices: by name.
        connected: names of those that were connected; of these none may say that it never was.
        connect_s: connects each first, and waits so long for it; None: as they are.
    """
    did: dict[str, str] = {}
    problems: list[str] = []
    for name, device in reversed(list(devices.items())):
        try:
            if connect_s is not None:
                device.connect(connect_s)
            result = device.make_safe()
            _check(result, was_connected=connect_s is not None or name in connected)
        except Exception as error:  # as above
            problems.append(_problem(name, error))
        else:
            if result.connected:
                did[name] = result.did
    return RigSafety(did, problems)


def _check(result: object, *, was_connected: bool) -> None:
    """Raises NotSafe."""
    if not isinstance(result, Safety):
        raise NotSafe(
            f"its make_safe() gives {result!r}; allowed is a cldit.rig.protocols.Safety, which "
            "says what was done"
        )
    if was_connected and not result.connected:
        raise NotSafe(f"it was connected, but its make_safe() did {result.did}")


def _problem(name: str, error: Exception) -> str:
    still_on = f"; {STILL_ON[name]}: switch it off by hand" if name in STILL_ON else ""
    return f"{name}: {error}{still_on}"
