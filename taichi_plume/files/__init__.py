"""Readers and writers of file formats, one module each."""

MAY_IMPORT: tuple[str, ...] = ("engine.choice", "grid", "guard", "scenario")
