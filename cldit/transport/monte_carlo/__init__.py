"""Monte Carlo: unbiased path tracing, and the audit that it makes of the other methods."""
