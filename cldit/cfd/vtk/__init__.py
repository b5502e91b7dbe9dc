"""VTK files, read by the `vtk` package."""
