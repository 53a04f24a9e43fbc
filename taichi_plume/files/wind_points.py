"""Reader of imported air flow (CFD) as a table of points, one per line, in any order, each with its velocity.

Accepted forms, recognised by the content:

    CSV         the first line names the columns, in any order: ParaView's "U:0", "Points:0" or U_0, Points_0 (as in
                GADEN's wind_at_cell_centers_N.csv), Fluent's x-velocity, x-coordinate, or plain x, y, z, u, v, w
    OpenFOAM    sampled sets in `raw` format: columns between blanks, named in a comment, # x y z Ux Uy Uz, or six
                columns in this order without a comment

Units are m and m/s; `nut` [m²/s] is the eddy viscosity. Other columns are ignored. Files of a 2-D flow may leave out z
and w.
"""

import re
from dataclasses import dataclass
from glob import escape, glob
from itertools import pairwise
from os.path import join
from pathlib import Path

import numpy as np

from taichi_plume.files.tables import LONGEST_TEXT, Table, TextFile, cells_of, delimiter_of, is_number, listed
from taichi_plume.guard.safe_open import unopenable

PLACES = ("points:{n}", "points_{n}", "points_{a}", "{a}", "c{a}", "c:{n}", "c_{n}", "{a}-coordinate")
SPEEDS = ("u:{n}", "u_{n}", "u{a}", "u_{a}", "{u}", "velocity:{n}", "velocity_{n}", "velocity_{a}",
          "{a}-velocity", "umean:{n}", "umean_{n}", "umean_{a}")  # fmt: skip
EDDIES = ("nut",)
FARTHEST = 1e8  # m: room for coordinates of the Earth
FASTEST = 340.0  # m/s: a larger value usually means "no value"
MOST_NUMBER = 1e12  # in names of files: seconds, or a counter
NUMBERED = re.compile(r"%0?\d*d")
TIMED = "%g"


class WindFileError(ValueError):
    """Error: a file of an imported wind cannot be used; the message begins with the path."""


@dataclass(frozen=True)
class Points:
    """Wind at points: place [m] and velocity [m/s], (n, 2 or 3), and eddy viscosity [m²/s], (n,) or None."""

    path: Path
    place: np.ndarray
    velocity: np.ndarray
    eddy_viscosity: np.ndarray | None

    @property
    def kind(self) -> tuple[int, bool]:
        """Number of dimensions, and whether the points have an eddy viscosity."""
        return self.place.shape[1], self.eddy_viscosity is not None


def find(folder: Path, pattern: str, interval: float) -> list[tuple[float, Path]]:
    """Return (time [s], path) of files that match a pattern with %d (times `interval`) or %g. Raises WindFileError."""
    marks = [*NUMBERED.findall(pattern), *re.findall(TIMED, pattern)]
    path = folder / pattern
    if not marks:
        if path.is_dir():
            what = "holds no mesh in constant/polyMesh or processor0/constant/polyMesh, so it is no case of OpenFOAM"
            raise WindFileError(
                f"{path}: this folder {what}; give a case, a time of a case, or files of points"
            )
        reason = unopenable(path)
        if reason:
            raise WindFileError(f"{path}: {reason}")
        return [(0.0, path)]
    if len(marks) > 1:
        raise WindFileError(f"{path}: has {' and '.join(marks)}; give only one of %d and %g")
    timed = marks[0] == TIMED
    parts = pattern.split(marks[0])
    parts[0] = join(folder, parts[0])
    number = r"(\d+(?:\.\d*)?(?:e[-+]?\d+)?)" if timed else r"(\d+)"
    form = re.compile(number.join(map(re.escape, parts)))
    files: dict[float, Path] = {}
    for name in sorted(glob("*".join(map(escape, parts)))):
        match = form.fullmatch(name)
        if match:
            key = float(match[1])
            if key > MOST_NUMBER:
                raise WindFileError(f"{name}: its number is above {MOST_NUMBER:g}")
            if key in files:
                raise WindFileError(f"{name}: has the same number as {files[key]}; remove one")
            files[key] = Path(name)
    if not files:
        raise WindFileError(f"{path}: there is no such file, whatever {marks[0]} stands for")
    numbers = sorted(files)
    if timed:
        return [(key, files[key]) for key in numbers]
    for a, b in pairwise(numbers):
        if b > a + 1:
            raise WindFileError(f"{folder / pattern.replace(marks[0], f'{int(a) + 1}')}: is missing, "
                                f"between {files[a].name} and {files[b].name}")  # fmt: skip
    return [(n * interval, files[key]) for n, key in enumerate(numbers)]


