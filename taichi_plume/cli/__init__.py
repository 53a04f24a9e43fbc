"""Command-line interface: options, printed output and exit code of each command."""

MAY_IMPORT: tuple[str, ...] = (
    "api",
    "assembly",
    "contests",
    "draw",
    "engine",
    "envs",
    "files",
    "guard",
    "record",
    "report",
    "results",
    "execution",
    "scenario",
    "serve",
    "studies",
)
