"""Errors of instruments; each message says what to do."""

from cldit.errors import ClditError


class RigError(ClditError, RuntimeError):
    """Base of the errors that instruments raise."""


class NotConnected(RigError):
    """The instrument does not answer, or was used before it was connected."""


class InUse(NotConnected):
    """Another process uses the instrument; nothing was asked of it, and nothing changed."""


class HungUp(NotConnected):
    """The instrument, or a gateway, closed the session before the question was sent."""


class OddAnswer(NotConnected):
    """The answer is impossible: of a broken sensor, or damaged."""


class DeviceTimeout(RigError):
    """The instrument did not reach the wanted state in the time allowed."""


class MissingFrames(RigError):
    """Requested frames did not arrive; the only error after which a shot is retaken.

    Attributes:
        expected, received: frames requested, and those that arrived complete.
        incomplete: frames that arrived with a part missing.
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

    def __reduce__(self) -> "tuple[type[MissingFrames], tuple[int, int, int]]":
        return type(self), (self.expected, self.received, self.incomplete)


class ConfigRejected(RigError):
    """The instrument rejects a setting, or reads back another value than was written."""


class NotSafe(RigError):
    """The instrument may still be on (hot, armed, ready to inject), and needs a person's hand."""


class OutOfLimits(RigError):
    """A set point or setting is outside the instrument's limits; nothing was changed."""


class FireUncertain(RigError):
    """The trigger was sent, and it is unknown whether the injector fired; never fire again."""


class RetakesExhausted(RigError):
    """A shot was rejected as often as the plan allows."""


class Aborted(RigError):
    """The operator stopped the operation."""
