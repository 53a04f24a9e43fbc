"""Assembly of a `Simulation` from a scenario: files are opened and checked, then all parts are made."""

MAY_IMPORT: tuple[str, ...] = ("agents", "files", "grid", "guard", "scenario", "simulation", "solvers")
