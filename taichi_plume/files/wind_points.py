"""Air flow as other programs write it: points in any order, one a line, each with its velocity.

What is accepted, told apart by its content:

    CSV         a first line that names the columns, in any order: ParaView's "U:0", "Points:0" or U_0, Points_0 (as
                in GADEN's wind_at_cell_centers_N.csv), Fluent's x-velocity, x-coordinate, or plain x, y, z, u, v, w
    OpenFOAM    the sampled sets of its `raw` format: columns between blanks, named in a comment, # x y z Ux Uy Uz, or,
                with none, six in this order

Metres and metres per second; `nut` [m²/s] is the eddy viscosity. Other columns are left alone. Files of a 2-D flow may
leave out z and w.
"""

import re
from dataclasses import dataclass
from glob import escape, glob
from itertools import pairwise
from math import hypot, isfinite
from os.path import join
from pathlib import Path

import numpy as np

PLACES = ("points:{n}", "points_{n}", "points_{a}", "{a}", "c{a}", "c:{n}", "c_{n}", "{a}-coordinate")
SPEEDS = ("u:{n}", "u_{n}", "u{a}", "u_{a}", "{u}", "velocity:{n}", "velocity_{n}", "velocity_{a}",
          "{a}-velocity", "umean:{n}", "umean_{n}", "umean_{a}")  # fmt: skip
EDDIES = ("nut",)
FASTEST = 340.0  # m/s: faster air would be compressible; rather a mark for "no value"
NUMBERED = re.compile(r"%0?\d*d")
TIMED = "%g"


class WindFileError(ValueError):
    """A file that cannot be taken; the message begins with its path."""


@dataclass(frozen=True)
class Points:
    """What a file holds: places [m] and velocities [m/s], (n, 2 or 3), and the eddy viscosity [m²/s], (n,) or None."""

    path: Path
    place: np.ndarray
    velocity: np.ndarray
    eddy_viscosity: np.ndarray | None

    @property
    def kind(self) -> tuple[int, bool]:
        """Of what these are: number of dimensions, and whether there is an eddy viscosity."""
        return self.place.shape[1], self.eddy_viscosity is not None


def find(folder: Path, pattern: str, interval: float) -> list[tuple[float, Path]]:
    """The files that a pattern means, with their times [s], in order. Raises WindFileError."""
    marks = [*NUMBERED.findall(pattern), *re.findall(TIMED, pattern)]
    path = folder / pattern
    if not marks:
        if not path.is_file():
            raise WindFileError(f"{path}: {'is a folder' if path.is_dir() else 'does not exist'}")
        return [(0.0, path)]
    if len(marks) > 1:
        raise WindFileError(f"{path}: has {' and '.join(marks)}; one of %d and %g says which files are meant")
    timed = marks[0] == TIMED
    parts = pattern.split(marks[0])
    parts[0] = join(folder, parts[0])
    number = r"(\d+(?:\.\d*)?(?:e[-+]?\d+)?)" if timed else r"(\d+)"
    form = re.compile(number.join(map(re.escape, parts)))
    found: dict[float, Path] = {}
    for name in sorted(glob("*".join(map(escape, parts)))):
        match = form.fullmatch(name)
        if match:
            key = float(match[1])
            if key in found:
                raise WindFileError(f"{name}: has the same number as {found[key]}; remove one")
            found[key] = Path(name)
    if not found:
        raise WindFileError(f"{path}: there is no such file, whatever {marks[0]} stands for")
    numbers = sorted(found)
    if timed:
        return [(key, found[key]) for key in numbers]
    for a, b in pairwise(numbers):
        if b > a + 1:
            raise WindFileError(f"{folder / pattern.replace(marks[0], f'{int(a) + 1}')}: is missing, "
                                f"between {found[a].name} and {found[b].name}")  # fmt: skip
    return [(n * interval, found[key]) for n, key in enumerate(numbers)]


