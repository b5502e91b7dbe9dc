"""Readers of picture files: the entry points of the group `cldit.readers`."""
