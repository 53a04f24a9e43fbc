"""Report page of plume statistics (`statistics.html`): sentences, tables and figures on one self-contained page."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from taichi_plume.fluctuations import captions, plots
from taichi_plume.fluctuations.analysis import Kind, OfProbe, Profile
from taichi_plume.fluctuations.durations import CELANI, DECADE, FEWEST
from taichi_plume.fluctuations.records import AXES
from taichi_plume.fluctuations.result import PAGE, Statistics
from taichi_plume.report import html
from taichi_plume.report.html import Section

MOST_PROBES = 6
MOST_ROWS = 20
HARDLY = 1e-3  # fraction of the highest mean below which a map of rms / mean is blank


def write(found: Statistics, folder: Path) -> Path:
    """Write the page of plume statistics into a folder; return the path. Raises OSError."""
    return html.write(
        folder / PAGE, _sections(found),
        name=found.name, what="statistics of a plume", status=found.gas, good=True,
        message=f"Statistics of a plume, from {'probes' if found.of == 'probes' else 'a film'}",
        about="Statistics by taichi_plume", began=[str(found.source)],
    )  # fmt: skip


def of_notebook(found: Statistics) -> str:
    """Return HTML of plume statistics for a notebook: the main results in words, and the first picture of the page."""
    first = found.probes[:1]
    images = (
        _maps(found).images or _spread(first).images or _whiffs(found, first).images or _time(first).images
    )
    return html.in_notebook(found.rows, picture=images[0].png if images else b"")


def _number(value: Any) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "-"


def _sections(found: Statistics) -> list[Section]:
    shown = found.probes[:MOST_PROBES]
    return [
        _words(found), _strength(found), _maps(found), _spread(shown), _whiffs(found, shown), _sensors(found),
        _bouts(found), _within(shown), _time(shown), _notes(found),
    ]  # fmt: skip


def _words(found: Statistics) -> Section:
    """Return sentences on the data and the main results."""
    probes = [stats.probe for stats in found.probes]
    points = sum(len(probe.places) for probe in probes)
    where = ", ".join(
        f"{p.name} ({f'{p.kind} of {len(p.places):,}' if len(p.places) > 1 else 'point'})"
        for p in probes[:MOST_PROBES]
    )
    more = len(probes) - MOST_PROBES
    where += f" and {more} more" if more > 0 else ""
    low, high = found.steps
    every = f"every {low:.3g} s" if high - low < 1e-3 * high else f"every {low:.3g} to {high:.3g} s"
    lines = [
        captions.MEASURED.format(
            gas=found.gas, points=f"{points:,} point{'s' * (points != 1)}", where=where, begin=found.begin,
            end=found.end, samples=f"{found.samples:,}", every=every,
        ),
        captions.THRESHOLD.format(threshold=found.threshold, why=found.why),
    ]  # fmt: skip
    for stats in found.probes[:MOST_PROBES]:
        laws = "; ".join(filter(None, map(_law_in_words, stats.kinds)))
        if laws:
            lines.append(f"{stats.probe.name}: {laws}.")
    if found.comparison:
        lines.append(f"{found.comparison.in_words().capitalize()}.")
    return Section("Results", "words", lines=lines)


def _law_in_words(kind: Kind) -> str:
    law = kind.law
    if law is None:
        return ""
    agrees = "agrees with" if law.low <= CELANI <= law.high else "differs from"
    bent = "" if law.is_law else f", but they deviate from a power law (distance {law.distance:.2f})"
    short = "" if law.last / law.first >= 0.95 * DECADE else ", less than a decade"
    return (
        f"{kind.name} last T with p(T) ~ T^-a, a = {law.value:.2f} (95 % interval {law.low:.2f} to {law.high:.2f}) "
        f"from {law.first:.3g} to {law.last:.3g} s{short}, which {agrees} 3/2{bent}"
    )


def _strength(found: Statistics) -> Section:
    """Return the page's section with tables of concentration moments and wind at points."""
    section = Section("Strength and fluctuation of the gas", "strength")
    rows, left_out = [], 0
    room = max(1, MOST_ROWS // max(1, len(found.probes)))
    names = "conditional_mean", "peak99", "peak", "integral_time"
    for stats in found.probes:
        p = stats.points
        reached = np.flatnonzero(p["intermittency"] > 0.0)
        chosen = _spaced(reached if len(reached) else [np.argmax(p["mean"])], room)
        left_out += len(stats.probe.places) - len(chosen)
        for k in chosen if len(rows) < 2 * MOST_ROWS else []:
            place = ",\u00a0".join(f"{v:.3g}" for v in stats.probe.places[k])
            error = f"\u00a0±\u00a0{p['mean_error'][k]:.1g}" if np.isfinite(p["mean_error"][k]) else ""
            strength = (
                f"{p['mean'][k]:.3g}{error}",
                _number(p["intensity"][k]),
                f"{p['intermittency'][k]:.3f}",
            )
            rows.append(
                (f"{stats.probe.name}: {k}", place, *strength, *(_number(p[name][k]) for name in names))
            )
    heads = (
        "point", "at [m]", "mean [ppm]", "rms / mean", "intermittency", "mean in gas [ppm]", "99 % / mean",
        "largest / mean", "integral time [s]",
    )  # fmt: skip
    more = f" {left_out:,} more points are in statistics.parquet." if left_out else ""
    section.table(rows, heads, captions.STRENGTH + more)
    winds = []
    for name, p in ((stats.probe.name, stats.points) for stats in found.probes):
        if "speed" in p and np.isfinite(p["turbulence_intensity"]).any():
            means = [f"{p[f'mean_{u}'].mean():.3g}" for u in "uvw" if f"mean_{u}" in p]
            winds.append((name, *means, _number(np.nanmean(p["turbulence_intensity"]))))
    axes = AXES[: len(winds[0]) - 2] if winds else ""
    heads = ("probe", *(f"wind along {a} [m/s]" for a in axes), "turbulence intensity")
    section.table(winds[:MOST_ROWS], heads, captions.WIND)
    return section


def _spaced(items: Sequence[Any] | np.ndarray, most: int) -> list[Any]:
    """Return the items or, if they are more than `most`, items at equal distances, with the first and the last."""
    count = len(items)
    chosen = np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))
    return [items[k] for k in chosen]


