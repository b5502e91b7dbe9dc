"""The Python API and the interfaces to napari, bluesky and notebooks."""
