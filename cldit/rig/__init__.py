"""Instruments as Protocols, the rig file, and the clock."""
