"""Statistics of a film (recorded flow and gas) or of pictures: maps, lines of points along and across the plume.

Each line is a probe whose points are cells or pixels. The dataset is read twice, frame by frame. Fluctuations faster
than the frames are not resolved.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.files.film import BACKGROUND
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.fluctuations.durations import stretches
from taichi_plume.fluctuations.moments import weights
from taichi_plume.fluctuations.records import AXES, Probe, chosen_gas, skipped_before

if TYPE_CHECKING:
    import xarray

STATIONS = (0.1, 0.25, 0.5, 0.8)
"""Positions of lines across the plume, as fractions of the distance from the highest mean to the domain's end."""


class FilmRecord:
    """Time statistics of one gas in a dataset from time `start` [s] on, and time series on lines of cells.

    path: file of the dataset; data: variables NAME_ppm over (time, [z,] y, x), NaN or `air` 0 in obstacles, and maybe
    the wind u, v, w. sources: positions (m, dim) [m], by default those in the dataset's attributes.
    mean, rms, maximum: of each cell over time [ppm], axes (x, y[, z]), NaN in obstacles. level: z index of the maps,
    where the mean is highest; None in 2-D. Raises RunFolderError.
    """

    def __init__(
        self,
        path: Path,
        data: "xarray.Dataset",
        gas: str | None = None,
        start: float | None = None,
        sources: np.ndarray | None = None,
    ):
        self.path, self.data, self._sources = path, data, sources
        names = [str(name) for name in data.data_vars]
        self.gases = [name.removesuffix("_ppm") for name in names if name.endswith("_ppm")]
        if not self.gases:
            raise RunFolderError(f"{path}: holds no gas; film it with `fields: {{rate: 10}}`")
        self.backgrounds = {name: float(data[name].attrs.get(BACKGROUND, 0.0)) for name in names}
        self.gas = chosen_gas(path, self.gases, gas)
        times = data["time"].values.astype(float)
        self.skipped = skipped_before(path, times, start, "frames")
        self.times = times[self.skipped :]
        self.axes = [axis for axis in AXES if axis in data[f"{self.gas}_ppm"].dims]
        self.dim = len(self.axes)
        self.coordinates = [data[axis].values for axis in self.axes]
        self.shape = tuple(map(len, self.coordinates))
        self.speeds = {f"wind_{a}": u for a, u in zip(AXES, "uvw", strict=True) if u in names}
        self.wind = list(self.speeds)
        known = self._values("air") > 0 if "air" in names else np.isfinite(self._values(f"{self.gas}_ppm", 0))
        self.air = None if known.all() else known
        self._scan()
        self.probes = self._lines()
        self._found: dict[str, np.ndarray] | None = None

    def _values(self, name: str, n: int | None = None) -> np.ndarray:
        """Return a variable, of frame n if it changes, with the axes (x, y[, z]). Raises RunFolderError if damaged."""
        from taichi_plume.files.zarr_groups import errors_as

        of = self.data[name] if n is None else self.data[name].isel(time=n)
        with errors_as(RunFolderError, f"{self.path}: {name}" + ("" if n is None else f", frame {n}")):
            return of.transpose(*self.axes).values

    def _frames(self, names: list[str]) -> Iterator[dict[str, np.ndarray]]:
        for n in range(self.skipped, self.skipped + len(self.times)):
            frame = {name: self._values(name, n) for name in names}
            for name, values in frame.items():
                if not np.isfinite(values if self.air is None else values[self.air]).all():
                    raise RunFolderError(
                        f"{self.path}: frame {n} of {name} is damaged: not all values are finite"
                    )
            yield frame

    def _scan(self) -> None:
        """Compute mean, rms and maximum over time of the concentration [ppm] in each cell."""
        share = weights(self.times)
        mean = np.zeros(self.shape)
        square = np.zeros(self.shape)
        self.maximum = np.zeros(self.shape)
        name = f"{self.gas}_ppm"
        for w, frame in zip(share, self._frames([name]), strict=True):
            c = frame[name].astype(float)
            mean += w * c
            square += w * c * c
            np.maximum(self.maximum, c, out=self.maximum)
        self.mean, self.rms = mean, np.sqrt(np.maximum(square - mean**2, 0.0))
        if self.air is not None:
            for cells in (self.mean, self.rms, self.maximum):
                cells[~self.air] = np.nan
        if not np.nanmax(self.mean) > 0.0:
            raise RunFolderError(f"{self.path}: the concentration of {self.gas} is 0 in these frames")
        self.strongest = np.unravel_index(int(np.nanargmax(self.mean)), self.mean.shape)
        self.level = int(self.strongest[2]) if self.dim == 3 else None

    def plane(self, cells: np.ndarray) -> np.ndarray:
        """Return the horizontal plane (x, y) with the highest mean from values in all cells; 2-D values as is."""
        return cells if self.level is None else cells[:, :, self.level]

    @property
    def sources(self) -> np.ndarray | None:
        """Positions of the gas sources, (m, dim) [m]; None if they are not known."""
        if self._sources is not None:
            return self._sources[:, : self.dim]
        try:
            sources = json.loads(self.data.attrs["gases"])[f"gas_{self.gas}"]["sources"]
            found = np.array([source["position"] for source in sources], float)
        except (LookupError, TypeError, ValueError, RecursionError):
            return None
        return found if found.ndim == 2 and found.shape[1] == self.dim and np.isfinite(found).all() else None

    @property
    def along(self) -> int:
        """Horizontal axis (0 for x, 1 for y) along which the mean plume extends farther."""
        mean = np.nan_to_num(self.plane(self.mean))
        spread = []
        for axis in (0, 1):
            share, x = mean.sum(axis=1 - axis), self.coordinates[axis]
            centre = (share * x).sum() / share.sum()
            spread.append((share * (x - centre) ** 2).sum())
        return int(np.argmax(spread))

    def _lines(self) -> list[Probe]:
        """Return probes (lines of cells): one along the plume through the highest mean, others across the plume."""
        along, across = self.along, 1 - self.along
        self._cells: list[tuple[int, ...]] = []
        probes = [self._line(f"along {AXES[along]}", along, [int(index) for index in self.strongest])]
        mean = np.nan_to_num(self.plane(self.mean)).sum(axis=across)
        peak, n = int(self.strongest[along]), self.shape[along]
        forward = mean[peak + 1 :].sum() >= mean[:peak].sum()
        for share in STATIONS:
            at = round(peak + share * ((n - 1 if forward else 0) - peak))
            where = [int(index) for index in self.strongest]
            where[along] = at
            name = f"across at {AXES[along]} = {self.coordinates[along][at]:.3g} m"
            if name not in [probe.name for probe in probes]:
                probes.append(self._line(name, across, where))
        return [probe for probe in probes if len(probe.places) > 1]

    def _line(self, name: str, axis: int, where: list) -> Probe:
        """Return the longest obstacle-free part of the row of cells along an axis through cell `where`, as a probe."""
        first = len(self._cells)
        row = [(*map(int, where[:axis]), n, *map(int, where[axis + 1 :])) for n in range(self.shape[axis])]
        air = np.array([self.air is None or bool(self.air[cell]) for cell in row])
        cuts = stretches(air)
        free = max(range(len(cuts) - 1), key=lambda k: (cuts[k + 1] - cuts[k]) * air[cuts[k]])
        cells = row[cuts[free] : cuts[free + 1]]
        self._cells += cells
        spots = np.array([[self.coordinates[d][cell[d]] for d in range(self.dim)] for cell in cells])
        return Probe(name, spots.reshape(-1, self.dim), (len(cells),), first)

    def intermittency(self, threshold: float) -> np.ndarray:
        """Return the map (x, y) of the fraction of time above a threshold [ppm]; also read the lines' time series."""
        share = weights(self.times)
        gamma = np.zeros(self.plane(self.mean).shape)
        name = f"{self.gas}_ppm"
        names = {name: name, **self.speeds}
        at = tuple(np.array(self._cells).T)
        found = {key: np.empty((len(self.times), len(self._cells)), np.float32) for key in names}
        for n, (w, frame) in enumerate(zip(share, self._frames([*names.values()]), strict=True)):
            gamma += w * (self.plane(frame[name]) > threshold)
            for key, stored in names.items():
                found[key][n] = frame[stored][at]
        self._found = found
        gamma[np.isnan(self.plane(self.mean))] = np.nan
        return gamma

    def values(self, points: np.ndarray, quantity: str) -> np.ndarray:
        """Return a quantity's time series, (n, points) f32, at points of the lines. Call `intermittency` before."""
        assert self._found is not None, "call intermittency first"
        return self._found[quantity][:, points]
