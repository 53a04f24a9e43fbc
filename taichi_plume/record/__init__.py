"""Recording of a run for the viewer rerun; no other package imports rerun."""

MAY_IMPORT: tuple[str, ...] = ("files", "grid", "guard", "observed", "scenario", "scoring", "time_loop")
