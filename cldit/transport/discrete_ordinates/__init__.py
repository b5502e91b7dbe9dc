"""Discrete ordinates (S_N): quadrature, sweeps along characteristics, source iteration by GMRES."""
