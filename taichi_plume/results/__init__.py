"""Results of a run: tables, fields, maps; exports to other programs and ROS 2 bags."""

MAY_IMPORT: tuple[str, ...] = (
    "agents",
    "files",
    "grid",
    "guard",
    "record",
    "scenario",
    "scoring",
    "simulation",
)
