"""What a scenario becomes: its files opened and checked, its parts put together to a `Simulation`."""

MAY_IMPORT: tuple[str, ...] = ("agents", "files", "grid", "guard", "scenario", "simulation", "solvers")
