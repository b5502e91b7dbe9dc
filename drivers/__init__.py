"""Instrument drivers, one instrument a file; a rig file names them, the package never does."""
