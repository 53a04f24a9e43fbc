"""What stands between foreign input and us: what is printed, which files are opened, which code may run."""

MAY_IMPORT: tuple[str, ...] = ()
