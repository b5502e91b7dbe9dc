"""Scene to what is traced: spray, optical properties, and an octree for each node."""
