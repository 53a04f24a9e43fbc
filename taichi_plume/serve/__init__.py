"""The live service: a scenario in real time, some of whose robots are driven from outside."""

MAY_IMPORT: tuple[str, ...] = ("agents", "files", "grid", "guard", "running", "simulation")
