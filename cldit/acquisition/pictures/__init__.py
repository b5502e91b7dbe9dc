"""Readers of image files: the entry points of the group `cldit.readers`."""
