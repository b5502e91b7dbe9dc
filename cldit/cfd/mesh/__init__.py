"""Meshes of CFD results."""
