"""What stands between foreign input and us: what is printed, and which files are opened."""

MAY_IMPORT: tuple[str, ...] = ()
