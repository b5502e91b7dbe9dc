"""Optical data that cldit ships: fitted bands and small tables, each with source and status."""
