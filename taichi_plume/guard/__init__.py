"""Protection against foreign input: printing, opening files, YAML, and child processes with limits."""

MAY_IMPORT: tuple[str, ...] = ()