def _maps(found: Statistics) -> Section:
    """Return the page's section with maps of mean, fluctuation and intermittency of films and grids of points."""
    section = Section("Maps", "maps")
    data = found.maps
    if data is not None:
        height = data.attrs.get("height_m")
        at = f" at z = {height:.3g} m" if height is not None else ""
        of_film = {name: data[name].values for name in ("mean", "intensity", "intermittency")}
        png = plots.maps(data.x.values, data.y.values, _titled(of_film))
        section.image(png, f"From the film{at}", captions.MAPS)
    for stats in found.probes[:MOST_PROBES]:
        if stats.probe.kind != "grid":
            continue
        counts = stats.probe.counts
        axes = [d for d, n in enumerate(counts) if n > 1][:2]
        lattice = stats.probe.places.reshape(*counts, -1)
        top = np.unravel_index(int(np.argmax(stats.points["mean"])), counts)
        cut = tuple(slice(None) if d in axes else int(top[d]) for d in range(len(counts)))
        x, y = (
            lattice[cut][(slice(None), 0) if n == 0 else (0, slice(None))][:, d] for n, d in enumerate(axes)
        )
        names = "mean", "intensity", "intermittency"
        values = _titled({name: stats.points[name].reshape(counts)[cut] for name in names})
        png = plots.maps(x, y, values, "".join(AXES[d] for d in axes))
        section.image(png, f"Grid {stats.probe.name}", captions.MAPS)
    return section


