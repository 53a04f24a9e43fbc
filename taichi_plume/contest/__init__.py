"""The contest: fixed scenarios, all search algorithms and the user's own, one table with intervals over airs."""

MAY_IMPORT: tuple[str, ...] = (
    "assembly",
    "files",
    "grid",
    "guard",
    "report",
    "scenario",
    "scoring",
    "simulation",
    "study",
)
