"""OpenCL: devices, source assembly, building, buffers."""
