"""Gas and wind time series at measuring points, read from a run's probes.parquet in chunks.

Each sample of the table has a row per point, always in the same order of points.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import pyarrow as pa

from taichi_plume.files import run_tables
from taichi_plume.files.film import BACKGROUND
from taichi_plume.files.run_folder import RunFolderError

FEWEST = 16
"""Smallest number of samples for statistics."""
AXES = "xyz"


class Probe(NamedTuple):
    """Named set of measuring points: a point, a line or a grid.

    places: positions (n, dim) [m]; counts: numbers of points along each axis of a grid (in C order), else (n,); first:
    index of the set's first point in a record.
    """

    name: str
    places: np.ndarray
    counts: tuple[int, ...]
    first: int = 0

    @property
    def kind(self) -> str:
        """Kind of the set of measuring points: "point", "line" or "grid" as text."""
        return "point" if len(self.places) == 1 else "line" if len(self.counts) == 1 else "grid"

    @classmethod
    def of(cls, name: str, places: np.ndarray, first: int = 0) -> "Probe":
        """Return a probe with points at `places`; `counts` is that of a grid if the points form a complete lattice."""
        axes = [np.unique(places[:, d]) for d in range(places.shape[1])]
        counts = tuple(len(axis) for axis in axes)
        if sum(n > 1 for n in counts) > 1 and int(np.prod(counts)) == len(places):
            lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
            if np.array_equal(lattice, places):
                return cls(name, places, counts, first)
        return cls(name, places, (len(places),), first)


class Record(Protocol):
    """Time series of gas and wind at the points of several probes."""

    times: np.ndarray
    """Times of the samples, (n,) [s]."""
    probes: list[Probe]
    backgrounds: dict[str, float]
    """Concentration in clean air, above which a gas counts [ppm], by the name of its column; 0 for other columns."""

    def values(self, points: np.ndarray, quantity: str) -> np.ndarray:
        """Return a quantity's time series, (n, points) f32; points: ascending indices; quantity: column name."""
        ...


def chosen_gas(path: Path, gases: Sequence[str], gas: str | None) -> str:
    """Return `gas`, by default the first of a file's `gases`. Raises RunFolderError if `gases` lacks it or is empty."""
    if not gases:
        raise RunFolderError(f"{path}: holds no gas")
    if gas is not None and gas not in gases:
        raise RunFolderError(f"{path}: holds no {gas}, only {', '.join(gases)}")
    return gases[0] if gas is None else gas


def skipped_before(path: Path, times: np.ndarray, start: float | None, unit: str) -> int:
    """Return the number of samples with times before `start` [s]; unit: plural noun for "samples" in messages.

    Raises RunFolderError if fewer than FEWEST samples are left.
    """
    skipped = 0 if start is None else int(np.searchsorted(times, start - 1e-9))
    if len(times) - skipped < FEWEST:
        after = f" from {start:g} s on" if start is not None else ""
        count = f"{len(times) - skipped} {unit}{after}"
        raise RunFolderError(f"{path}: holds {count}; at least {FEWEST} are needed")
    return skipped


