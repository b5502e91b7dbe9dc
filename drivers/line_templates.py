"""Commands and answers of an instrument with a line protocol, as templates in the rig file.

`{value}` is a number and `{any}` any text; everything else is literal, except the amount of white
space. A command may have a format of the number, as in Python: `{value:.2f}`.
"""

import re

from pydantic import field_validator, model_validator

from cldit.scene.checks import Section

_FIELD = re.compile(r"\{(value(?::[^{}]*)?|any)\}")
_NUMBER = r"\s*([-+]? *(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*"  # may be padded


def pattern(template: str) -> re.Pattern[str]:
    """Regular expression of a template; its groups are the numbers."""
    parts = _FIELD.split(template)
    literals = [re.sub(r"(?:\\?\s)+", r"\\s+", re.escape(part)) for part in parts[::2]]
    fields = [".*?" if name == "any" else _NUMBER for name in parts[1::2]]
    woven = "".join(a + b for a, b in zip(literals, [*fields, ""], strict=True))
    return re.compile(rf"\s*{woven}\s*", re.IGNORECASE | re.DOTALL)


def _fields(template: str) -> list[str]:
    return [field.partition(":")[0] for field in _FIELD.findall(template)]


class Command(Section):
    """A command and its answer."""

    send: str
    """Text without the end of the line."""
    answer: str | None = None
    """Answer, if there is one."""

    @field_validator("send")
    @classmethod
    def _can_be_written(cls, send: str) -> str:
        try:
            send.format(value=1.0)
        except (KeyError, IndexError, ValueError) as error:
            raise ValueError(f"{send!r}: {error}; allowed: {{value}}, as {{value:.2f}}") from None
        return send

    @field_validator("answer")
    @classmethod
    def _can_be_read(cls, answer: str | None) -> str | None:
        if answer is not None and re.search(r"[{}]", _FIELD.sub("", answer)):
            raise ValueError(f"{answer!r}: allowed in braces: {{value}} and {{any}}")
        if answer is not None and ":" in "".join(_FIELD.findall(answer)):
            raise ValueError(f"{answer!r}: {{value}} of an answer has no format")
        return answer

    def text(self, value: float = 0.0) -> str:
        """Text to send."""
        return self.send.format(value=value)


class Ask(Command):
    """A query for one number."""

    answer: str

    @model_validator(mode="after")
    def _one_number(self) -> "Ask":
        if _fields(self.answer).count("value") != 1 or "value" in _fields(self.send):
            raise ValueError(f"answer: {self.answer!r}; allowed: one {{value}}, and none in send")
        return self


class Tell(Command):
    """A command with one number."""

    @model_validator(mode="after")
    def _one_number(self) -> "Tell":
        if _fields(self.send).count("value") != 1:
            raise ValueError(f"send: {self.send!r}; allowed: one {{value}}")
        return self
