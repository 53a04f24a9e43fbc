"""Statistics of a run or a film as tables, and the files that hold them."""

import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from taichi_plume.files import disk, own_folder
from taichi_plume.files.json_values import json_value
from taichi_plume.files.run_folder import RunFolderError
from taichi_plume.fluctuations import sensor_comparison
from taichi_plume.fluctuations.analysis import OfProbe
from taichi_plume.fluctuations.bouts import BoutTable
from taichi_plume.fluctuations.film_statistics import FilmRecord
from taichi_plume.fluctuations.records import AXES
from taichi_plume.guard.terminal import visible
from taichi_plume.version import __version__

if TYPE_CHECKING:
    import pandas
    import xarray

KIND = "statistics"  # statistics.json marks a folder of statistics
PAGE = "statistics.html"
TABLES = ("statistics", "durations", "spectra")
UNITS = {
    **dict.fromkeys(
        ("mean", "rms", "mean_error", "conditional_mean", "p50", "p99", "p99.9", "maximum"), "ppm"
    ),
    **dict.fromkeys(("mean_whiff", "mean_blank", "integral_time"), "s"),
    **dict.fromkeys(("x", "y", "z"), "m"),
    "bouts_per_min": "1/min",
    "bout_amplitude": "1/s",
    **dict.fromkeys([f"{what}_{u}" for what in ("mean", "rms") for u in "uvw"] + ["speed"], "m/s"),
}
"""Units of the numbers of a point; 1 for all others."""


