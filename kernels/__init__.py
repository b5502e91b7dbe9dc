"""OpenCL C sources of cldit; `cldit.gpu.source` reads and assembles them."""
