"""Reader of a recording's pictures and wind arrows, in physical units.

A recording that cannot be read raises RunFolderError: a line that begins with the recording's path.
"""

import warnings
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr

from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.files.tables import plain
from taichi_plume.guard.safe_open import unopenable
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
    """Recorded pictures of a scalar on one plane, over time.

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
        """Physical values in `unit` of the bytes 0 to 255, float32.

        On a logarithmic scale byte 0 stands for values up to `low`, and its value is 0.
        """
        share = np.arange(256) / 255
        if not self.logarithmic:
            return (self.low + (self.high - self.low) * share).astype(np.float32)
        values = self.low * (self.high / self.low) ** share
        values[0] = 0.0
        return values.astype(np.float32)

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top edge of the picture in the plane's axes [m]."""
        (x, y), (dx, dy), (rows, columns) = self.origin, self.cell, self.data.shape[1:]
        return x, x + dx * columns, y, y + dy * rows

    def coordinates(self, axis: int) -> np.ndarray:
        """Return the centres of the pixels along the plane's first (0) or second (1) axis [m]."""
        return self.origin[axis] + (np.arange(self.data.shape[2 - axis]) + 0.5) * self.cell[axis]

    def values(self) -> np.ndarray:
        """Return the values of all pictures, (n, rows, columns), float32, in `unit`."""
        return self.levels[self.data]

    def mean(self) -> np.ndarray:
        """Return the mean of all pictures over the times, (rows, columns), in `unit`; times are not weighted."""
        table, total = self.levels, np.zeros(self.data.shape[1:])
        for frame in self.data:
            total += table[frame]
        return total / max(1, len(self.data))


class Arrows(NamedTuple):
    """Recorded wind: times (n,) [s]; for each time the arrows' tails and vectors, (m, 3) [m] as drawn."""

    times: np.ndarray
    tails: list[np.ndarray]
    ways: list[np.ndarray]


class RecordedPictures:
    """Reader of the pictures and wind arrows in a recording. Every method may raise RunFolderError.

    names: of pictures, such as "gas_slice", None for all; between: first and last time [s]; spacing: least time from
    picture to picture [s].
    """

    def __init__(self, path: Path):
        self.path = path

    def names(self) -> list[str]:
        """Return the names of the recording's pictures, such as "gas_slice"."""
        return list(self._blank)

    def read(
        self,
        names: Sequence[str] | None = None,
        between: tuple[float, float] = ALL_TIMES,
        spacing: float = 0.0,
    ) -> dict[str, Picture]:
        """Return pictures by name, from the times `between` (first, last) [s], at least `spacing` [s] apart."""
        pictures = {}
        for name in self._blank if names is None else [name for name in names if name in self._blank]:
            entity, blank = self._blank[name]
            size, times, parts = blank.data.shape[1:], [blank.times], [blank.data]
            for t, selected, column in self._rows(entity, [DATA], between, spacing):
                pixels = column[0].flatten().flatten().to_numpy(zero_copy_only=False)
                if pixels.size != len(t) * size[0] * size[1]:
                    raise RunFolderError(f"{self.path}: is damaged: pictures of {entity} have another size")
                times.append(t[selected])
                parts.append(pixels.reshape(len(t), *size)[selected, ::-1])
            t = np.concatenate(times)
            order = np.argsort(t, kind="stable")
            pictures[name] = blank._replace(times=t[order], data=np.concatenate(parts)[order])
        return pictures

    def span(self, names: Sequence[str] | None = None) -> tuple[float, float] | None:
        """Return the first and last time [s] of the named pictures, or None; pictures do not stay in memory."""
        ends: list[float] = []
        for name, (entity, _) in self._blank.items():
            if names is None or name in names:
                for t, _, _ in self._rows(entity, [DATA], ALL_TIMES, 0.0):
                    ends += [float(t.min()), float(t.max())]
        return (min(ends), max(ends)) if ends else None

    def arrows(self, plane: str, between: tuple[float, float] = ALL_TIMES, spacing: float = 0.0) -> Arrows:
        """Return the recorded wind arrows in a plane, such as "slice" or "section"; empty if there are none."""
        found: list[tuple[float, np.ndarray, np.ndarray]] = []
        components = ["Arrows3D:origins", "Arrows3D:vectors"]
        for t, selected, columns in self._rows(f"/wind/{plane}", components, between, spacing):
            tails, ways = (_points(column) for column in columns)
            found += [(float(t[k]), tails[k], ways[k]) for k in np.flatnonzero(selected)]
        found.sort(key=lambda arrow: arrow[0])
        times, all_tails, all_ways = zip(*found, strict=True) if found else ((), (), ())
        return Arrows(np.array(times, float), list(all_tails), list(all_ways))

    # ------------------------------------------------------------ rerun

    @cached_property
    def _blank(self) -> dict[str, tuple[str, Picture]]:
        """Entity path and scale of each picture in the recording, by name; the pictures have no frames."""
        static: dict[str, dict[str, Any]] = {}
        for entity, batch in self._chunks(is_static=True, components=[*SCALE, FORMAT]):
            for key in (*SCALE, FORMAT):
                if key in batch.schema.names:
                    static.setdefault(entity, {})[key] = batch.column(key)[0].as_py()
        pictures = {entity: values for entity, values in static.items() if FORMAT in values}
        if not pictures:
            raise RunFolderError(
                f"{self.path}: is no recording of a run of ours, or has been cut off at its begin"
            )
        scaled = {entity: values for entity, values in pictures.items() if {"low", "high"} <= values.keys()}
        if not scaled:
            raise RunFolderError(
                f"{self.path}: was made by another version, which did not say what its pictures stand for; run it again"
            )
        try:
            blank = [(entity, _blank(entity, values)) for entity, values in sorted(scaled.items())]
        except FAULTS as error:
            raise RunFolderError(f"{self.path}: is damaged: {plain(str(error))}") from None
        return {picture.name: (entity, picture) for entity, picture in blank}

    def _stream(self) -> "rr.chunk.LazyChunkStream":
        """Return the recording's data chunks, read by the file's index if present; killed runs leave no index."""
        reason = unopenable(self.path)
        if reason:
            raise RunFolderError(f"{self.path}: {reason}")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # errors of rerun without an index
            reader = rr.chunk.RrdReader(str(self.path))
            try:
                return reader.store().stream()
            except FAULTS:
                return reader.stream()

    def _chunks(self, **chosen: Any) -> Iterator[tuple[str, pa.RecordBatch]]:
        """Yield the entity path and Arrow table of each chunk of the recording that passes a filter."""
        try:
            for chunk in self._stream().filter(**chosen):
                yield chunk.entity_path, chunk.to_record_batch()
        except RunFolderError:
            raise
        except FAULTS as error:
            reason = plain(" ".join(str(error).split()))
            reason = reason.replace(f"Failed to read RRD file at {self.path}: ", "")
            raise RunFolderError(f"{self.path}: is cut off or no recording: {reason}") from None

    def _rows(
        self, entity: str, components: list[str], between: tuple[float, float], spacing: float
    ) -> Iterator[tuple[np.ndarray, np.ndarray, list[pa.Array]]]:
        """Yield from each chunk of an entity: times [s], mask of rows selected by time range and spacing, columns."""
        latest = -np.inf
        for _, batch in self._chunks(content=entity, components=components, is_static=False):
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


