"""Execution of a simulation run: time loop, output files, checkpoints, signals, resuming and repair."""

MAY_IMPORT: tuple[str, ...] = (
    "agents",
    "assembly",
    "engine",
    "files",
    "grid",
    "guard",
    "observed",
    "record",
    "report",
    "results",
    "scenario",
    "scoring",
    "time_loop",
)
