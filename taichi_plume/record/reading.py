"""Pictures and wind arrows read back from a recording of ours, in the units they stand for.

Whatever keeps a recording from being read is a RunFolderError: one line that begins with its path.
"""

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr

from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.files.tables import plain
from taichi_plume.guard.opening import unopenable
from taichi_plume.record.drawing import TIME

if TYPE_CHECKING:
    import xarray as xr

LEVELS = 256  # of a picture's bytes
SCALE = ("quantity", "unit", "low", "high", "scale", "plane", "axes", "cell", "origin")
"""What a recording says of each picture's bytes and place."""
FORMAT, DATA = "GridMap:format", "GridMap:data"
ALL_TIMES = (-np.inf, np.inf)
MEANING = {"slice": "in a plane", "column": "maximum over the height", "section": "in a vertical plane"}
FAULTS = (RuntimeError, ValueError, LookupError, TypeError, ArithmeticError, OSError, pa.ArrowException)
"""Of what rerun and Arrow read."""


class Picture(NamedTuple):
    """A plane of a scalar over time, as it was recorded.

    name: "gas_0_section_2", say; view: the plane's, "section_2"; plane: where that is, for people; axes: of the plane,
    "xy", "xz" or "yz"; cell, origin: size and lower left corner of its pixels along these [m]. times (n,) [s]; data
    (n, rows, columns): place of each pixel on the scale from `low` (0) to `high` (255), rows along the second axis,
    columns along the first, both ascending.
    """

    name: str
    view: str
    quantity: str
    unit: str
    low: float
    high: float
    logarithmic: bool
    plane: str
    axes: str
    cell: tuple[float, float]
    origin: tuple[float, float]
    times: np.ndarray
    data: np.ndarray

    @property
    def levels(self) -> np.ndarray:
        """What the 256 bytes stand for, in `unit`; of a logarithmic scale 0 for "at most low"."""
        return levels(self.low, self.high, self.logarithmic)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of its pixels [m]."""
        (x, y), (dx, dy), (rows, columns) = self.origin, self.cell, self.data.shape[1:]
        return x, x + dx * columns, y, y + dy * rows

    def coordinates(self, axis: int) -> np.ndarray:
        """Middles of its pixels along its first (0) or second (1) axis [m]."""
        return self.origin[axis] + (np.arange(self.data.shape[2 - axis]) + 0.5) * self.cell[axis]

    def values(self, frames: slice | Sequence[int] = slice(None)) -> np.ndarray:
        """Of some frames, (n, rows, columns), float32, in `unit`."""
        return self.levels[self.data[frames]]

    def mean(self) -> np.ndarray:
        """Over its frames, (rows, columns), in `unit`."""
        table, total = self.levels, np.zeros(self.data.shape[1:])
        for frame in self.data:
            total += table[frame]
        return total / max(1, len(self.data))


class Arrows(NamedTuple):
    """The recorded wind: times (n,) [s]; of each the arrows' tails and ways, (m, 3) [m] as drawn."""

    times: np.ndarray
    tails: list[np.ndarray]
    ways: list[np.ndarray]


def levels(low: float, high: float, logarithmic: bool) -> np.ndarray:
    """What the bytes of a picture stand for, (256,) float32."""
    share = np.arange(LEVELS) / (LEVELS - 1)
    if not logarithmic:
        return (low + (high - low) * share).astype(np.float32)
    values = low * (high / low) ** share
    values[0] = 0.0
    return values.astype(np.float32)


def read(
    path: Path,
    names: Sequence[str] | None = None,
    between: tuple[float, float] = ALL_TIMES,
    spacing: float = 0.0,
) -> dict[str, Picture]:
    """The pictures of a recording by name, or those of some names, as far as there are such.

    between: first and last time [s]; spacing: least time from frame to frame [s]. Raises RunFolderError.
    """
    scales = _scales(path)
    pictures = {}
    for name in scales if names is None else [name for name in names if name in scales]:
        its = scales[name]
        size, entity = its.pop("size"), its.pop("entity")
        times, parts = [], []
        for t, kept, column in _rows(path, entity, [DATA], between, spacing):
            pixels = column[0].flatten().flatten().to_numpy(zero_copy_only=False)
            if pixels.size != len(t) * size[0] * size[1]:
                raise RunFolderError(f"{path}: is damaged: pictures of {entity} have another size")
            times.append(t[kept])
            parts.append(pixels.reshape(len(t), *size)[kept, ::-1])
        t = np.concatenate(times) if times else np.zeros(0)
        data = np.concatenate(parts) if parts else np.zeros((0, *size), np.uint8)
        order = np.argsort(t, kind="stable")
        pictures[name] = Picture(name, **its, times=t[order], data=data[order])
    return pictures


