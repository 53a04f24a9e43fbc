"""The contest: fixed scenarios, all search algorithms and the user's own, one table with intervals over airs."""

MAY_IMPORT: tuple[str, ...] = (
    "assemble",
    "declared",
    "exit_codes",
    "files",
    "grid",
    "guard",
    "own_code",
    "prepare",
    "report",
    "scenario",
    "signals",
    "simulation",
    "study",
)
