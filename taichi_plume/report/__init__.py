"""Report of a run, and drawings for reports, pictures and films: from a run's files, by matplotlib."""

import logging

# In a home that cannot be written matplotlib uses a temporary folder for its font cache: no warning is needed.
logging.getLogger("matplotlib").setLevel(logging.ERROR)

MAY_IMPORT: tuple[str, ...] = (
    "assembly",
    "files",
    "grid",
    "guard",
    "observed",
    "record",
    "results",
    "execution",
    "scenario",
    "scoring",
)
