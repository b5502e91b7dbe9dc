"""Tolerances of the import: how far numbers that should be equal, or places, may be apart."""

ROUNDED = 1e-6  # relative: a time of six digits, as OpenFOAM writes it; float32 has seven
WRITTEN = 1e-5  # relative to a number or the width of a mesh: six digits as text, rounded twice
SLACK = 1e-3  # of an edge, width, volume or of 1: bent faces, single precision, unbounded schemes
EXACT = 2.0**53  # whole numbers below are exact as floats
