"""Python interface: functions and classes such as ``taichi_plume.simulate`` and ``taichi_plume.Simulation``."""

MAY_IMPORT: tuple[str, ...] = (
    "agents",
    "assembly",
    "contests",
    "engine",
    "execution",
    "files",
    "fluctuations",
    "guard",
    "observed",
    "report",
    "results",
    "scenario",
    "scoring",
    "studies",
    "time_loop",
)
