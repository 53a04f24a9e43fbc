"""Results of a run: tables, fields, gas maps; export to other programs and to ROS 2 bags."""

MAY_IMPORT: tuple[str, ...] = (
    "agents",
    "files",
    "grid",
    "guard",
    "record",
    "report.notebook",  # this and `report.pictures` only when a run is drawn
    "report.pictures",
    "scenario",
    "scoring",
    "time_loop",
)
