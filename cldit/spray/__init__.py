"""Sprays: parcels and gas from a model or an import, behind one result."""
