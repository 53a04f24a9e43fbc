"""Statistics of a probe: moments of each point, whiffs and blanks, spectrum, profiles, two-point correlation."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from taichi_plume.fluctuations import durations, space, spectra
from taichi_plume.fluctuations.durations import Exponent, Spells
from taichi_plume.fluctuations.fits import MOST, Fit, fits
from taichi_plume.fluctuations.moments import moments, wind
from taichi_plume.fluctuations.records import AXES, Probe, Record

MOST_VALUES = 10_000_000  # of a quantity in memory
STILL = 1e-3  # m/s; slower air counts as at rest


class Settings(NamedTuple):
    """Settings of statistics.

    gas: name of the species; threshold: of gas [ppm]; wind: names of the record's wind; sources: (m, dim) [m], if
    known; bounds: of the durations for exponents [s], None to choose them from the data.
    """

    gas: str
    threshold: float
    wind: Sequence[str] = ()
    sources: np.ndarray | None = None
    bounds: tuple[float, float] | None = None


class Kind(NamedTuple):
    """Whiffs or blanks of a probe, for each point, and the power law of their durations at all points."""

    name: str
    of_points: list[Spells]
    law: Exponent | None

    @property
    def all(self) -> Spells:
        """Whiffs or blanks of all points of a probe in one list."""
        return durations.pooled(self.of_points)


class Correlation(NamedTuple):
    """Two-point correlation: separation [m], values; length: integral length [m]; whole: whether it reaches zero."""

    along: str
    separation: np.ndarray
    values: np.ndarray
    length: float
    whole: bool


class Profile(NamedTuple):
    """Mean and rms [ppm] along a line [m], and the Gaussian of the mean. at: position of the line, in words."""

    along: str
    at: str
    place: np.ndarray
    mean: np.ndarray
    rms: np.ndarray
    gaussian: space.Gaussian | None
    station: float = float("nan")


class OfProbe(NamedTuple):
    """Statistics of a probe.

    points: a number per point, by name; kinds: whiffs and blanks; within: concentrations in whiffs over their mean at
    each point, to which `fits` are fitted; frequency [Hz], density [ppm²/Hz]: spectrum, mean over points.
    """

    probe: Probe
    points: dict[str, np.ndarray]
    kinds: tuple[Kind, Kind]
    within: np.ndarray
    fits: list[Fit]
    frequency: np.ndarray
    density: np.ndarray
    profiles: list[Profile]
    correlations: list[Correlation]


def of_probe(record: Record, probe: Probe, settings: Settings) -> OfProbe:
    """Compute all statistics of a probe (a set of points) from a record of gas and wind, in blocks of points."""
    block = max(1, MOST_VALUES // len(record.times))
    whole = probe.first + np.arange(len(probe.places))
    tables, spells, within, densities = [], [], [], []
    frequency = np.empty(0)
    for begin in range(0, len(whole), block):
        points = whole[begin : begin + block]
        ppm = record.values(points, f"{settings.gas}_ppm")
        step, even = spectra.evenly(record.times, ppm)
        table = moments(record.times, ppm, settings.threshold)
        table["integral_time"] = np.array([spectra.integral_time(step, series) for series in even.T])
        table["mean_error"] = table["rms"] * np.sqrt(
            np.minimum(1.0, 2.0 * table["integral_time"] / np.ptp(record.times))
        )
        if settings.wind:
            velocity = np.stack([record.values(points, name) for name in settings.wind], axis=-1)
            table |= wind(record.times, velocity)
        tables.append(table)
        spells += [durations.spells(record.times, series > settings.threshold) for series in ppm.T]
        within += _within(ppm, table["conditional_mean"], settings.threshold, len(whole))
        frequency, density = spectra.spectrum(step, even)
        densities.append(density.mean(axis=1) * len(points))
    numbers = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    for n, name in enumerate(("whiffs", "blanks")):
        lasted = [pair[n].lasted for pair in spells]
        numbers[name] = np.array(list(map(len, lasted)))
        numbers[f"mean_{name[:-1]}"] = np.array([t.mean() if len(t) else np.nan for t in lasted])
    reach = _half_travel(probe, numbers, settings)
    step = float(np.median(np.diff(record.times)))
    kinds = []
    for n, name in enumerate(("whiffs", "blanks")):
        of_points = [pair[n] for pair in spells]
        every = durations.pooled(of_points)
        bounds = settings.bounds or durations.range_of(every, step, reach)
        kinds.append(Kind(name, of_points, durations.exponent(every, *bounds) if bounds else None))
    together = np.concatenate(within) if within else np.empty(0)
    return OfProbe(
        probe, numbers, (kinds[0], kinds[1]), together, fits(together), frequency,
        np.sum(densities, axis=0) / len(whole), profiles_of(probe, numbers), correlations_of(record, probe, settings),
    )  # fmt: skip


def _within(ppm: np.ndarray, mean: np.ndarray, threshold: float, points: int) -> list[np.ndarray]:
    """Concentrations above the threshold divided by their mean, for each point, thinned for the fits."""
    found = []
    for c, m in zip(ppm.T, mean, strict=True):
        inside = c[c > threshold]
        if len(inside):
            found.append(inside[:: max(1, len(inside) * points // (4 * MOST))] / m)
    return found


def distances(places: np.ndarray, sources: np.ndarray | None) -> np.ndarray:
    """Return the distance [m] of each position (n, dim) from the nearest source (m, dim); NaN without a source."""
    if sources is None or not len(sources):
        return np.full(len(places), np.nan)
    return np.linalg.norm(places[:, None] - sources[None], axis=-1).min(axis=1)


def _half_travel(probe: Probe, numbers: dict[str, np.ndarray], settings: Settings) -> float | None:
    """Half of the advection time [s] from the nearest source to the points with the mean wind; None if unknown."""
    if settings.sources is None or not len(settings.sources) or "speed" not in numbers:
        return None
    away = distances(probe.places, settings.sources)
    moving = (numbers["speed"] > STILL) & (numbers["whiffs"] > 0)
    return float(np.median(0.5 * away[moving] / numbers["speed"][moving])) if moving.any() else None


def profiles_of(probe: Probe, numbers: dict[str, np.ndarray]) -> list[Profile]:
    """Return the profile along a line, or the profiles of a grid across the mean wind, else along the last axis."""
    mean, rms = numbers["mean"], numbers["rms"]
    if probe.kind == "point":
        return []
    if probe.kind == "line":
        place, along = distance_along(probe.places)
        return [Profile(along, "", place, mean, rms, space.gaussian_fit(place, mean))]
    speeds = [float(np.mean(numbers[f"mean_{u}"])) for u in "uvw" if f"mean_{u}" in numbers]
    return rows_of(probe, mean, rms, speeds)


def rows_of(probe: Probe, mean: np.ndarray, rms: np.ndarray, speeds: Sequence[float] = ()) -> list[Profile]:
    """Return the profiles of a grid's rows across the mean wind `speeds`, in the plane of the highest mean."""
    axes = [d for d, n in enumerate(probe.counts) if n > 1]
    flat = [d for d in axes if d < 2] if len(axes) > 2 else axes
    along = max(flat, key=lambda d: abs(speeds[d])) if any(speeds) else flat[0]
    across = next(d for d in flat if d != along)
    mean, rms = mean.reshape(probe.counts), rms.reshape(probe.counts)
    strongest = np.unravel_index(int(np.nanargmax(mean)), mean.shape)
    lattice = probe.places.reshape(*probe.counts, -1)
    found = []
    for n in range(probe.counts[along]):
        cut = tuple(
            slice(None) if d == across else n if d == along else int(strongest[d])
            for d in range(len(probe.counts))
        )
        place, station = lattice[cut][:, across], float(lattice[cut][0, along])
        some = np.isfinite(mean[cut])
        fit = space.gaussian_fit(place[some], mean[cut][some])
        at = f"{AXES[along]} = {station:.3g} m"
        found.append(Profile(AXES[across], at, place[some], mean[cut][some], rms[cut][some], fit, station))
    return found


