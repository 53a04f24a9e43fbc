"""Benchmarks of speed: whole steps, pressure, puffs, robots, trials, maps, dispersion, and the start of a run."""
