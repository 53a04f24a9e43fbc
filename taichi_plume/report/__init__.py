"""The report of a run, and the drawings that pictures share with it: all from a run's files, by matplotlib."""

MAY_IMPORT: tuple[str, ...] = (
    "declared",
    "files",
    "grid",
    "guard",
    "prepare",
    "record",
    "scenario",
    "signals",
    "summary",
)
