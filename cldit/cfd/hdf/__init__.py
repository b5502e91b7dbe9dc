"""CFD formats in HDF5."""
