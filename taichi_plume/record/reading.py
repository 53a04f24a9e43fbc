"""Reader of a recording's pictures and wind arrows, in physical units.

A recording that cannot be read raises RunFolderError: a line that begins with the recording's path.
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

SCALE = ("quantity", "unit", "low", "high", "scale", "plane", "axes", "cell", "origin")
"""Values in a recording that describe the bytes and the position of each picture."""
FORMAT, DATA = "GridMap:format", "GridMap:data"
ALL_TIMES = (-np.inf, np.inf)
MEANING = {"slice": "in a plane", "column": "maximum over the height", "section": "in a vertical plane"}
FAULTS = (RuntimeError, ValueError, LookupError, TypeError, ArithmeticError, OSError, pa.ArrowException)
"""Errors of rerun and Arrow."""


class Picture(NamedTuple):
    """Recorded plane of a scalar over time.

    name: "gas_0_section_2", for example; view: name of the plane, "section_2"; plane: text of its position; axes: of
    the plane, "xy", "xz" or "yz"; cell, origin: size of the pixels and lower left corner along these [m]. times (n,)
    [s]; data (n, rows, columns): position of each pixel on the scale from `low` (0) to `high` (255), rows along the
    second axis, columns along the first, both ascending.
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
        """Values of the 256 bytes in `unit`, float32; on a logarithmic scale 0 for "at most low"."""
        share = np.arange(256) / 255
        if not self.logarithmic:
            return (self.low + (self.high - self.low) * share).astype(np.float32)
        values = self.low * (self.high / self.low) ** share
        values[0] = 0.0
        return values.astype(np.float32)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top of the pixels [m]."""
        (x, y), (dx, dy), (rows, columns) = self.origin, self.cell, self.data.shape[1:]
        return x, x + dx * columns, y, y + dy * rows

    def coordinates(self, axis: int) -> np.ndarray:
        """Return the middles of the pixels along the first (0) or second (1) axis [m]."""
        return self.origin[axis] + (np.arange(self.data.shape[2 - axis]) + 0.5) * self.cell[axis]

    def values(self) -> np.ndarray:
        """Return all frames, (n, rows, columns), float32, in `unit`."""
        return self.levels[self.data]

    def mean(self) -> np.ndarray:
        """Return the mean over the frames, (rows, columns), in `unit`."""
        table, total = self.levels, np.zeros(self.data.shape[1:])
        for frame in self.data:
            total += table[frame]
        return total / max(1, len(self.data))


class Arrows(NamedTuple):
    """Recorded wind: times (n,) [s]; for each time the arrows' tails and vectors, (m, 3) [m] as drawn."""

    times: np.ndarray
    tails: list[np.ndarray]
    ways: list[np.ndarray]


def read(
    path: Path,
    names: Sequence[str] | None = None,
    between: tuple[float, float] = ALL_TIMES,
    spacing: float = 0.0,
) -> dict[str, Picture]:
    """Return the pictures of a recording by name, all or those of given names.

    between: first and last time [s]; spacing: least time from frame to frame [s]. Raises RunFolderError.
    """
    scales = _scales(path)
    pictures = {}
    for name in scales if names is None else [name for name in names if name in scales]:
        entity, size, scale = scales[name]
        times, parts = [np.zeros(0)], [np.zeros((0, *size), np.uint8)]
        for t, selected, column in _rows(path, entity, [DATA], between, spacing):
            pixels = column[0].flatten().flatten().to_numpy(zero_copy_only=False)
            if pixels.size != len(t) * size[0] * size[1]:
                raise RunFolderError(f"{path}: is damaged: pictures of {entity} have another size")
            times.append(t[selected])
            parts.append(pixels.reshape(len(t), *size)[selected, ::-1])
        t = np.concatenate(times)
        order = np.argsort(t, kind="stable")
        pictures[name] = Picture(name, **scale, times=t[order], data=np.concatenate(parts)[order])
    return pictures


def names(path: Path) -> list[str]:
    """Return the names of the pictures of a recording. Raises RunFolderError."""
    return list(_scales(path))


