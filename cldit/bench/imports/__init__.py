"""What importing a large CFD case takes, beside what vtk takes to read it."""
