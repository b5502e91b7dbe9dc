"""The page docs/scene-reference.md: every key of every file that users write."""

from __future__ import annotations

from cldit.acquisition.measured import MeasuredFile
from cldit.acquisition.plan import Plan
from cldit.rig.load import RigFile
from cldit.scene import Scene
from cldit.scene.checks import Section
from cldit.show.report.reference import markdown

# Heading, what the keys at the top are called in, and what reads the file.
FILES: tuple[tuple[str, str, type[Section]], ...] = (
    ("Scenes", "", Scene),
    ("Rig files", "rig.yaml ", RigFile),
    ("Plans", "plan.yaml ", Plan),
    ("Measured data", "measured.yaml ", MeasuredFile),
)

_INTRODUCTION = """\
# Every key of a scene, rig, plan and measurement

Made by `cldit scenes --reference` from what checks the files. Units are in the names. What is not
allowed is refused with the key, the value and what is allowed. Paths are relative to the file.
The scenes' defaults are the paper's numbers where it gives them; those of the sensor are typical
of a cooled InSb camera, and assumptions.

Editors that know YAML schemas (VS Code with the YAML extension, PyCharm) complete and check scenes
with `cldit scenes --schema > scene.schema.json` and a first line
`# yaml-language-server: $schema=scene.schema.json`.

"""


def reference_page() -> str:
    """The page as Markdown."""
    return _INTRODUCTION + "\n".join(
        markdown(model, title=title, file=file) for title, file, model in FILES
    )
