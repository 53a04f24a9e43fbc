"""The vocabulary of a scenario, each section with its checks: pydantic and NumPy, never Taichi."""

MAY_IMPORT: tuple[str, ...] = (
    "assembly.resources",  # this and files for types alone: what the checks of a section are given to look at
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
