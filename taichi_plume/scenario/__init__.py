"""Sections of a scenario with their keys and checks: pydantic and NumPy, never Taichi."""

MAY_IMPORT: tuple[str, ...] = (
    "assembly.resources",  # this and `files` for types alone
    "files.trajectories",
    "files.film",
    "files.gaden",
    "files.wind_site",
    "grid.floor_plans",
    "grid.map_files",
    "grid.meshes",
    "grid.unresolved",
    "grid.shapes",
    "guard",
)
