"""Final gather: the scattering integral of thick cells by short paths from each pixel."""
