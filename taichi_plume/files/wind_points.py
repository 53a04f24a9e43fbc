"""Reader of imported air flow (CFD) as a table of points, one per line, in any order, each with its velocity.

Known are these names of columns, and x, y, z, u, v, w:

    ParaView      "Points:0" or "Coordinates:0", "U:0"; Points_0, U_0 as in GADEN's wind_at_cell_centers_N.csv
    Fluent        x-coordinate, x-velocity
    STAR-CCM+     "X (m)", "Velocity[i] (m/s)"
    CFD-Post      X [ m ], Velocity u [ m s^-1 ]
    COMSOL        % x y z u (m/s)
    OpenFOAM      # x y z Ux Uy Uz of sampled sets in `raw` format, or six columns in this order without a comment

Units in the header count, otherwise they are m and m/s; `nut` [m²/s] is the eddy viscosity. Other columns are ignored.
Files of a 2-D flow may leave out z and w. Points whose velocity is missing are left out.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from glob import escape, glob
from itertools import pairwise
from os.path import join
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.files.named_columns import Column, read_columns
from taichi_plume.files.tables import TextFile
from taichi_plume.guard.safe_open import unopenable

if TYPE_CHECKING:  # brings SciPy's optimisers
    from taichi_plume.grid.point_box import Stand

PLACES = ("points:{n}", "points_{n}", "points_{a}", "{a}", "coordinates:{n}", "coordinates_{n}", "coordinates_{a}",
          "c{a}", "c:{n}", "c_{n}", "{a}-coordinate", "{a} coordinate", "{a}_coordinate", "centroid[{a}]",
          "position[{a}]", "pos_{a}", "position_{a}")  # fmt: skip
SPEEDS = ("u:{n}", "u_{n}", "u{a}", "u_{a}", "{u}", "velocity:{n}", "velocity_{n}", "velocity_{a}", "velocity_{u}",
          "velocity[{i}]", "velocity[{a}]", "velocity {u}", "velocity {a}", "velocity.{u}", "{a}-velocity",
          "{a} velocity", "{a}_velocity", "v{a}", "umean:{n}", "umean_{n}", "umean_{a}",
          "velocity field, {a}-component", "velocity field, {a} component")  # fmt: skip
PLACE = r"cell ?cent(er|re)s[:_ ]?({n}|{a})"
SPEED = (  # spf.u of COMSOL, Mean of Velocity[i] of STAR-CCM+, Velocity.Trnavg u of CFD-Post, U:X
    r"(?!.*(rms|std|var|prime|fluct|vort|grad))"
    r"(\w+\.{u}|(u|(mean of )?velocity(\.trnavg| in [\w ]+)?)[:_ ]?[\[( :_]({n}|{a}|{i}|{u})[\])]?)"
)
EDDIES = ("nut",)
MOST_REPEATED = 0.75  # share of different positions in a table of one time
GADEN = "wind_at_cell_centers"
FARTHEST = 1e8  # m: room for coordinates of the Earth
FASTEST = 340.0  # m/s: a larger value usually means "no value"
MOST_NUMBER = 1e12  # in names of files: seconds, or a counter
NUMBERED = re.compile(r"%0?\d*d")
TIMED = "%g"


class WindFileError(ValueError):
    """Error: a file of an imported wind cannot be used; the message begins with the path."""


@dataclass(frozen=True)
class Points:
    """Wind at points: place [m] and velocity [m/s], (n, 2 or 3), and eddy viscosity [m²/s], (n,) or None.

    box: lower and upper corner [m] of what a mesh fills, if the file has one. remarks: what was assumed.
    form: text on the points, if they are no table; stand: whether the points are nodes or centres, if the file states
    it; left_out: number of points without velocity; assumed: units that the header does not state.
    """

    path: Path
    place: np.ndarray
    velocity: np.ndarray
    eddy_viscosity: np.ndarray | None
    box: tuple[np.ndarray, np.ndarray] | None = None
    remarks: tuple[str, ...] = ()
    form: str = ""
    stand: "Stand | None" = None
    left_out: int = 0
    assumed: str = ""

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


def read(path: Path, given: Mapping[str, str] | None = None, missing: Sequence[float] = ()) -> Points:
    """Return positions, velocities and any eddy viscosity from a table of points.

    given: names of columns for x, y, z, u, v, w and nut; missing: numbers that mean none, see `read_columns`. Raises
    WindFileError.
    """
    file = TextFile(path, WindFileError)
    named = read_columns(file, COLUMNS, given, missing, "xyzuvw", gaps=True)
    values, table = named.values, named.table
    _require_one_time(path, values)
    if "w" not in values and "z" in values and np.ptp(values["z"]) == 0.0:  # a plane of a 2-D flow
        del values["z"]
    axes, speeds = ("xyz", "uvw") if "z" in values else ("xy", "uv")
    lacks = [key for key in (*axes, *speeds) if key not in values]
    if lacks:
        raise WindFileError(f"{path}: has no column {', '.join(lacks)}; it has one for {', '.join(values)}")
    place, velocity = (np.stack([values[key] for key in keys], axis=-1) for keys in (axes, speeds))
    table.refuse(~np.isfinite(place).all(axis=1), lambda _: "its position is no finite number")
    known = np.asarray(np.isfinite(velocity).all(axis=1) & (values.get("valid", np.ones(len(place))) != 0))
    far, speed = np.abs(place).max(axis=1, initial=0.0), np.abs(velocity).max(axis=1, initial=0.0)
    table.refuse(far > FARTHEST, lambda row: f"{far[row]:.3g} m is too far; at most {FARTHEST:g} m")
    table.refuse(speed >= FASTEST, lambda row: f"{speed[row]:.3g} m/s is too fast; leave the point out")
    if known.sum() < 2 ** np.count_nonzero((place != place[:1]).any(axis=0)) or not known.any():
        raise WindFileError(f"{path}: has {known.sum()} points with a velocity, too few")
    remarks = named.remarks
    if (
        named.names == [*"xyzuvw"]
        and named.picked["x"].name == "x"
        and not re.search("[a-z]", file.lines[0].lower())
    ):
        remarks += ("has no header; its columns are taken as x, y, z, u, v, w",)
    if not known.all():
        remarks += (f"{len(known) - known.sum()} of {len(known)} points have no velocity, and are left out",)
    eddies = np.maximum(np.nan_to_num(values["nut"][known]), 0.0) if "nut" in values else None
    left_out = int(len(known) - known.sum())
    silent = sorted(
        {COLUMNS[key].unit for key, column in named.picked.items() if not column.unit} - {"", "s"}
    )
    stand = _stand(path, named.names)
    return Points(
        path,
        place[known],
        velocity[known],
        eddies,
        remarks=remarks,
        stand=stand,
        left_out=left_out,
        assumed=", ".join(silent),
    )


def _require_one_time(path: Path, values: Mapping[str, np.ndarray]) -> None:
    """Raise WindFileError if a table holds several times: each is a file of its own."""
    times = np.unique(values.get("time", np.zeros(1)))
    if len(times) > 1:
        raise WindFileError(
            f"{path}: holds {len(times)} times, {times[0]:g} to {times[-1]:g} s; write a file for each"
        )
    place = np.stack([values[axis] for axis in "xyz" if axis in values], axis=-1)
    if len(place) and len(np.unique(place, axis=0)) <= MOST_REPEATED * len(place):
        raise WindFileError(f"{path}: its positions repeat, as of several times; write a file for each time")


def _stand(path: Path, names: Sequence[str]) -> "Stand | None":
    """Return whether points are nodes or centres of cells by the header, or by GADEN's name; None if unknown."""
    plain = {re.sub(r"[ _]", "", name.lower()) for name in names}
    if plain & {"nodenumber", "nodeid", "vertexid"}:
        return "nodes"
    is_cell = plain & {"cellnumber", "cellid", "elementnumber", "elementid"} or path.name.startswith(GADEN)
    return "centres" if is_cell else None


def _axis(form: str, n: int) -> str:
    return (
        form.replace("{n}", str(n)).replace("{a}", "xyz"[n]).replace("{u}", "uvw"[n]).replace("{i}", "ijk"[n])
    )


COLUMNS = {
    key: Column(
        tuple(_axis(form, n) for form in forms),
        unit,
        is_needed=n < 2,
        may_lack=unit == "m/s",
        pattern=_axis(pattern, n),
    )
    for forms, pattern, keys, unit in ((PLACES, PLACE, "xyz", "m"), (SPEEDS, SPEED, "uvw", "m/s"))
    for n, key in enumerate(keys)
} | {
    "nut": Column(EDDIES, "m^2/s", is_needed=False, may_lack=True),
    "time": Column(("time", "timestep"), "s", is_needed=False),
    "valid": Column(("vtkvalidpointmask",), is_needed=False),
}
