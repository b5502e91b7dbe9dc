"""Files for other programs: raw images of an acquisition, or the octree of a run."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from cldit.acquisition.export import FORMATS, ExportError
from cldit.acquisition.export import export as export_images
from cldit.acquisition.record import acquisition_in, open_acquisition

if TYPE_CHECKING:
    from cldit.gpu.device import Device

OCTREE = "vtu"


def export(
    folder: str | Path,
    to: str,
    out: str | Path | None = None,
    *,
    node: int | None = None,
    own_frame: bool = False,
    device: "Device | None" = None,
    progress: Callable[[str], None] | None = None,
) -> tuple[Path, ...]:
    """Writes an acquisition's raw images, or a run's octree, for other programs.

    Args:
        folder: acquisition or run.
        to: `nexus` for images, `vtu` for the octree (ParaView).
        out: the file; None: in the folder.
        node: octree: number of a wavelength; None: the brightest.
        own_frame: octree: cldit's coordinates instead of the CFD case's.
        device: octree: OpenCL device; None chooses.
        progress: called with lines of text.

    Returns:
        The files; an octree may have one more for parcels.

    Raises:
        ExportError: there is no such format, or no image.
        ClditError: the folder holds no acquisition, or no run; or a file cannot be written.
    """
    target = None if out is None else Path(out)
    say = progress or (lambda line: None)
    if to == OCTREE:
        # load OpenCL, which is not needed to export images
        from cldit.io.caches import default_cache
        from cldit.run.folder import open_run
        from cldit.run.octree_export import export_octree
        from cldit.run.trusted import open_device

        return tuple(
            export_octree(
                open_run(folder),
                target,
                device=device or open_device(),
                cache=default_cache(),
                node=node,
                own_frame=own_frame,
                say=say,
            )
        )
    if to not in FORMATS:
        raise ExportError(f"to: {to!r}; allowed: {', '.join([*FORMATS, OCTREE])}")
    if node is not None or own_frame or device is not None:
        raise ExportError(f"node, own_frame and device are for {OCTREE}")
    acquisition = open_acquisition(acquisition_in(folder))
    path = export_images(acquisition, to, target)
    say(f"{len(acquisition.shots)} shots")
    if acquisition.missing:
        say(f"{len(acquisition.missing)} shots are still missing")
    return (path,)
