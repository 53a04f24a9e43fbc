"""Contest (benchmark) of search algorithms, shipped and the user's, in fixed scenarios, with intervals over airs."""

MAY_IMPORT: tuple[str, ...] = (
    "assembly",
    "files",
    "grid",
    "guard",
    "report",
    "scenario",
    "scoring",
    "time_loop",
    "studies",
)
