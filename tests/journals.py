"""Journals as tests read them."""

from __future__ import annotations

from pathlib import Path

from cldit.acquisition.journal import Entry, read_entries


def read_journal(path: Path) -> list[Entry]:
    """Every complete entry in order; raises the error of a damaged one."""
    entries, _, damage = read_entries(path)
    if damage is not None:
        raise damage
    return entries
