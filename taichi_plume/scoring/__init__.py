"""Scores of a run against the truth of the simulation: trials (success rate), declarations, beliefs and gas maps."""

MAY_IMPORT: tuple[str, ...] = ("agents", "grid", "scenario", "time_loop")
