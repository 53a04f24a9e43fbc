"""Processes that advance fields: air flow and gas."""

MAY_IMPORT: tuple[str, ...] = ("engine", "files", "grid", "scenario")