def distance_along(places: np.ndarray) -> tuple[np.ndarray, str]:
    """Positions along a line [m] and their name: the only coordinate that changes, or the distance from the start."""
    change = np.flatnonzero(np.ptp(places, axis=0) > 0.0)
    if len(change) == 1:
        return places[:, change[0]], AXES[change[0]]
    return np.linalg.norm(places - places[0], axis=1), "distance along the line"


def correlations_of(record: Record, probe: Probe, settings: Settings) -> list[Correlation]:
    """Two-point correlation along a line, or along each axis of a grid, from as many times as fit into memory."""
    if probe.kind == "point":
        return []
    block = max(1, MOST_VALUES // len(record.times))
    stride = -(-len(probe.places) // block)
    parts = []
    for begin in range(0, len(probe.places), block):
        points = probe.first + np.arange(begin, min(begin + block, len(probe.places)))
        ppm = record.values(points, f"{settings.gas}_ppm")
        parts.append(spectra.evenly(record.times, ppm)[1][::stride])
    values = np.concatenate(parts, axis=1)
    values = (values - values.mean(axis=0)).reshape(len(values), *probe.counts)
    lattice = probe.places.reshape(*probe.counts, -1)
    found = []
    for axis, n in enumerate(probe.counts):
        if n < 2:
            continue
        ends = [np.moveaxis(lattice, axis, 0)[k].reshape(-1, lattice.shape[-1])[0] for k in (0, -1)]
        spacing = float(np.linalg.norm(ends[1] - ends[0])) / (n - 1)
        rows = np.moveaxis(values, axis + 1, -1).reshape(-1, n)
        r = space.correlation(rows)
        length, whole = spectra.to_first_zero(spacing, r) if len(r) > 1 else (float("nan"), False)
        along = AXES[axis] if probe.kind == "grid" else distance_along(probe.places)[1]
        found.append(Correlation(along, spacing * np.arange(len(r)), r, length, whole))
    return found
