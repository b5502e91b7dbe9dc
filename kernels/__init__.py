"""OpenCL C sources of cldit; `cldit.gpu.kernel_source` reads and assembles them."""
