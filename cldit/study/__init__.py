"""Studies of a scene: the paper's, one by one, and sweeps over any of its keys."""
