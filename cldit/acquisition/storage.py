"""Folder of an acquisition: its lock, its images, and its content."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cldit.acquisition.disk import checked_stream, existing
from cldit.acquisition.journal import Entry, read_entries
from cldit.acquisition.plan import Plan, Shot, load_plan
from cldit.errors import RunFolderError
from cldit.io.digests import sha256_of
from cldit.io.exclusive import LOCK, exclusive
from cldit.io.files import make_folder, written
from cldit.io.images import put_image, read_image

PLAN, RIG, CONFIGURATION = "plan.yaml", "rig.yaml", "configuration.json"
JOURNAL, SHOTS, GUARD = "journal.jsonl", "shots", "guard.log"
RUNNING = "acquisition"  # what locks the folder
_RESTORE = "restore the file, or remove it and acquire again: the shot is retaken"


class DamagedPicture(RunFolderError):
    """An image that is not, or no longer, the recorded one."""


@dataclass(frozen=True)
class FolderContent:
    """Content of an acquisition folder.

    saved: shot id -> the `saved` entry of its journal, for every shot whose file exists. adoptable:
    shot id -> metadata of a complete file that the journal does not list yet. torn: shots whose
    file a power cut damaged before the journal listed it. lost: `fired` entries without a result
    that the journal has not noted. gone: shots listed as saved whose file is missing. damage: error
    of the journal; its entries are those before it.
    """

    entries: list[Entry]
    saved: dict[str, Entry]
    adoptable: dict[str, dict[str, Any]]
    torn: tuple[str, ...]
    lost: list[Entry]
    gone: tuple[str, ...] = ()
    damage: RunFolderError | None = None

    @property
    def done(self) -> set[str]:
        """Ids of the shots whose images exist."""
        return {*self.saved, *self.adoptable}


def shot_path(folder: Path, shot_id: str) -> Path:
    """File of the images of shot `shot_id` in `folder`."""
    return folder / SHOTS / f"{shot_id}.tif"


def check_folder(folder: Path) -> None:
    """Raises as `exclusive` would, and leaves nothing behind: for callers that only ask."""
    if folder.exists():
        make_folder(folder)  # which says so where it is a file
    with written(folder), TemporaryDirectory(dir=existing(folder)):
        pass
    if (folder / LOCK).exists():
        with exclusive(folder, RUNNING):
            pass


def save_shot(
    folder: Path,
    shot: Shot,
    image: NDArray[np.uint16],
    *,
    pixel_m: tuple[float, float],
    meta: dict[str, Any],
) -> str:
    """Writes the images of a shot, (h, w) or (n, h, w) counts, with their metadata; durable on
    return. A failure leaves nothing behind. Returns the SHA-256 of the file.
    """
    with checked_stream(shot_path(folder, shot.id)) as stream:
        put_image(stream, image, name=shot.id, unit="counts", pixel_m=pixel_m, meta=meta)
        stream.seek(0)
        return hashlib.file_digest(stream, "sha256").hexdigest()


def load_shot(
    folder: Path, shot_id: str, *, plan_hash: str, file_sha256: str = ""
) -> tuple[NDArray[np.uint16], dict[str, Any]]:
    """Loads counts (h, w) or (n, h, w) and metadata of a shot, after every check.

    `file_sha256` is the digest in the journal, if it has one. Raises DamagedPicture if it cannot be
    read, or it or its pixels differ from the recorded checksums, and RunFolderError if it is not
    this shot of this plan.
    """
    path = shot_path(folder, shot_id)
    try:
        image, meta = read_image(path)
    except RunFolderError as error:
        raise DamagedPicture(f"{error}; {_RESTORE}") from error
    if image.dtype != np.uint16 or image.ndim not in (2, 3):
        raise RunFolderError(f"{path}: {image.dtype} of shape {image.shape} is no raw image")
    if not {"shot", "plan_hash", "sha256"} <= set(meta):
        raise DamagedPicture(f"{path}: does not say which shot it is; move it out of the folder")
    if meta["shot"] != shot_id or meta["plan_hash"] != plan_hash:
        raise RunFolderError(
            f"{path}: is no shot {shot_id} of this plan; move it out of the folder"
        )
    if file_sha256 and sha256_of(path) != file_sha256:
        raise DamagedPicture(f"{path}: is damaged: it is not the file of the journal; {_RESTORE}")
    return image, meta


def survey(folder: Path, plan: Plan, *, salvage: bool = False) -> FolderContent:
    """Lists the part of `plan` that is in `folder`, without changing anything.

    With `salvage` it continues where the journal is damaged, because images carry their own
    metadata and checksum: for the evaluation only; an acquisition must know every injection. Raises
    RunFolderError if the folder belongs to another plan or to something else, or is damaged.
    """
    journal = folder / JOURNAL
    entries, _, damage = read_entries(journal)
    if damage is not None and not salvage:
        raise damage
    pictures = sorted((folder / SHOTS).glob("*.tif"))
    if (folder / PLAN).exists():
        plan_hash = load_plan(folder / PLAN).hash()
        if plan_hash != plan.hash():
            raise RunFolderError(
                f"{folder}: holds another plan ({plan_hash[:12]}, not {plan.hash()[:12]}); resume "
                f"with {folder / PLAN}, or choose another folder"
            )
    elif entries or pictures:
        raise RunFolderError(f"{folder}: holds images but no {PLAN}; choose another folder")
    if (entries or pictures) and not salvage and not (folder / CONFIGURATION).exists():
        raise RunFolderError(
            f"{folder / CONFIGURATION}: is missing beside images; restore it, or choose another "
            "folder: today's rig may have another calibration"
        )
    planned = {shot.id for shot in plan.steps()}
    for path in pictures:
        if path.stem not in planned:
            raise RunFolderError(f"{path}: is no shot of this plan; move it out of the folder")
    present = {path.stem for path in pictures}
    keyed = [((entry.get("shot", ""), entry.get("attempt", -1)), entry) for entry in entries]
    fired = {key: entry for key, entry in keyed if entry["event"] == "fired"}
    ended = {key for key, entry in keyed if entry["event"] in ("saved", "rejected", "lost")}
    newest = dict(fired.keys())  # attempt by shot; once it is taken again, an earlier line is void
    recorded = {
        shot: entry
        for (shot, attempt), entry in keyed
        if entry["event"] == "saved" and attempt >= newest.get(shot, attempt)
    }
    saved = {shot_id: entry for shot_id, entry in recorded.items() if shot_id in present}
    adoptable: dict[str, dict[str, Any]] = {}
    torn: list[str] = []
    for shot_id in sorted(present - set(saved)):
        try:
            meta = load_shot(folder, shot_id, plan_hash=plan.hash())[1]
        except DamagedPicture:
            torn.append(shot_id)
            continue
        adoptable[shot_id] = meta
        ended.add((shot_id, int(meta["attempt"])))
    lost = [entry for key, entry in fired.items() if key not in ended]
    gone = tuple(sorted(set(recorded) - present))
    return FolderContent(entries, saved, adoptable, tuple(torn), lost, gone, damage)
