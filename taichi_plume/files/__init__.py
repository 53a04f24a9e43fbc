"""The formats that are read and written, one file each."""

MAY_IMPORT: tuple[str, ...] = (
    "belief_scores",
    "grid",
    "guard",
    "map_scores",
    "scenario",
    "scores",
    "simulation",
)
