"""The rerun recording; nothing else knows rerun."""

MAY_IMPORT: tuple[str, ...] = ("files", "grid", "guard", "map_scores", "scenario", "scores", "simulation")
