"""Sections of a scenario with their keys and checks: pydantic and NumPy, never Taichi."""

MAY_IMPORT: tuple[str, ...] = (
    "assembly.preparation",  # this and `report` by methods of Scenario alone, when they are called
    "assembly.resources",  # this and `files` for types alone
    "files.disk",
    "files.trajectories",
    "files.film",
    "files.gaden",
    "files.wind_site",
    "grid.floor_plans",
    "grid.map_files",
    "grid.meshes",
    "grid.outlines",
    "grid.unresolved",
    "grid.shapes",
    "guard",
    "report.notebook",
    "report.scene",
    "report.theme",
)
