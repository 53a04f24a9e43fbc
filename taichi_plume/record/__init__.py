"""The rerun recording; nothing else knows rerun."""

MAY_IMPORT: tuple[str, ...] = (
    "belief_scores",
    "declared",
    "files",
    "grid",
    "guard",
    "map_scores",
    "scenario",
    "scores",
    "simulation",
)
