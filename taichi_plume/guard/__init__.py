"""What stands between foreign input and us: printing, opening files, YAML, and child processes with limits."""

MAY_IMPORT: tuple[str, ...] = ()
