"""Octree and the maps that carry a spray into it."""
