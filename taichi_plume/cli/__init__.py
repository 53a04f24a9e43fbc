"""The commands: their options, what they print and their exit codes."""

MAY_IMPORT: tuple[str, ...] = (
    "assembly",
    "contest",
    "envs",
    "files",
    "grid",
    "guard",
    "record",
    "report",
    "results",
    "running",
    "scenario",
    "serve",
    "statistics",
    "study",
)
