"""The Python API, and what notebooks show of its results."""