class ProbeRecord:
    """Time series in a run's probes.parquet from `start` [s] on. Raises RunFolderError if the file cannot be read.

    gases: names of species; wind: names of the wind's columns; start: earliest time [s].
    """

    def __init__(self, path: Path, start: float | None = None):
        self.path, self.start = path, start
        schema = next(run_tables.batches(path)).schema
        names = schema.names
        axes = [axis for axis in AXES if axis in names]
        if not {"t", "probe", "point", "x", "y"} <= set(names):
            raise RunFolderError(f"{path}: is damaged: lacks one of the columns t, probe, point, x, y")
        self.dim = len(axes)
        self.gases = [name.removesuffix("_ppm") for name in names if name.endswith("_ppm")]
        about = {name: schema.field(name).metadata or {} for name in names}
        self.backgrounds = {name: float(each.get(BACKGROUND.encode(), 0.0)) for name, each in about.items()}
        self.wind = [f"wind_{axis}" for axis in axes if f"wind_{axis}" in names]
        self.probes, self.size = self._layout(axes)
        self.times = self._times()

    def _layout(self, axes: Sequence[str]) -> tuple[list[Probe], int]:
        """Return the probes in the table's first sample, and the number of measuring points of all probes together."""
        rows: list[pa.RecordBatch] = []
        first = None
        for batch in run_tables.batches(self.path, ["t", "probe", "point", *axes]):
            if not len(batch):
                continue
            t = batch.column("t").to_numpy(zero_copy_only=False)
            first = t[0] if first is None else first
            later = np.flatnonzero(t != first)
            rows.append(batch.slice(0, int(later[0])) if len(later) else batch)
            if len(later):
                break
        if not rows:
            raise RunFolderError(f"{self.path}: holds no row")
        table = pa.Table.from_batches(rows).unify_dictionaries()
        names = table["probe"].cast(pa.string()).to_pylist()
        places = np.stack([table[axis].to_numpy().astype(float) for axis in axes], axis=-1)
        begins = [n for n in range(len(names)) if n == 0 or names[n] != names[n - 1]]
        ends = [*begins[1:], len(names)]
        found = [Probe.of(str(names[a]), places[a:b], a) for a, b in zip(begins, ends, strict=True)]
        return found, len(names)

    def _samples(self, columns: Sequence[str]) -> Iterator[list[np.ndarray]]:
        """Yield the table in chunks of complete samples: for each column an array of shape (samples, points)."""
        rest: list[np.ndarray] | None = None
        for batch in run_tables.batches(self.path, columns):
            parts = [batch.column(n).to_numpy(zero_copy_only=False) for n in range(len(columns))]
            if rest is not None:
                parts = [np.concatenate(pair) for pair in zip(rest, parts, strict=True)]
            whole = len(parts[0]) // self.size * self.size
            rest = [part[whole:] for part in parts]
            if whole:
                yield [part[:whole].reshape(-1, self.size) for part in parts]

    def _times(self) -> np.ndarray:
        found = []
        for (t,) in self._samples(["t"]):
            if not (t == t[:, :1]).all():
                raise RunFolderError(f"{self.path}: is damaged: a sample lacks points")
            found.append(t[:, 0].astype(float))
        times = np.concatenate(found) if found else np.empty(0)
        if (np.diff(times) <= 0.0).any() or not np.isfinite(times).all():
            raise RunFolderError(f"{self.path}: is damaged: its times do not increase")
        self.skipped = skipped_before(self.path, times, self.start, "samples")
        return times[self.skipped :]

    def _chunks(self, quantity: str) -> Iterator[tuple[int, np.ndarray]]:
        """Yield (index of the first sample, values) for chunks of a table column, without samples before `start`.

        Gas counts from its background on.
        """
        done = -self.skipped
        for (values,) in self._samples([quantity]):
            chunk = values[max(0, -done) :]
            if len(chunk):
                if not np.isfinite(chunk).all():
                    raise RunFolderError(f"{self.path}: not all of {quantity} are numbers")
                yield max(0, done), chunk - np.float32(self.backgrounds[quantity])
            done += len(values)

    def values(self, points: np.ndarray, quantity: str) -> np.ndarray:
        found = np.empty((len(self.times), len(points)), np.float32)
        for first, chunk in self._chunks(quantity):
            found[first : first + len(chunk)] = chunk[:, points]
        return found

    def sums(self, quantity: str) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean over time and the maximum of a quantity at each measuring point, both (points,)."""
        from taichi_plume.fluctuations.moments import weights

        share = weights(self.times)
        mean, largest = np.zeros(self.size), np.full(self.size, -np.inf)
        for first, chunk in self._chunks(quantity):
            mean += share[first : first + len(chunk)] @ chunk
            largest = np.maximum(largest, chunk.max(axis=0))
        return mean, largest
