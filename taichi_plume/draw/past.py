"""Moments of a run from the files in its folder, in the form in which `latest_instant` has the last one.

Gas maps are in the folder as they were at the end of the run alone, and are shown at all times with that time.
"""

import json
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.execution.latest_instant import Instant, Picture
from taichi_plume.execution.summary import map_names
from taichi_plume.guard.input_error import InputError
from taichi_plume.observed.planes import planes
from taichi_plume.observed.scales import Scale
from taichi_plume.results import pictures
from taichi_plume.results.run import Run
from taichi_plume.results.tracks import Track, tracks

if TYPE_CHECKING:
    from collections.abc import Sequence

    import xarray


class Past:
    """Recorded moments of a run. times: of the pictures [s]; they end with the data on the disk. Raises InputError."""

    def __init__(self, folder: Path):
        try:
            self.run = Run(folder, lenient=True)
            scenario = self.run.scenario
            seen = [each for each in planes(scenario, scenario.domain.extent) if each.letters == "xy"]
            ends = tuple(f"_{plane.name}" for plane in seen)
            self._names = [name for name in pictures.picture_names(self.run) if name.endswith(ends)]
            self._slices = [plane.name for plane in seen if not plane.over_height]
            stored = self.run.has("pictures.zarr")
            self.times = np.asarray((self.run.pictures if stored else self.run.fields).time.values)
            self._blown = np.asarray((self.run.winds if stored else self.run.fields).time.values)
            self.tracks = tracks(folder / "robots.parquet", scenario.robots)
        except (InputError, OSError) as error:
            raise InputError(f"{folder.name}: shows no moments: {error}") from None
        self.at = lru_cache(maxsize=4)(self._at)
        """Return the moment at a time [s]: of each quantity the last that was recorded until then."""

    def _at(self, t: float) -> Instant:
        end = self.run.scenario.duration
        return Instant(
            t, end, min(1.0, max(0.0, t / end)), 0.0, "warm-up" if t < 0 else "running", self._winds(t),
            self._robots(t), self.readings, self._pictures(t) | self.maps, [_way(each, t) for each in self.tracks],
        )  # fmt: skip

    def _pictures(self, t: float) -> dict[str, Picture]:
        seen = pictures.pictures(self.run, self._names, _last(self.times, t))
        return {
            str(name): Picture.of(of.attrs, of.values[-1].astype(np.float32))
            for name, of in seen.data_vars.items()
        }

    @cached_property
    def maps(self) -> dict[str, Picture]:
        """Gas maps of the first trial at the end: the estimate and, if the method has one, its standard deviation.

        Both in ppm, in the colours of the gas; without maps, or if they cannot be read, there are none.
        """
        try:
            return self._maps(self.run.maps) if self.run.has("maps.zarr") else {}
        except (InputError, KeyError, IndexError, TypeError, ValueError):  # of a folder of another program
            return {}

    def _maps(self, stored: "Sequence[xarray.Dataset]") -> dict[str, Picture]:
        scale, found = Scale(*self.run.scenario.recording.range_ppm, "log"), {}
        for n, (name, of) in enumerate(zip(map_names([each.attrs for each in stored]), stored, strict=True)):
            if "component" in of:
                continue  # a map of the wind
            groups = json.loads(of.attrs["groups"])
            for k, group in enumerate(groups):
                whose = f"{name}, {', '.join(group['names'])}" if len(groups) > 1 else name
                at, cell = f"at the end, {of.attrs['t_s']:g} s", float(of.x.values[0]) * 2
                estimate = of.estimate.values[group["first_trial"]]
                found[f"map_{n}_{k}"] = Picture(f"{whose} {at}", "ppm", scale, cell, estimate)
                if "variance" in of:
                    deviation = np.sqrt(of.variance.values[group["first_trial"]])
                    quantity = f"standard deviation of {whose} {at}"
                    found[f"deviation_{n}_{k}"] = Picture(quantity, "ppm", scale, cell, deviation)
        return found

    def _winds(self, t: float) -> dict[str, np.ndarray]:
        """Return the arrows (4, n) on each slice of which the run has the wind."""
        found = {}
        for plane in self._slices:
            air = pictures.wind(self.run, plane, _last(self._blown, t))
            if air is not None and air.time.size:
                u, v = (air[f"{letter}_{plane}"].isel(time=-1) for letter in "uv")
                y, x = np.meshgrid(*(u[dim].values for dim in u.dims), indexing="ij")
                found[plane] = np.stack([each.ravel() for each in (x, y, u.values, v.values)])
        return found

    def _robots(self, t: float) -> np.ndarray:
        now = [(each, max(0, each.at(t))) for each in self.tracks]
        rows = [[each.values[key][n] for key in ("x", "y", "heading")] for each, n in now]
        return np.array(rows, float).reshape(-1, 3).T

    @cached_property
    def readings(self) -> np.ndarray:
        """Time [s] and readings [ppm] of the robots in the whole run, (samples, 1 + robots)."""
        longest = max(self.tracks, key=lambda each: len(each.t), default=None)
        if longest is None:
            return np.empty((0, 1))
        found = np.full((len(longest.t), 1 + len(self.tracks)), np.nan)
        found[:, 0] = longest.t
        for n, each in enumerate(self.tracks, 1):
            found[: len(each.t), n] = each.values["reading_ppm"]
        return found


def _last(times: np.ndarray, t: float) -> tuple[float, float]:
    """Return the last of the times that is not later than t, else the first, as a span; empty without times."""
    n = max(0, int(np.searchsorted(times, t + 1e-6, side="right")) - 1)
    return (float(times[n]), float(times[n])) if len(times) else (t, t)


def _way(track: Track, t: float) -> np.ndarray:
    """Return the positions of a robot up to a time, (2, n) [m]."""
    n = track.at(t) + 1
    return np.stack([track.values["x"][:n], track.values["y"][:n]])
