"""What goes wrong on a rig, each with what to do about it."""

from __future__ import annotations

from cldit.errors import ClditError


class RigError(ClditError, RuntimeError):
    """Base of the errors that instruments raise."""


class NotConnected(RigError):
    """The instrument does not answer, or was not connected before it was used."""


class DeviceTimeout(RigError):
    """The instrument did not get there in the time allowed."""


class MissingFrames(RigError):
    """Frames were asked for and did not come: the one error that allows a retake.

    Attributes:
        expected, received: frames asked for, and those that came whole.
        incomplete: frames that came with a part missing.
    """

    def __init__(self, expected: int, received: int, incomplete: int = 0) -> None:
        super().__init__(
            f"{received} of {expected} frames arrived"
            + (f", {incomplete} incomplete" if incomplete else "")
            + "; check the trigger line and the camera's link"
        )
        self.expected = expected
        self.received = received
        self.incomplete = incomplete

    def __reduce__(self) -> tuple[type[MissingFrames], tuple[int, int, int]]:
        return type(self), (self.expected, self.received, self.incomplete)


class ConfigRejected(RigError):
    """The instrument refuses a setting, or reads back another than was written."""


class NotSafe(RigError):
    """The instrument may still be on: hot, armed or ready to inject. Somebody must go to it."""


class OutOfLimits(RigError):
    """A set point or setting is outside what the instrument can do; nothing was moved."""


class FireUncertain(RigError):
    """The trigger was sent and nobody knows whether the injector fired. Never fire again on it."""


class RetakesExhausted(RigError):
    """A shot was rejected as often as the plan allows."""


class Aborted(RigError):
    """The operator stopped what was going on."""
