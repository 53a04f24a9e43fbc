"""Results of a run: tables, fields, gas maps; export to other programs and to ROS 2 bags."""

MAY_IMPORT: tuple[str, ...] = (
    "agents",
    "engine",
    "files",
    "grid",
    "guard",
    "observed",
    "record",
    "report.html",
    "report.notebook",  # these parts of `report` only when a run or a map is drawn
    "report.pictures",
    "report.recorded_map",
    "report.theme",
    "scenario",
    "scoring",
    "time_loop",
)