def names(path: Path) -> list[str]:
    """Which pictures a recording has. Raises RunFolderError."""
    return list(_scales(path))


def span(path: Path, wanted: Sequence[str] | None = None) -> tuple[float, float] | None:
    """First and last time [s] of the pictures of some names, or of all; None where there are none.

    However long the recording is, no picture of it is kept. Raises RunFolderError.
    """
    first, last = np.inf, -np.inf
    for name, its in _scales(path).items():
        if wanted is None or name in wanted:
            for t, _, _ in _rows(path, its["entity"], [DATA], ALL_TIMES, 0.0):
                first, last = min(first, float(t.min())), max(last, float(t.max()))
    return (first, last) if first <= last else None


def arrows(
    path: Path, plane: str = "slice", between: tuple[float, float] = ALL_TIMES, spacing: float = 0.0
) -> Arrows:
    """The wind of a recording in a plane, "slice" or "section"; none where it has none. Raises RunFolderError."""
    found: list[tuple[float, np.ndarray, np.ndarray]] = []
    for t, kept, columns in _rows(
        path, f"/wind/{plane}", ["Arrows3D:origins", "Arrows3D:vectors"], between, spacing
    ):
        tails, ways = (_points(column) for column in columns)
        found += [(float(t[k]), tails[k], ways[k]) for k in np.flatnonzero(kept)]
    found.sort(key=lambda one: one[0])
    return Arrows(np.array([one[0] for one in found]), [one[1] for one in found], [one[2] for one in found])


def pictures(path: Path) -> "xr.Dataset":
    """All pictures of a recording: `gas_slice` (time, y, x) and the like, float32 in ppm or K, with CF attributes.

    Where planes differ in their pixels or times, the later one's dimensions have its name: `z_section`.
    Raises RunFolderError.
    """
    import xarray as xr

    variables: dict[str, Any] = {}
    coords: dict[str, Any] = {}
    for name, one in read(path).items():
        dims = []
        for axis, along in (
            ("time", one.times),
            (one.axes[1], one.coordinates(1)),
            (one.axes[0], one.coordinates(0)),
        ):
            dim = axis
            if dim in coords and not np.array_equal(coords[dim][1], along):
                dim = f"{axis}_{one.view}"
            if dim in coords and not np.array_equal(coords[dim][1], along):
                dim = f"{axis}_{name}"
            coords.setdefault(dim, (dim, along, _about(axis)))
            dims.append(dim)
        where = one.plane or MEANING.get(one.view, one.view)
        about = {"long_name": f"{one.quantity}, {where}", "units": one.unit, "plane": one.plane}
        about |= {"recorded_from": one.low, "recorded_to": one.high}
        variables[name] = (dims, one.values(), about)
    comment = (
        "decoded from 256 colours between recorded_from and recorded_to; values beyond these are cut off"
    )
    about = {"Conventions": "CF-1.11", "source": "taichi_plume recording", "comment": comment}
    return xr.Dataset(variables, coords, about)


def _about(axis: str) -> dict[str, str]:
    """CF attributes of a coordinate."""
    if axis == "time":
        return {"units": "s", "long_name": "simulated time", "axis": "T"}
    return {"units": "m", "long_name": f"middle of the pixels along {axis}", "axis": axis.upper()}


# ---------------------------------------------------------------- rerun