def _blank(entity: str, values: dict[str, Any]) -> Picture:
    """Return a Picture with scale, axes and units but no frames, from an entity's values as stored by rerun."""
    (low,), (high,), (scale,), (form,) = (values[key][:1] for key in ("low", "high", "scale", FORMAT))
    logarithmic = scale == "log"
    if not np.isfinite([low, high]).all() or high <= low or (logarithmic and low <= 0):
        raise ValueError(f"a scale from {low:g} to {high:g}")
    cell, origin = [float(x) for x in values["cell"]], [float(x) for x in values.get("origin", (0.0, 0.0))]
    name, view = entity.strip("/").replace("/", "_"), entity.rpartition("/")[2]
    plane = (values.get("plane") or [""])[0]  # rerun stores no empty text
    return Picture(
        name, view, values["quantity"][0], values["unit"][0], float(low), float(high), logarithmic, plane,
        values["axes"][0], (cell[0], cell[-1]), (origin[0], origin[1]), np.zeros(0),
        np.zeros((0, form["height"], form["width"]), np.uint8),
    )  # fmt: skip


def _points(column: pa.Array) -> list[np.ndarray]:
    """Return an array of points (m, 3) for each row of an Arrow column of lists."""
    counts = column.value_lengths().fill_null(0).to_numpy(zero_copy_only=False)
    flat = column.flatten().flatten().to_numpy(zero_copy_only=False).reshape(-1, 3)
    return np.split(flat, np.cumsum(counts)[:-1])


# ---------------------------------------------------------------- xarray


def dataset(pictures: Iterable[Picture]) -> "xr.Dataset":
    """Return recorded pictures as an xarray dataset: `gas_slice` (time, y, x) and so on, float32 in ppm or K, with CF
    attributes. If pixels or times of planes differ, the dimensions of the later plane get the plane's name:
    `z_section`.
    """
    import xarray as xr

    variables: dict[str, tuple] = {}
    coords: dict[str, tuple] = {}
    for picture in pictures:
        name, dims = picture.name, []
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
    """Return the CF attributes (units, long_name, axis) of a coordinate: "time", "x", "y" or "z"."""
    if axis == "time":
        return {"units": "s", "long_name": "simulated time", "axis": "T"}
    return {"units": "m", "long_name": f"middle of the pixels along {axis}", "axis": axis.upper()}
