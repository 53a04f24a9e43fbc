"""The rerun recording; nothing else knows rerun."""

MAY_IMPORT: tuple[str, ...] = ("files", "grid", "guard", "scenario", "scoring", "simulation")
