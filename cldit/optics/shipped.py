"""Files of optical properties that are shipped, in cldit/optics/data."""

from importlib import resources

_DATA = "cldit.optics.data"


def shipped(kind: str) -> tuple[str, ...]:
    """Names of the substances with a file KIND-NAME.yaml."""
    files = (entry.name for entry in resources.files(_DATA).iterdir())
    prefix, end = f"{kind}-", ".yaml"
    return tuple(
        sorted(
            name[len(prefix) : -len(end)]
            for name in files
            if name.startswith(prefix) and name.endswith(end)
        )
    )


def content(file: str) -> str:
    """Text of a shipped file."""
    return resources.files(_DATA).joinpath(file).read_text(encoding="utf-8")
