"""The vocabulary of a scenario, each section with its checks: pydantic and NumPy, never Taichi."""

MAY_IMPORT: tuple[str, ...] = (
    "grid.floor_plans",
    "grid.map_files",
    "grid.meshes",
    "grid.missed",
    "grid.shapes",
    "guard",
)