def _titled(of: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return maps by title; rms / mean is NaN where the mean is less than HARDLY of the largest mean."""
    mean = of["mean"]
    intensity = np.where(np.nan_to_num(mean) > HARDLY * np.nanmax(mean), of["intensity"], np.nan)
    return {"mean [ppm]": mean, "rms / mean": intensity, "intermittency": of["intermittency"]}


def _spread(shown: list[OfProbe]) -> Section:
    """Return the page's section with concentration profiles and two-point correlations."""
    section = Section("Profiles and lengths", "spread")
    for stats in shown:
        if stats.profiles:
            caption = captions.PROFILES + _gaussian(stats.profiles)
            section.image(plots.profiles(stats.profiles), f"{stats.probe.name}: profiles", caption)
            along = next((a for a in AXES if stats.profiles[0].at.startswith(a)), "")
            wide = plots.widths(stats.profiles, along) if along else None
            if wide:
                section.image(wide, f"{stats.probe.name}: width and centre", captions.WIDTHS)
        if stats.correlations:
            title = f"{stats.probe.name}: correlation"
            section.image(plots.correlations(stats.correlations), title, captions.CORRELATION)
    return section


def _gaussian(several: list[Profile]) -> str:
    fit, *others = [profile.gaussian for profile in several]
    if fit is None or others:
        return captions.NEAREST if any((fit, *others)) else ""
    words = f"Centre {fit.centre:.3g} m, width {fit.width:.3g} m ({fit.share:.0%} of the variance explained)."
    return f"{captions.NEAREST} {words}"


def _whiffs(found: Statistics, shown: list[OfProbe]) -> Section:
    """Return the page's section with durations of whiffs and blanks and their power laws."""
    section = Section("Whiffs and blanks", "whiffs", lines=[captions.WHIFFS])
    rows = []
    step = float(np.mean(found.steps)) if found.steps[1] - found.steps[0] < 1e-3 * found.steps[1] else 0.0
    for stats in shown:
        for kind in stats.kinds:
            every = kind.all
            if not len(every.lasted):
                continue
            lasted = [f"{reduce(every.lasted):.3g}" for reduce in (np.median, np.mean, np.max)]
            law = kind.law
            exponent, within = f"- (fewer than {FEWEST} in a range)", "-"
            if law:
                exponent = f"{law.value:.2f} ({law.low:.2f} to {law.high:.2f})"
                within = f"{law.first:.3g} to {law.last:.3g} s, {law.count:,}"
            number = f"{len(every.lasted):,}", str(every.cut)
            rows.append((f"{stats.probe.name}: {kind.name}", *number, *lasted, exponent, within))
        if all(len(kind.all.lasted) > 1 for kind in stats.kinds):
            section.image(plots.laws(stats, step), f"{stats.probe.name}: durations", captions.LAWS)
    heads = (
        "of", "number", "cut", "median [s]", "mean [s]", "longest [s]", "exponent (95 %)", "range and number",
    )  # fmt: skip
    section.table(rows, heads, captions.RANGE)
    return section


def _sensors(found: Statistics) -> Section:
    """Return the page's section with the share of whiffs that slow and fast gas sensors resolve."""
    section = Section("Whiffs that a sensor keeps", "sensors")
    comparison = found.comparison
    if comparison is None or not comparison.sensors[0].whiffs:
        return section
    section.lines.append(captions.RESOLVED.format(gas=found.gas))
    section.image(plots.sensors(comparison), "Share of whiffs kept", captions.BARS)
    png = plots.records(comparison, found.threshold, found.begin)
    section.image(png, "The air at a point, and the readings of two sensors", captions.RECORDS)
    rows = [
        (k.sensor.name, f"{k.share:.1%}", f"{k.seen:,} of {k.whiffs:,}", f"{k.rises:,}", f"{k.threshold:.3g}")
        for k in comparison.sensors
    ]
    heads = ("sensor", "kept", "whiffs", "rises in all", "threshold of readings [ppm]")
    section.table(rows, heads, captions.RISES)
    return section


def _bouts(found: Statistics) -> Section:
    """Return the page's section with the bouts of a metal oxide, against the distance from the source if known."""
    section = Section("Bouts of a metal oxide", "bouts")
    table = found.bouts
    if table is None:
        return section
    section.lines.append(captions.BOUTS.format(sensor=table.sensor, threshold=table.threshold))
    section.lines.append(f"{table.in_words()}.")
    names = [stats.probe.name for stats in found.probes]
    if np.isfinite(table.distance).all():
        section.image(plots.bouts(table, names), "Bouts and distance", captions.BOUTS_PLOT)
    columns = ("bouts_per_min", "bout_amplitude", "mox_std")
    rows = [
        (f"{stats.probe.name}: {k}", *(_number(stats.points[name][k]) for name in columns))
        for stats in found.probes
        for k in np.flatnonzero(np.isfinite(stats.points["bouts_per_min"]))
    ]
    heads = ("point", "bouts per minute", "mean amplitude [1/s]", "std of ln(R_air/R)")
    section.table(_spaced(rows, MOST_ROWS), heads)
    return section


def _within(shown: list[OfProbe]) -> Section:
    section = Section("Concentrations while there is gas", "within")
    for stats in shown:
        if stats.fits:
            gamma, lognormal = stats.fits
            deviation = f"lognormal: deviation of the logarithm {lognormal.shape:.3g}"
            caption = f"{captions.WITHIN} Gamma: shape {gamma.shape:.3g}; {deviation}."
            section.image(plots.within(stats), stats.probe.name, caption)
    return section


def _time(shown: list[OfProbe]) -> Section:
    section = Section("Spectra of fluctuations", "time")
    if shown and any(stats.density.any() for stats in shown):
        section.image(plots.spectrum(shown), "Spectra", captions.SPECTRUM)
    return section


def _notes(found: Statistics) -> Section:
    return Section("Notes", "notes", lines=[*found.notes, captions.FILES])
