"""Contest (benchmark) of search algorithms, shipped and the user's, in fixed scenarios, with intervals over airs."""

MAY_IMPORT: tuple[str, ...] = (
    "assembly",
    "engine",
    "files",
    "grid",
    "guard",
    "observed",
    "report",
    "scenario",
    "scoring",
    "time_loop",
    "studies",
)

AIRS, SEARCHES = 8, 8
QUICK_AIRS, QUICK_SEARCHES = 2, 4
