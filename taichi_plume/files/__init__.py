"""The formats that are read and written, one file each."""

MAY_IMPORT: tuple[str, ...] = ("grid", "guard", "scenario")
