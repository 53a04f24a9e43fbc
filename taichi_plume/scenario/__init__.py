"""The vocabulary of a scenario, with its checks: pydantic and NumPy, never Taichi."""

MAY_IMPORT: tuple[str, ...] = ("files", "grid")
