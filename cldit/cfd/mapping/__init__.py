"""Names and units of the fields of a CFD result."""
