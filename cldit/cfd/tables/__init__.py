"""Tables of cells and parcels, for codes whose own files are not read."""
