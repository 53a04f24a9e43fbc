"""Robots: bodies, sensors, search algorithms and maps. Robots see the world only through sensors."""

MAY_IMPORT: tuple[str, ...] = ("files", "grid", "guard", "scenario")
