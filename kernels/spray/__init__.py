"""Kernels of the computed spray: gas, droplets, and their exchange."""
