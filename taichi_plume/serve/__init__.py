"""Live service: simulate a scenario in real time, with robots that external programs drive."""

MAY_IMPORT: tuple[str, ...] = ("agents", "files", "grid", "guard", "observed", "execution", "time_loop")
