"""Studies: many runs from one file, on all cores or a cluster, and tables with confidence intervals."""

MAY_IMPORT: tuple[str, ...] = (
    "assembly",
    "engine",
    "files",
    "grid",
    "guard",
    "report",
    "execution",
    "scenario",
    "scoring",
    "time_loop",
    "solvers",
)
