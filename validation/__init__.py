"""Cases with known answers, experiments, benchmarks, and comparisons of two checkouts."""
