"""How a run went, by what only the simulation knows: trials, declarations, beliefs and maps."""

MAY_IMPORT: tuple[str, ...] = ("agents", "grid", "scenario", "simulation")
