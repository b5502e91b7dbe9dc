"""The argument SCENE: shells complete it with shipped names and files."""

from __future__ import annotations

from importlib import resources

import click
from click.shell_completion import CompletionItem

from cldit.cli.units import Text


class SceneName(Text):
    """A shipped name or the path of a YAML file; `load_scene` says what is wrong with it."""

    name = "scene"

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """What a shell offers.

        Args:
            ctx, param: click's.
            incomplete: what stands there.

        Returns:
            Shipped names that begin so; where none does, the shell's own files.
        """
        files = resources.files("cldit.scene.library").iterdir()
        names = sorted(one.name.removesuffix(".yaml") for one in files if one.name[-5:] == ".yaml")
        found = [CompletionItem(name) for name in names if name.startswith(incomplete)]
        return found or [CompletionItem(incomplete, type="file")]


SCENE = SceneName()
