"""Scenes: frozen, validated data, read from and written to YAML."""

from cldit.scene.load import dump_scene, load_scene, parse_scene, shipped_scenes
from cldit.scene.schema import Scene

__all__ = ["Scene", "dump_scene", "load_scene", "parse_scene", "shipped_scenes"]
