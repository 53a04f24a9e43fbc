"""Compute plume statistics from the probes, the film or the pictures of a run, or from a film alone."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from taichi_plume.files import pictures_file
from taichi_plume.files.run_folder import RunFolderError, is_run
from taichi_plume.fluctuations import bouts, sensor_comparison, spectra
from taichi_plume.fluctuations.analysis import OfProbe, Settings, distances, of_probe
from taichi_plume.fluctuations.film_statistics import FilmRecord
from taichi_plume.fluctuations.records import Probe, ProbeRecord, chosen_gas
from taichi_plume.fluctuations.result import Statistics
from taichi_plume.guard.input_error import InputError
from taichi_plume.guard.safe_open import unopenable
from taichi_plume.results.pictures import gas_slices
from taichi_plume.results.run import Run, film_dataset
from taichi_plume.scenario.domain import Located
from taichi_plume.scenario.sensors import GasSensor, MoxSensor

SHARE = 0.1
"""Default threshold as a fraction of the highest mean of all points."""


class Options(NamedTuple):
    """Options of `statistics_of`: species, probe's name, threshold [ppm], earliest time [s], range of durations [s]."""

    gas: str | None
    probe: str | None
    threshold: float | None
    start: float | None
    bounds: tuple[float, float] | None


def statistics_of(
    path: Path,
    gas: str | None = None,
    probe: str | None = None,
    threshold: float | None = None,
    start: float | None = None,
    bounds: tuple[float, float] | None = None,
    sensors: Sequence[GasSensor] = (),
) -> Statistics:
    """Return the plume statistics of a run, given its folder, or of a film. Raises InputError.

    gas: species (default: the first); probe: name of a single probe to use; threshold: [ppm] (default: a tenth of the
    largest mean); start: earliest time [s]; bounds: range of durations for exponents [s]; sensors: further sensor
    models to compare.
    """
    options = Options(gas, probe, threshold, start, bounds)
    fault = unopenable(path, folder=True)
    if fault:
        raise RunFolderError(f"{path}: {fault}; give the folder of a run, or a film")
    if not is_run(path):
        if (path / "zarr.json").exists():
            return _of_film(FilmRecord(path, film_dataset(path), gas, start), path.stem, options)
        raise RunFolderError(f"{path}: is neither the folder of a run nor a film")
    run = Run(path)
    status = str(run.result.get("status", "unknown"))
    repair = f"`python -m taichi_plume repair {path}`"
    if status == "running":
        raise RunFolderError(f"{path}: is still running, or was killed; wait, or {repair}")
    table, film = path / "probes.parquet", path / "fields.zarr"
    if (path / "probes.arrows").exists():
        raise RunFolderError(f"{path}: was killed; {repair} completes its files")
    every = [source for _, part in run.scenario.gases for source in part.sources]
    positions = [
        source.position for source in every if isinstance(source, Located) and not vars(source).get("motion")
    ]
    sources = np.array(positions, float) if positions else None
    if table.exists():
        found = _of_probes(table, run.scenario.name, options, sources, sensors)
        found.source = path
        if film.is_dir():
            try:
                found.film = FilmRecord(film, film_dataset(film), found.gas, start)
                found.gamma = found.film.intermittency(found.threshold)
            except InputError as error:
                found.notes.append(f"No maps: {error}.")
    elif film.is_dir():
        found = _of_film(FilmRecord(film, film_dataset(film), gas, start), run.scenario.name, options)
    elif run.has(pictures_file.NAME):
        found = _of_pictures(run, options, sources)
    else:
        raise RunFolderError(
            f"{path}: has neither probes.parquet nor fields.zarr nor {pictures_file.NAME}; run with "
            "`probes: {every: step, points: [{kind: point, name: a, at: [1, 2]}]}` or `fields: {rate: 10}`"
        )
    if status not in ("completed", "stopped"):
        found.notes.append(f"The run ended as '{status}': its files hold the results up to then.")
    return found


