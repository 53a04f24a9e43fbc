"""A CSV of readings, for tests."""

from collections.abc import Iterable, Sequence
from pathlib import Path


def log(path: Path, rows: Iterable[Sequence[object]], header: str = "t,x,y,reading") -> Path:
    """Write the rows below the header."""
    path.write_text(header + "\n" + "".join(",".join(map(str, row)) + "\n" for row in rows))
    return path
