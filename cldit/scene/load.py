"""Reading of scenes by path or by the name of a shipped scene, and writing as YAML."""

import difflib
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

from cldit.errors import SceneError
from cldit.io.plain_data import parse_yaml, read_mapping
from cldit.scene.camera import square_pixels
from cldit.scene.change import merged
from cldit.scene.checks import shortened
from cldit.scene.schema import Scene

_LIBRARY = "cldit.scene.library"
_FORMER = {"gdi-flow": "gdi"}  # names of shipped scenes in older versions
_QUICK_PIXELS = 128  # of a preview, along the longer side
_QUICK_K = 4.0  # tolerance of T_app of a preview, four times the default


def shipped_scenes() -> dict[str, str]:
    """Names and descriptions of the scenes that are shipped with cldit."""
    descriptions: dict[str, str] = {}
    for entry in sorted(resources.files(_LIBRARY).iterdir(), key=lambda item: item.name):
        if entry.name.endswith(".yaml"):
            data = parse_yaml(entry.read_text(encoding="utf-8"), source=entry.name)
            descriptions[entry.name.removesuffix(".yaml")] = str(data.get("description", ""))
    return descriptions


def short_changes(
    scene: Scene,
    *,
    quick: bool = False,
    pixels: int | Sequence[int] | None = None,
    accuracy: tuple[float, float | None] | None = None,
) -> dict[str, Any]:
    """Changes for `Scene.with_` by the short options of a run.

    `quick` keeps what is given. One number of pixels is along the longer side of the field; pixels
    are square. `accuracy` is that of T_app in K and of emissivity, None: chosen by the other.
    """
    changes: dict[str, Any] = {}
    if quick:
        pixels, accuracy = pixels or _QUICK_PIXELS, accuracy or (_QUICK_K, None)
    if isinstance(pixels, int):
        pixels = square_pixels(scene.camera.field_m, pixels)
    if pixels is not None:
        changes["camera.pixels"] = list(pixels)
    if accuracy is not None:
        changes["transport.accuracy_K"], changes["transport.accuracy_emissivity"] = accuracy
    return changes


def chosen_scene(
    scene: Scene | str | Path,
    *,
    quick: bool = False,
    pixels: int | Sequence[int] | None = None,
) -> Scene:
    """A scene, a shipped name or a YAML file, with the short options of a run.

    Raises SceneError as `load_scene`.
    """
    chosen = scene if isinstance(scene, Scene) else load_scene(scene)
    changes = short_changes(chosen, quick=quick, pixels=pixels)
    return chosen.with_(**changes) if changes else chosen


def load_scene(name_or_path: str | Path) -> Scene:
    """Reads a scene.

    Args:
        name_or_path: name of a shipped scene (`gdi`), or path of a YAML file. Relative paths in
            the file start at its folder. A key `base` names another scene, whose keys apply where
            the file has none.

    Returns:
        The scene, checked and frozen.

    Raises:
        SceneError: no such scene, or a key or value is not allowed; the message lists each with
            what is allowed.
    """
    return _loaded(name_or_path, ())


def _loaded(name_or_path: str | Path, above: tuple[Path, ...]) -> Scene:
    """Reads a scene; `above` are the files whose `base` led here."""
    path = Path(name_or_path)
    if path.suffix in (".yaml", ".yml") or _is_file(path):
        data = read_mapping(path)
        if "base" in data:
            data = _on_base(data, path, above)
        return parse_scene(data, source=str(path), folder=path.parent)
    name = shortened(str(name_or_path))
    shipped = shipped_scenes()
    name = _FORMER.get(name, name)
    if name not in shipped:
        close = difflib.get_close_matches(name, shipped, n=1)
        hint = f"; did you mean {close[0]}?" if close else ""
        raise SceneError(
            f"{name}: no such scene{hint}; allowed: {', '.join(shipped)}, or the path of a "
            ".yaml file"
        )
    content = resources.files(_LIBRARY).joinpath(f"{name}.yaml").read_text(encoding="utf-8")
    data = parse_yaml(content, source=name)
    if "base" in data:  # another shipped scene
        data = _over(_loaded(data["base"], above), data, name)
    return parse_scene(data, source=name)


def _is_file(path: Path) -> bool:
    """True for a file; a text that is too long for a name is none."""
    try:
        return path.is_file()
    except OSError:
        return False


def _on_base(data: dict[str, Any], path: Path, above: tuple[Path, ...]) -> dict[str, Any]:
    """Plain data of a file merged into the scene that its key `base` names."""
    base = data["base"]
    if not isinstance(base, str):
        raise SceneError(
            f"{path}: base: {base!r} is no scene; allowed: a shipped name or a .yaml file's path"
        )
    resolved = path.resolve()
    if resolved in above:
        chain = " -> ".join(str(file) for file in (*above, resolved))
        raise SceneError(f"{path}: base: leads back to itself ({chain})")
    beside = path.parent / base
    named = beside if _is_file(beside) else base
    return _over(_loaded(named, (*above, resolved)), data, path.stem)


def _over(base: Scene, data: dict[str, Any], name: str) -> dict[str, Any]:
    """Plain data of a scene called `name` over that of its base."""
    below = base.model_dump(mode="json", exclude_unset=True)
    over = {key: value for key, value in data.items() if key != "base"}
    return merged({**below, "name": name}, over)


parse_scene, dump_scene = Scene.from_dict, Scene.to_yaml
"""The same as functions."""