def _stream(path: Path) -> Any:
    """The chunks of a recording, by its index where it has one; that of a killed run has none."""
    reason = unopenable(path)
    if reason:
        raise RunFolderError(f"{path}: {reason}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of rerun, where there is no index
        try:
            reader = rr.chunk.RrdReader(str(path))
            try:
                return reader.store().stream()
            except FAULTS:
                return reader.stream()
        except FAULTS as error:
            raise _unread(path, error) from None


def _unread(path: Path, error: Exception) -> RunFolderError:
    reason = plain(" ".join(str(error).split())).replace(f"Failed to read RRD file at {path}: ", "")
    return RunFolderError(f"{path}: is cut off or no recording: {reason}")


def _chunks(path: Path, **wanted: Any) -> Iterator[Any]:
    """Tables of the chunks that a filter leaves, each with its entity."""
    try:
        for chunk in _stream(path).filter(**wanted):
            yield chunk.entity_path, chunk.to_record_batch()
    except RunFolderError:
        raise
    except FAULTS as error:
        raise _unread(path, error) from None


def _scales(path: Path) -> dict[str, dict[str, Any]]:
    """Of each picture what a `Picture` says of it, its `entity`, and `size`: rows and columns."""
    told: dict[str, dict[str, Any]] = {}
    for entity, batch in _chunks(path, is_static=True, components=[*SCALE, FORMAT]):
        for key in (*SCALE, FORMAT):
            if key in batch.schema.names:
                told.setdefault(entity, {})[key] = batch.column(key)[0].as_py()
    pictures = {entity: its for entity, its in told.items() if FORMAT in its}
    if not pictures:
        raise RunFolderError(f"{path}: is no recording of a run of ours, or has been cut off at its begin")
    scaled = {entity: its for entity, its in pictures.items() if {"low", "high"} <= its.keys()}
    if not scaled:
        raise RunFolderError(
            f"{path}: was made by another version, which did not say what its pictures stand for; run it again"
        )
    try:
        return {
            entity.strip("/").replace("/", "_"): _scale(its)
            | {"entity": entity, "view": entity.rpartition("/")[2]}
            for entity, its in sorted(scaled.items())  # in a file they come in any order
        }
    except FAULTS as error:
        raise RunFolderError(f"{path}: is damaged: {plain(str(error))}") from None


def _scale(its: dict[str, Any]) -> dict[str, Any]:
    """One picture's, from lists as rerun keeps them."""
    one = {key: its[key][0] for key in ("quantity", "unit", "scale", "axes")}
    low, high = float(its["low"][0]), float(its["high"][0])
    logarithmic = one.pop("scale") == "log"
    if not np.isfinite([low, high]).all() or high <= low or (logarithmic and low <= 0):
        raise ValueError(f"a scale from {low:g} to {high:g}")
    cell, origin = [float(x) for x in its["cell"]], [float(x) for x in its.get("origin", (0.0, 0.0))]
    format_ = its[FORMAT][0]
    plane = (its.get("plane") or [""])[0]  # rerun keeps no empty text
    return {
        **one,
        "low": low,
        "high": high,
        "logarithmic": logarithmic,
        "plane": plane,
        "cell": (cell[0], cell[-1]),
        "origin": (origin[0], origin[1]),
        "size": (format_["height"], format_["width"]),
    }


def _rows(
    path: Path, entity: str, components: list[str], between: tuple[float, float], spacing: float
) -> Iterator[tuple[np.ndarray, np.ndarray, list[pa.Array]]]:
    """Times [s] and columns of an entity, chunk by chunk, and which rows to keep: those that are in time, and apart."""
    latest = -np.inf
    for _, batch in _chunks(path, content=entity, components=components, is_static=False):
        if TIME not in batch.schema.names or not set(components) <= set(batch.schema.names):
            continue
        t = batch.column(TIME).cast(pa.int64()).to_numpy() * 1e-9
        kept = (t >= between[0] - 1e-9) & (t <= between[1] + 1e-9)
        if spacing > 0:
            for k in np.flatnonzero(kept):
                kept[k] = t[k] >= latest + spacing - 1e-6
                latest = t[k] if kept[k] else latest
        if kept.any():
            yield t, kept, [batch.column(name) for name in components]


def _points(column: pa.Array) -> list[np.ndarray]:
    """Points (m, 3) of each row."""
    counts = column.value_lengths().fill_null(0).to_numpy(zero_copy_only=False)
    flat = column.flatten().flatten().to_numpy(zero_copy_only=False).reshape(-1, 3)
    return np.split(flat, np.cumsum(counts)[:-1])
