"""The computed spray against independent results."""
