"""Planck, Mie and vapour: what the medium absorbs, scatters and emits."""
