"""Processes that advance fields: air flow and gas."""

MAY_IMPORT: tuple[str, ...] = ("files", "grid", "scenario")
