"""One droplet, or a million: fuel properties, evaporation, and integration in time."""
