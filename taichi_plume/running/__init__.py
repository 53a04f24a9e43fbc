"""The life of a run: from the first tick to its files, checkpoints, signals, resuming and repair."""

MAY_IMPORT: tuple[str, ...] = (
    "agents",
    "assembly",
    "files",
    "grid",
    "guard",
    "record",
    "report",
    "results",
    "scenario",
    "scoring",
    "simulation",
)
