"""The analytic spray: a cone of droplets and vapour at each hole."""
