"""Sections of a scenario with their keys and checks: pydantic and NumPy, never Taichi."""

MAY_IMPORT: tuple[str, ...] = (
    "assembly.preparation",  # this and `report` by methods of Scenario alone, when they are called
    "files.disk",
    "grid.floor_plans",
    "grid.map_files",
    "grid.meshes",
    "grid.unresolved",
    "grid.shapes",
    "guard",
    "report.notebook",
    "report.scene",
    "report.theme",
)
