"""Files, plain data, caches, terminal and provenance: all that touches the outside."""