def span(path: Path, selection: Sequence[str] | None = None) -> tuple[float, float] | None:
    """Return the first and last time [s] of the pictures of given names, or of all; None without pictures.

    No picture stays in memory. Raises RunFolderError.
    """
    ends: list[float] = []
    for name, (entity, _, _) in _scales(path).items():
        if selection is None or name in selection:
            for t, _, _ in _rows(path, entity, [DATA], ALL_TIMES, 0.0):
                ends += [float(t.min()), float(t.max())]
    return (min(ends), max(ends)) if ends else None


def arrows(
    path: Path, plane: str = "slice", between: tuple[float, float] = ALL_TIMES, spacing: float = 0.0
) -> Arrows:
    """Return the wind of a recording in a plane, "slice" or "section", or an empty wind. Raises RunFolderError."""
    found: list[tuple[float, np.ndarray, np.ndarray]] = []
    components = ["Arrows3D:origins", "Arrows3D:vectors"]
    for t, selected, columns in _rows(path, f"/wind/{plane}", components, between, spacing):
        tails, ways = (_points(column) for column in columns)
        found += [(float(t[k]), tails[k], ways[k]) for k in np.flatnonzero(selected)]
    found.sort(key=lambda arrow: arrow[0])
    return Arrows(
        np.array([t for t, _, _ in found]), [tail for _, tail, _ in found], [way for _, _, way in found]
    )


def pictures(path: Path) -> "xr.Dataset":
    """Return all pictures of a recording: `gas_slice` (time, y, x) and so on, float32 in ppm or K, with CF attributes.

    If pixels or times of planes differ, the dimensions of the later plane get its name: `z_section`. Raises
    RunFolderError.
    """
    import xarray as xr

    variables: dict[str, tuple] = {}
    coords: dict[str, tuple] = {}
    for name, picture in read(path).items():
        dims = []
        vertical, horizontal = picture.coordinates(1), picture.coordinates(0)
        for axis, along in (
            ("time", picture.times),
            (picture.axes[1], vertical),
            (picture.axes[0], horizontal),
        ):
            for dim in (axis, f"{axis}_{picture.view}", f"{axis}_{name}"):
                if dim not in coords or np.array_equal(coords[dim][1], along):
                    break
            coords.setdefault(dim, (dim, along, _attributes(axis)))
            dims.append(dim)
        where = picture.plane or MEANING.get(picture.view, picture.view)
        about = {"long_name": f"{picture.quantity}, {where}", "units": picture.unit, "plane": picture.plane}
        about |= {"recorded_from": picture.low, "recorded_to": picture.high}
        variables[name] = (dims, picture.values(), about)
    comment = (
        "decoded from 256 colours between recorded_from and recorded_to; values beyond these are cut off"
    )
    about = {"Conventions": "CF-1.11", "source": "taichi_plume recording", "comment": comment}
    return xr.Dataset(variables, coords, about)


def _attributes(axis: str) -> dict[str, str]:
    """Return the CF attributes of a coordinate."""
    if axis == "time":
        return {"units": "s", "long_name": "simulated time", "axis": "T"}
    return {"units": "m", "long_name": f"middle of the pixels along {axis}", "axis": axis.upper()}


# ---------------------------------------------------------------- rerun


