"""Sections of a scenario with their keys and checks: pydantic and NumPy, never Taichi."""

MAY_IMPORT: tuple[str, ...] = (
    "grid.floor_plans",
    "grid.map_files",
    "grid.meshes",
    "grid.outlines",
    "grid.unresolved",
    "grid.shapes",
    "guard",
)
