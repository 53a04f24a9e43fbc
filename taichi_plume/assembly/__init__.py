"""Assembly of a `TimeLoop` from a scenario: files are opened and checked, then all parts are made."""

MAY_IMPORT: tuple[str, ...] = (
    "agents",
    "engine",
    "files",
    "grid",
    "guard",
    "scenario",
    "solvers",
    "time_loop",
)
