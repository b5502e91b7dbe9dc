"""OpenCL: devices, source assembly, building, buffers."""

from cldit.io.caches import use_caches

use_caches()  # before pyopencl is imported and PoCL is loaded: both need a folder