def _of_probes(
    table: Path, name: str, options: Options, sources: np.ndarray | None, sensors: Sequence[GasSensor]
) -> Statistics:
    record = ProbeRecord(table, options.start)
    gas = chosen_gas(table, record.gases, options.gas)
    mean, largest = record.sums(f"{gas}_ppm")
    chosen = _chosen(table, record.probes, options.probe)
    inside = np.concatenate([probe.first + np.arange(len(probe.places)) for probe in chosen])
    if not largest[inside].max() > 0.0:
        raise RunFolderError(f"{table}: the concentration of {gas} is 0 at all points in this time")
    level, why = _threshold(float(mean[inside].max()), options.threshold)
    settings = Settings(gas, level, record.wind, sources, options.bounds)
    probes = [of_probe(record, probe, settings) for probe in chosen]
    found = _statistics(table, name, "probes", record, settings, why, probes)
    found.comparison, found.bouts = _compared_sensors(record, settings, probes, sensors, found.notes)
    return found


def _of_pictures(run: Run, options: Options, sources: np.ndarray | None) -> Statistics:
    """Return the statistics of the gas in the first horizontal plane of a run's pictures, without the warm-up."""
    data, path = gas_slices(run, options.gas), run.folder / pictures_file.NAME
    record = FilmRecord(path, data, options.gas, 0.0 if options.start is None else options.start, sources)
    found = _of_film(record, run.scenario.name, options, "pictures")
    about = data[f"{found.gas}_ppm"].attrs
    where = f" {about['plane']}" if about["plane"] else ""
    pixels = "; a pixel is the largest value of several cells" if "cell_methods" in about else ""
    found.notes.append(
        f"Statistics are those of pictures{where}, precise to {100 * about['relative_precision']:.2g} percent and "
        f"{about['absolute_precision']:.2g} ppm, at most {about['largest_value']:.3g} ppm{pixels}."
    )
    return found


def _of_film(film: FilmRecord, name: str, options: Options, kind: str = "film") -> Statistics:
    path = film.path
    level, why = _threshold(float(np.nanmax(film.mean)), options.threshold)
    gamma = film.intermittency(level)
    settings = Settings(film.gas, level, film.wind, film.sources, options.bounds)
    probes = [of_probe(film, probe, settings) for probe in _chosen(path, film.probes, options.probe)]
    found = _statistics(path, name, kind, film, settings, why, probes)
    found.film, found.gamma = film, gamma
    found.notes.append(
        f"There are no data between the frames, {np.median(np.diff(film.times)):.3g} s apart: shorter whiffs are "
        "missed or joined. Use probes to resolve them."
    )
    return found


def _statistics(
    path: Path, name: str, kind: str, record: ProbeRecord | FilmRecord, settings: Settings, why: str,
    probes: list[OfProbe],
) -> Statistics:  # fmt: skip
    steps = np.diff(record.times)
    found = Statistics(
        path, name, kind, settings.gas, settings.threshold, why, float(record.times[0]), float(record.times[-1]),
        len(record.times), (float(steps.min()), float(steps.max())), probes,
    )  # fmt: skip
    if not spectra.is_even(record.times):
        found.notes.append(
            f"Samples are {found.steps[0]:.3g} to {found.steps[1]:.3g} s apart. Means weight samples by duration; "
            f"spectra, integral scales, correlations and sensors use values interpolated every {steps.mean():.3g} s."
        )
    others = [gas for gas in record.gases if gas != settings.gas]
    if others:
        found.notes.append(f"Other gases: {', '.join(others)}; --gas NAME chooses one.")
    return found


def _chosen(path: Path, probes: Sequence[Probe], name: str | None) -> list[Probe]:
    chosen = [probe for probe in probes if name in (None, probe.name)]
    if not chosen:
        raise RunFolderError(f"{path}: has no probe {name}, only {', '.join(probe.name for probe in probes)}")
    return chosen


def _threshold(largest: float, given: float | None) -> tuple[float, str]:
    if given is not None:
        return given, "as given"
    return SHARE * largest, f"a tenth of the mean at the point with the most gas, {largest:.3g} ppm"