@dataclass(repr=False)
class Statistics:
    """Plume statistics of a run or a film; a notebook shows them.

    source: the run's folder or the film; of: "probes", "film" or "pictures"; gas: species. threshold: of whiffs [ppm];
    why: reason for the threshold. begin, end: first and last time [s]; steps: shortest and longest time between
    samples [s].
    comparison: whiffs that sensors detect; bouts: of a metal oxide at points; gamma: intermittency map of the film.
    """

    source: Path
    name: str
    of: str
    gas: str
    threshold: float
    why: str
    begin: float
    end: float
    samples: int
    steps: tuple[float, float]
    probes: list[OfProbe]
    comparison: sensor_comparison.SensorComparison | None = None
    bouts: BoutTable | None = None
    film: FilmRecord | None = None
    gamma: np.ndarray | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def points(self) -> "pandas.DataFrame":
        """Table with a row per measuring point: probe, point, position, statistics; units in `attrs["units"]`."""
        import pandas

        parts = []
        for stats in self.probes:
            where = dict(zip(AXES, stats.probe.places.T, strict=False))
            who = {"probe": stats.probe.name, "point": np.arange(len(stats.probe.places))}
            parts.append(pandas.DataFrame({**who, **where, **stats.points}))
        frame = pandas.concat(parts, ignore_index=True)
        frame.attrs["units"] = {str(name): UNITS.get(str(name), "1") for name in frame.columns}
        return frame

    @property
    def durations(self) -> "pandas.DataFrame":
        """Table with a row per complete whiff or blank: probe, point, kind, begin [s], duration [s]."""
        import pandas

        parts = [
            {"probe": p.probe.name, "point": n, "kind": kind.name, "begin": s.begin, "duration": s.lasted}
            for p in self.probes
            for kind in p.kinds
            for n, s in enumerate(kind.of_points)
            if len(s.lasted)
        ]
        units = {"probe": "1", "point": "1", "kind": "1", "begin": "s", "duration": "s"}
        frames = list(map(pandas.DataFrame, parts))
        frame = pandas.concat(frames, ignore_index=True) if frames else pandas.DataFrame(columns=list(units))
        frame.attrs["units"] = units
        return frame

    @property
    def maps(self) -> "xarray.Dataset | None":
        """Maps (x, y) of mean, rms, maximum [ppm], intensity and intermittency of a film; None without a film."""
        import xarray

        film = self.film
        if film is None or self.gamma is None:
            return None
        mean, rms = film.plane(film.mean), film.plane(film.rms)
        with np.errstate(divide="ignore", invalid="ignore"):
            intensity = np.where(mean > 0.0, rms / mean, np.nan)
        values = {
            "mean": (mean, "ppm"), "rms": (rms, "ppm"), "maximum": (film.plane(film.maximum), "ppm"),
            "intensity": (intensity, "1"), "intermittency": (self.gamma, "1"),
        }  # fmt: skip
        data = xarray.Dataset(
            {name: (("x", "y"), cells, {"units": unit}) for name, (cells, unit) in values.items()},
            {a: (a, film.coordinates[d], {"units": "m"}) for d, a in enumerate("xy")},
        )
        if film.level is not None:
            data.attrs["height_m"] = float(film.coordinates[2][film.level])
        data.attrs |= {"gas": self.gas, "threshold_ppm": self.threshold}
        return data

    @property
    def spectra(self) -> "pandas.DataFrame":
        """Table of the mean power spectrum of each probe: probe, frequency [Hz], density [ppm²/Hz]."""
        import pandas

        frames = [
            pandas.DataFrame({"probe": p.probe.name, "frequency": p.frequency, "density": p.density})
            for p in self.probes
        ]
        return pandas.concat(frames, ignore_index=True)

    @property
    def summary(self) -> dict[str, object]:
        """Settings, and the power laws, fits, profiles and lengths of each probe: the content of statistics.json."""
        sensors = [
            {"sensor": k.sensor.name, "whiffs": k.whiffs, "kept": k.seen, "share": k.share, "rises": k.rises,
             "threshold_ppm": k.threshold}
            for k in (self.comparison.sensors if self.comparison else [])
        ]  # fmt: skip
        return {
            "format": own_folder.format_of(KIND), "taichi_plume": __version__,
            "source": str(self.source), "of": self.of, "gas": self.gas,
            "threshold_ppm": self.threshold, "threshold_is": self.why, "begin_s": self.begin, "end_s": self.end,
            "samples": self.samples, "shortest_step_s": self.steps[0], "longest_step_s": self.steps[1],
            "probes": list(map(_of_probe, self.probes)), "sensors": sensors,
            "bouts": self.bouts and _of_bouts(self.bouts), "notes": self.notes,
        }  # fmt: skip

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Main results in words, each with its subject: samples and threshold, power laws, sensors, notes."""
        points = sum(len(part.probe.places) for part in self.probes)
        words = (
            f"{points:,} point{'s' * (points != 1)}, {self.samples:,} samples from {self.begin:.4g} to {self.end:.4g} "
            f"s; threshold {self.threshold:.3g} ppm ({self.why})"
        )
        rows = [(self.gas, words)]
        for part in self.probes:
            for kind in part.kinds:
                if law := kind.law:
                    words = (
                        f"{len(kind.all.lasted):,} {kind.name}, p(T) ~ T^-a with a = {law.value:.2f} (95 %: "
                        f"{law.low:.2f} to {law.high:.2f}) from {law.first:.3g} to {law.last:.3g} s; turbulence: 1.5"
                    )
                    rows.append((part.probe.name, words))
        if self.comparison:
            rows.append(("sensors", self.comparison.in_words()))
        if self.bouts:
            rows.append(("bouts", self.bouts.in_words()))
        return [*rows, *(("note", note) for note in self.notes)]

    def __repr__(self) -> str:
        return "\n".join(visible(f"{subject}: {words}") for subject, words in self.rows)

    def _repr_html_(self) -> str:
        from taichi_plume.fluctuations.page import of_notebook

        return of_notebook(self)

    def write(self, folder: str | Path, page: bool = True) -> list[Path]:
        """Write statistics.json, Parquet tables (points, durations, spectra) and maps.nc of a film; return the paths.

        page: write statistics.html as well. Earlier statistics are replaced. Raises RunFolderError if the folder holds
        other files of these names, and OSError.
        """
        folder, maps = Path(folder), self.maps
        folder.mkdir(parents=True, exist_ok=True)
        names = [
            "statistics.json",
            *(f"{name}.parquet" for name in TABLES),
            *["maps.nc"] * (maps is not None),
        ]
        other = next((name for name in (*names, PAGE) if os.path.lexists(folder / name)), None)
        if other is not None and not own_folder.is_marked(folder, KIND):
            raise RunFolderError(f"{folder / other}: was not written by this command; choose another --out")
        text = json.dumps(json_value(self.summary), indent=1, ensure_ascii=False, allow_nan=False)
        with disk.written_whole(folder / "statistics.json") as fresh:
            fresh.write_text(text, encoding="utf-8", errors="backslashreplace")
        for name, frame in zip(TABLES, (self.points, self.durations, self.spectra), strict=True):
            with disk.written_whole(folder / f"{name}.parquet") as fresh:
                frame.to_parquet(fresh, index=False)
        if maps is not None:
            with disk.written_whole(folder / "maps.nc") as fresh:
                maps.to_netcdf(fresh, engine="h5netcdf")
        paths = [folder / name for name in names]
        if page:
            from taichi_plume.fluctuations.page import write

            paths.append(write(self, folder))
        return paths


def _of_bouts(table: BoutTable) -> dict[str, object]:
    """Return the bouts of a metal oxide as data for JSON: settings, points, rank correlations with the distance."""
    return {
        "sensor": table.sensor, "threshold_per_s": table.threshold, "points": len(table.per_min),
        "most_per_min": float(table.per_min.max()), "mean_per_min": float(table.per_min.mean()),
        "rank_correlation_with_distance": table.correlation(table.per_min),
        "rank_correlation_of_std": table.correlation(table.deviation),
    }  # fmt: skip


def _of_probe(stats: OfProbe) -> dict[str, object]:
    """Return a probe's power laws of durations, fits, correlation lengths and profiles as data for JSON."""
    kinds = {
        kind.name: {
            "count": len(kind.all.lasted),
            "cut": kind.all.cut,
            "law": kind.law and kind.law._asdict(),
        }
        for kind in stats.kinds
    }
    return {
        "name": stats.probe.name, "kind": stats.probe.kind, "points": len(stats.probe.places), **kinds,
        "fits": [fit._asdict() for fit in stats.fits],
        "lengths": [{"along": c.along, "length_m": c.length, "whole": c.whole} for c in stats.correlations],
        "profiles": [
            {"along": p.along, "at": p.at, "gaussian": p.gaussian and p.gaussian._asdict()} for p in stats.profiles
        ],
    }  # fmt: skip