def read(path: Path) -> Points:
    """Return positions, velocities and any eddy viscosity from a table of points. Raises WindFileError."""
    file = TextFile(path, WindFileError)
    lines = file.lines
    names, first, delimiter = _header(lines, (file.rows(0) or [len(lines)])[0])
    if names is None:
        if first == len(lines) or delimiter or len(lines[first].split()) != 6:
            raise file.wrong(first + 1, "is no header that names the columns, such as x,y,z,u,v,w")
        names = ["x", "y", "z", "u", "v", "w"]
    columns = [_column(names, forms, n) for forms in (PLACES, SPEEDS) for n in range(3)]
    flat = columns[2] is None and columns[5] is None
    needed = zip("xyzuvw", columns, strict=True)
    missing = ", ".join(what for what, column in needed if column is None and not (flat and what in "zw"))
    if missing:
        hint = 'call them x, y, z, u, v, w or "Points:0", "U:0" and so on'
        raise file.wrong(first, f"names no column for {missing}, only {listed(names)}; {hint}")
    taken = [column for column in [*columns, _column(names, EDDIES, 0)] if column is not None]
    rows = file.rows(first)
    if not rows:
        raise WindFileError(f"{path}: has no points")
    width = max(1 + max(taken), len(cells_of(lines[rows[0]], delimiter)))  # some headers end with a comma
    table = Table(file, rows, width, delimiter)
    values = table.numbers(*taken)
    dim = 2 if flat else 3
    table.refuse(~np.isfinite(values).all(axis=1), lambda _: "not all of its values are finite")
    far = np.abs(values[:, :dim]).max(axis=1)
    table.refuse(far > FARTHEST, lambda row: f"{far[row]:.3g} m is too far; at most {FARTHEST:g} m")
    speed = np.abs(values[:, dim : 2 * dim]).max(axis=1)
    table.refuse(speed >= FASTEST, lambda row: f"{speed[row]:.3g} m/s is too fast; leave the point out")
    if len(values) < 2**dim:
        raise WindFileError(f"{path}: has {len(values)} points, too few")
    eddies = np.maximum(values[:, 2 * dim], 0.0) if len(taken) > 2 * dim else None
    return Points(path, values[:, :dim], values[:, dim : 2 * dim], eddies)


def _header(lines: list[str], first: int) -> tuple[list[str] | None, int, str | None]:
    """Return column names (None without a header), index of the first row, and delimiter (None for blanks).

    first: index of the first line that is no comment.
    """
    sample = lines[first] if first < len(lines) else ""
    delimiter = delimiter_of(sample)
    words = [_plain(word) for word in cells_of(sample, delimiter)]
    if not any(is_number(word) for word in words):
        return words, first + 1, delimiter
    for line in reversed(lines[:first]):
        words = [_plain(word) for word in cells_of(line.lstrip("# "), delimiter_of(line))]
        if _column(words, PLACES, 0) is not None:
            return words, first, delimiter
    return None, first, delimiter


def _plain(name: str) -> str:
    """Return a column's name in lower case, without quotation marks and unit."""
    return re.sub(r"\s*[\[(][^\])]*[a-z][^\])]*[\])]$", "", name.strip("' ").lower()[:LONGEST_TEXT])


def _column(names: list[str], forms: tuple[str, ...], n: int) -> int | None:
    """Return the index of the first column whose name has one of these forms for axis n; None if there is none."""
    for form in forms:
        name = form.format(n=n, a="xyz"[n], u="uvw"[n])
        if name in names:
            return names.index(name)
    return None