def _compared_sensors(
    record: ProbeRecord,
    settings: Settings,
    probes: list[OfProbe],
    sensors: Sequence[GasSensor],
    notes: list[str],
) -> tuple[sensor_comparison.SensorComparison | None, bouts.BoutTable | None]:
    """Compare gas sensors by the whiffs that they detect, at the points with whiffs, most first; None without any.

    The bouts of a metal oxide are counted at these points and at others, up to MOST_POINTS in all; None if samples are
    too far apart.
    """
    several = sensor_comparison.compared_sensors(sensors)
    lively = [(int(n), p.probe.first + k) for p in probes for k, n in enumerate(p.points["whiffs"]) if n]
    if not lively:
        notes.append("The record has no complete whiff, so sensors are not compared.")
        return None, None
    ticks = min(len(record.times), sensor_comparison.MOST_TICKS)
    most = max(
        1, min(sensor_comparison.MOST_POINTS, int(sensor_comparison.MOST_NUMBERS / len(several) / ticks))
    )
    points = whiffs = np.array([point for _, point in sorted(lively, key=lambda pair: (-pair[0], pair[1]))])
    if len(points) > most:
        notes.append(f"Sensors are compared at {most} of the {len(points):,} points that have whiffs.")
        points = _evenly(points, most)
    every = np.concatenate([p.probe.first + np.arange(len(p.probe.places)) for p in probes])
    points = np.concatenate([points, _evenly(np.setdiff1d(every, whiffs), most - len(points))])
    order = np.argsort(points)
    ppm = record.values(points[order], f"{settings.gas}_ppm")[:, np.argsort(order)]
    step, even = spectra.evenly(record.times, ppm)
    if len(even) > sensor_comparison.MOST_TICKS:
        even = even[: sensor_comparison.MOST_TICKS]
        notes.append(f"Sensors are compared over the first {step * len(even):.4g} s.")
    if step > sensor_comparison.FAST / 2:
        notes.append(
            f"Samples every {step:.3g} s are too far apart for sensors of {sensor_comparison.FAST * 1e3:g} ms; use "
            "`every: step` and a shorter `tick`."
        )
    mox = sensor_comparison.default_mox(several)
    found = sensor_comparison.compare_sensors(
        several,
        settings.gas,
        step,
        even,
        settings.threshold,
        store=mox,
        background=record.backgrounds[f"{settings.gas}_ppm"],
    )
    if step > bouts.LONGEST_STEP:
        notes.append(
            f"Samples every {step:.3g} s are too far apart to count bouts; {bouts.LONGEST_STEP:g} s at most."
        )
        return found, None
    assert found.stored is not None
    return found, _bouts(several[mox], step, found.stored, points, probes, settings.sources)


def _evenly(points: np.ndarray, most: int) -> np.ndarray:
    """Return at most `most` of the points, evenly spaced."""
    return points[np.linspace(0, len(points) - 1, min(most, len(points))).round().astype(int)]


def _bouts(
    sensor: sensor_comparison.NamedSensor,
    step: float,
    ppm: np.ndarray,
    points: np.ndarray,
    probes: list[OfProbe],
    sources: np.ndarray | None,
) -> bouts.BoutTable:
    """Count the bouts of a metal oxide from its readings at points, (n, points) [ppm], and add them to the probes.

    points: index of each point in the record. Points of probes without readings get NaN.
    """
    assert isinstance(sensor.model, MoxSensor)
    counted, threshold = bouts.bouts_of_sensor(sensor.model, step, ppm)
    columns = {
        "bouts_per_min": counted.per_min, "bout_amplitude": counted.amplitude, "mox_std": counted.deviation
    }  # fmt: skip
    away, probe = np.full(len(points), np.nan), np.zeros(len(points), int)
    for n, stats in enumerate(probes):
        size = len(stats.probe.places)
        local = points - stats.probe.first
        here = (local >= 0) & (local < size)
        for name, values in columns.items():
            stats.points[name] = np.full(size, np.nan)
            stats.points[name][local[here]] = values[here]
        away[here] = distances(stats.probe.places, sources)[local[here]]
        probe[here] = n
    return bouts.BoutTable(sensor.name, threshold, probe, away, counted.per_min, counted.deviation)