def _stream(path: Path) -> "rr.chunk.LazyChunkStream":
    """Return the chunks of a recording, by its index if present: the recording of a killed run has no index."""
    reason = unopenable(path)
    if reason:
        raise RunFolderError(f"{path}: {reason}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # errors of rerun without an index
        reader = rr.chunk.RrdReader(str(path))
        try:
            return reader.store().stream()
        except FAULTS:
            return reader.stream()


def _chunks(path: Path, **chosen: Any) -> Iterator[tuple[str, pa.RecordBatch]]:
    """Yield entity and table of the chunks that pass a filter."""
    try:
        for chunk in _stream(path).filter(**chosen):
            yield chunk.entity_path, chunk.to_record_batch()
    except RunFolderError:
        raise
    except FAULTS as error:
        reason = plain(" ".join(str(error).split())).replace(f"Failed to read RRD file at {path}: ", "")
        raise RunFolderError(f"{path}: is cut off or no recording: {reason}") from None


def _scales(path: Path) -> dict[str, tuple[str, tuple[int, int], dict[str, Any]]]:
    """Return for each picture its entity, its rows and columns, and the fields of `Picture` known without its data."""
    static: dict[str, dict[str, Any]] = {}
    for entity, batch in _chunks(path, is_static=True, components=[*SCALE, FORMAT]):
        for key in (*SCALE, FORMAT):
            if key in batch.schema.names:
                static.setdefault(entity, {})[key] = batch.column(key)[0].as_py()
    pictures = {entity: values for entity, values in static.items() if FORMAT in values}
    if not pictures:
        raise RunFolderError(f"{path}: is no recording of a run of ours, or has been cut off at its begin")
    scaled = {entity: values for entity, values in pictures.items() if {"low", "high"} <= values.keys()}
    if not scaled:
        raise RunFolderError(
            f"{path}: was made by another version, which did not say what its pictures stand for; run it again"
        )
    try:
        return {
            entity.strip("/").replace("/", "_"): (entity, *_scale(entity, values))
            for entity, values in sorted(scaled.items())  # a file has them in any order
        }
    except FAULTS as error:
        raise RunFolderError(f"{path}: is damaged: {plain(str(error))}") from None


def _scale(entity: str, values: dict[str, Any]) -> tuple[tuple[int, int], dict[str, Any]]:
    """Return rows and columns, and the fields of a picture, from lists as stored by rerun."""
    quantity, unit, scale, axes = (values[key][0] for key in ("quantity", "unit", "scale", "axes"))
    low, high, logarithmic = float(values["low"][0]), float(values["high"][0]), scale == "log"
    if not np.isfinite([low, high]).all() or high <= low or (logarithmic and low <= 0):
        raise ValueError(f"a scale from {low:g} to {high:g}")
    cell, origin = [float(x) for x in values["cell"]], [float(x) for x in values.get("origin", (0.0, 0.0))]
    form, plane = values[FORMAT][0], (values.get("plane") or [""])[0]  # rerun stores no empty text
    fields = {"view": entity.rpartition("/")[2], "quantity": quantity, "unit": unit, "low": low, "high": high}
    fields |= {"logarithmic": logarithmic, "plane": plane, "axes": axes}
    fields |= {"cell": (cell[0], cell[-1]), "origin": (origin[0], origin[1])}
    return (form["height"], form["width"]), fields


def _rows(
    path: Path, entity: str, components: list[str], between: tuple[float, float], spacing: float
) -> Iterator[tuple[np.ndarray, np.ndarray, list[pa.Array]]]:
    """Yield the times [s] of each chunk of an entity, a mask of the selected rows, and its columns.

    Rows are selected if they are `between` two times, and `spacing` apart.
    """
    latest = -np.inf
    for _, batch in _chunks(path, content=entity, components=components, is_static=False):
        if TIME not in batch.schema.names or not set(components) <= set(batch.schema.names):
            continue
        t = batch.column(TIME).cast(pa.int64()).to_numpy() * 1e-9
        selected = (t >= between[0] - 1e-9) & (t <= between[1] + 1e-9)
        if spacing > 0:
            for k in np.flatnonzero(selected):
                selected[k] = t[k] >= latest + spacing - 1e-6
                latest = t[k] if selected[k] else latest
        if selected.any():
            yield t, selected, [batch.column(name) for name in components]


def _points(column: pa.Array) -> list[np.ndarray]:
    """Return the points (m, 3) of each row."""
    counts = column.value_lengths().fill_null(0).to_numpy(zero_copy_only=False)
    flat = column.flatten().flatten().to_numpy(zero_copy_only=False).reshape(-1, 3)
    return np.split(flat, np.cumsum(counts)[:-1])
