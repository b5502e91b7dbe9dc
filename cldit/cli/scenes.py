"""`cldit scenes`: the shipped scenes, and their schema."""

import json
from typing import Any

import click

from cldit.cli.as_json import Outcome, json_option
from cldit.cli.console import plain_errors, print_table
from cldit.io.terminal import tell
from cldit.scene import Scene, load_scene, shipped_scenes
from cldit.scene.commented import commented


@click.command()
@click.option("--show", metavar="SCENE", help="Print a scene as commented YAML, to save and edit.")
@click.option("--schema", is_flag=True, help="Print the JSON schema of scenes, for editors.")
@json_option
@plain_errors
def scenes(show: str | None, schema: bool) -> Outcome:
    """List the shipped scenes."""
    if show is not None:
        scene = load_scene(show)
        tell(commented(scene), end="")
        return Outcome(scene.model_dump(mode="json"))
    if schema:
        schema_json = _schema()
        tell(json.dumps(schema_json, indent=2))
        return Outcome(schema_json)
    descriptions = shipped_scenes()
    print_table("scene", "", rows=descriptions.items())
    return Outcome(
        [{"name": name, "description": description} for name, description in descriptions.items()]
    )


def _schema() -> dict[str, Any]:
    """JSON schema of scene files, which may be based on another scene."""
    schema = Scene.model_json_schema()
    required = schema.pop("required")
    description = (
        "Shipped name or .yaml file of a scene, whose keys apply where this file has none."
    )
    schema["properties"]["base"] = {"type": "string", "description": description}
    return {**schema, "anyOf": [{"required": ["base"]}, {"required": required}]}
