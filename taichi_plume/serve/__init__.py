"""The live service: a scenario in real time, some of whose robots are driven from outside."""

MAY_IMPORT: tuple[str, ...] = (
    "agents",
    "exit_codes",
    "files",
    "grid",
    "guard",
    "own_code",
    "prepare",
    "running",
    "scenario",
    "signals",
    "simulation",
)
