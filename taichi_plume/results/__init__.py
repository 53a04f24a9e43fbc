"""What a run has left, read back: tables, fields, maps; exports to other programs and bags of ROS 2."""

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