def text_of(path: Path) -> list[str]:
    """The lines of a text file. Raises WindFileError."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise WindFileError(f"{path}: is no text file") from None
    except OSError as error:
        raise WindFileError(f"{path}: cannot be read: {error.strerror or error}") from None
    if not text.strip():
        raise WindFileError(f"{path}: is empty")
    return text.splitlines()


def read(path: Path) -> Points:
    """The points of one file. Raises WindFileError."""
    lines = text_of(path)
    first = next((n for n, line in enumerate(lines) if line.strip() and not line.startswith("#")), len(lines))
    names, first, delimiter = _header(lines, first)
    if names is None:
        if first == len(lines) or delimiter or len(lines[first].split()) != 6:
            raise WindFileError(f"{path}: line {first + 1}: is no header that names the columns, such as "
                                "x,y,z,u,v,w")  # fmt: skip
        names = ["x", "y", "z", "u", "v", "w"]
    columns = [_column(names, forms, n) for forms in (PLACES, SPEEDS) for n in range(3)]
    flat = columns[2] is None and columns[5] is None
    missing = [
        what
        for what, column in zip(["x", "y", "z", "u", "v", "w"], columns, strict=True)
        if column is None and not (flat and what in "zw")
    ]
    if missing:
        raise WindFileError(
            f"{path}: line {first}: names no column for {', '.join(missing)}, only {', '.join(names)}; call "
            'them x, y, z, u, v, w or "Points:0", "U:0" and so on'
        )
    taken = [column for column in [*columns, _column(names, EDDIES, 0)] if column is not None]
    rows = lines[first:]
    if not any(map(str.strip, rows)):
        raise WindFileError(f"{path}: has no points")
    try:
        values = np.loadtxt(rows, delimiter=delimiter, usecols=taken, ndmin=2, quotechar='"')
    except ValueError:
        values = np.full((1, len(taken)), np.nan)
    dim = 2 if flat else 3
    speed = np.abs(values[:, dim : 2 * dim]).max(initial=0.0)
    if not np.isfinite(values).all() or not speed < FASTEST:
        raise WindFileError(f"{path}: {_fault(rows, first, delimiter, taken, dim)}")
    if len(values) < 2**dim:
        raise WindFileError(f"{path}: has {len(values)} points, too few")
    return Points(
        path,
        values[:, :dim],
        values[:, dim : 2 * dim],
        np.maximum(values[:, 2 * dim], 0.0) if len(taken) > 2 * dim else None,
    )


def _header(lines: list[str], first: int) -> tuple[list[str] | None, int, str | None]:
    """Names of the columns, if there are any; index of the first row; what stands between columns, None: blanks.

    first: index of the first line that is no comment.
    """
    sample = lines[first] if first < len(lines) else ""
    delimiter = next((mark for mark in ",;\t" if mark in sample), None)
    words = [_plain(word) for word in sample.split(delimiter)]
    if not any(_is_number(word) for word in words):
        return words, first + 1, delimiter
    for line in reversed(lines[:first]):
        words = [_plain(word) for word in line.lstrip("# ").split(None if delimiter == "\t" else delimiter)]
        if _column(words, PLACES, 0) is not None:
            return words, first, delimiter
    return None, first, delimiter


def _plain(name: str) -> str:
    """A column's name without quotes and unit."""
    name = name.strip().strip("\"'").strip().lower()
    return re.sub(r"\s*[\[(][^\])]*[a-z][^\])]*[\])]$", "", name)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _column(names: list[str], forms: tuple[str, ...], n: int) -> int | None:
    """Index of the column that has the first of these names, of axis n."""
    for form in forms:
        name = form.format(n=n, a="xyz"[n], u="uvw"[n])
        if name in names:
            return names.index(name)
    return None


def _fault(rows: list[str], first: int, delimiter: str | None, taken: list[int], dim: int) -> str:
    """What is wrong with the first row that is: its line, and one value of it."""
    for n, row in enumerate(rows, first + 1):
        row = row.partition("#")[0].strip()
        if not row:
            continue
        parts = [part.strip().strip('"') for part in row.split(delimiter)]
        if len(parts) <= max(taken):
            return f"line {n}: has {len(parts)} columns, not {max(taken) + 1}; is the file whole?"
        bad = next((parts[c] for c in taken if not _is_number(parts[c])), None)
        if bad is not None:
            return f"line {n}: '{bad}' is no number"
        values = [float(parts[c]) for c in taken]
        if not all(map(isfinite, values)):
            return f"line {n}: not all of its values are finite"
        if hypot(*values[dim : 2 * dim]) >= FASTEST:
            return (
                f"line {n}: {hypot(*values[dim : 2 * dim]):.3g} m/s is no speed of air; leave such points out"
            )
    return "is damaged"
