"""Makes all devices of a rig safe; a device that does not confirm it counts as unsafe."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from cldit.rig.errors import NotSafe
from cldit.rig.protocols import KINDS, Device, Safety


@dataclass(frozen=True)
class RigSafety:
    """Result of making a rig safe.

    did: the actions in words, by device. problems: one line for each device that may still be on.
    not_cooling: one line for each that confirmed its safe set point, and does not cool.
    """

    did: dict[str, str]
    problems: list[str]
    not_cooling: list[str] = field(default_factory=list)

    @property
    def unsafe(self) -> list[str]:
        """Everything that needs a person's hand."""
        return self.problems + self.not_cooling

    @property
    def moved(self) -> bool:
        """True if any device had to be made safe."""
        return bool(self.did or self.problems)


def make_safe(
    devices: Mapping[str, Device], connected: Collection[str], *, taken_over: bool = False
) -> RigSafety:
    """Makes each device safe, the last first; a dead one does not keep the others from it.

    `devices` are by name; those that are named in `connected` must not deny it. `taken_over`:
    another process, which ended, may have left all of them on.
    """
    did: dict[str, str] = {}
    problems: list[str] = []
    for name, device in reversed(list(devices.items())):
        try:
            failure = _take_over(device) if taken_over else None
            result = device.make_safe()
            if failure is not None and not result.connected:
                raise failure
            _check(result, was_connected=taken_over or name in connected)
        except Exception as error:  # as above
            still_on = f"; {KINDS[name]}: switch it off by hand" if name in KINDS else ""
            problems.append(f"{name}: {error}{still_on}")
        else:
            if result.connected:
                did[name] = result.did
    return RigSafety(did, problems, _watch(devices, did))


def _watch(devices: Mapping[str, Device], did: dict[str, str]) -> list[str]:
    """Watches the devices that can be hot until they cool, and adds the temperature to `did`;
    returns a line for each that is not seen to cool."""
    not_cooling = []
    for name in did:
        watch = getattr(devices[name], "watch_cooling", None)  # of cldit.rig.stability.Settling
        if watch is None:
            continue
        try:
            did[name] += f"; {watch()}"
        except Exception as error:  # the others are watched all the same
            not_cooling.append(f"{name}: {did[name]}, but {error}; switch it off by hand")
    return not_cooling


def _take_over(device: Device) -> Exception | None:
    """Lets make_safe() reach a device that this process has not used; without a method for it, the
    device is connected, and the error returned."""
    take_over = getattr(device, "take_over", None)  # of cldit.rig.link.Linked
    try:
        device.connect() if take_over is None else take_over()
    except Exception as error:  # a broken sensor must not keep it hot
        return error
    return None


def _check(result: object, *, was_connected: bool) -> None:
    """Raises NotSafe if the result does not confirm that the device is safe."""
    if not isinstance(result, Safety):
        raise NotSafe(
            f"its make_safe() returned {result!r}; allowed: a cldit.rig.protocols.Safety, which "
            "says what was done"
        )
    if was_connected and not result.connected:
        raise NotSafe(f"it was connected, but its make_safe() did {result.did}")
