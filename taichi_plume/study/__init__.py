"""Studies: many runs from one file, on all cores or a cluster, and tables with intervals over airs."""

MAY_IMPORT: tuple[str, ...] = (
    "assemble",
    "files",
    "grid",
    "guard",
    "map_scores",
    "outputs",
    "own_code",
    "prepare",
    "report",
    "run_data",
    "running",
    "scenario",
    "scores",
    "signals",
    "simulation",
    "solvers",
)
