"""Robots: bodies, sensors, search algorithms and maps. Robots see the world only through sensors."""

MAY_IMPORT: tuple[str, ...] = ("engine", "files", "grid", "guard", "scenario")
