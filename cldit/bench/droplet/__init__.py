"""Droplet models against published droplets, and their convergence."""
