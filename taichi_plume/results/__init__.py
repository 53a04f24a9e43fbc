"""Results of a run: tables, fields, gas maps; export to other programs and to ROS 2 bags."""

MAY_IMPORT: tuple[str, ...] = (
    "agents",
    "files",
    "grid",
    "guard",
    "record",
    "scenario",
    "scoring",
    "time_loop",
)
