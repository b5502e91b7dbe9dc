"""EnSight Gold."""
