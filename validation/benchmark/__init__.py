"""Benchmarks of speed: whole steps, the pressure alone, puffs, robots, trials, maps, and the start of a run."""
