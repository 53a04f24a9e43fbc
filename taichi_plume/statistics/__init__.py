"""Statistics of plumes from what runs leave: profiles, intermittency, whiffs and blanks, spectra; and their page."""

MAY_IMPORT: tuple[str, ...] = ("agents", "files", "grid", "guard", "report", "run_data", "scenario")
