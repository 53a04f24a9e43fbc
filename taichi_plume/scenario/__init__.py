"""Sections of a scenario with their keys and checks: pydantic and NumPy, never Taichi."""

MAY_IMPORT: tuple[str, ...] = (
    "assembly.resources",  # this and `files` for types alone
    "files.bag_ways",
    "files.film",
    "files.gaden",
    "files.site",
    "grid.floor_plans",
    "grid.map_files",
    "grid.meshes",
    "grid.missed",
    "grid.shapes",
    "guard",
)
