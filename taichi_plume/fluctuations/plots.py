"""Plots of a page of statistics, as PNG files."""

import numpy as np

from taichi_plume.fluctuations import durations
from taichi_plume.fluctuations.analysis import Correlation, OfProbe, Profile
from taichi_plume.fluctuations.bouts import BoutTable
from taichi_plume.fluctuations.records import AXES
from taichi_plume.fluctuations.sensor_comparison import SensorComparison
from taichi_plume.fluctuations.spectra import KOLMOGOROV
from taichi_plume.report import theme
from taichi_plume.report.theme import panels

FIRST, SECOND = theme.robot(0), theme.SOURCE
MOST_CURVES = 6
SHOWN = 60.0  # s, of a record


def laws(stats: OfProbe, step: float) -> bytes:
    """Draw the distribution of durations of whiffs and blanks, with their power laws and T^-3/2."""
    with panels(2, 2, 3.1) as plot:
        for axis, kind, color in zip(plot, stats.kinds, (FIRST, SECOND), strict=True):
            found, law = kind.all.lasted, kind.law
            t, p, _ = durations.density(found, step)
            axis.loglog(t, p, "o", color=color, markersize=4, label=f"{len(found):,} {kind.name}")
            if law is not None:
                inside = ((found > law.first) & (found < law.last)).mean()
                x = np.geomspace(law.first, law.last, 50)
                fitted = law.value, "-", f"$T^{{-{law.value:.2f}}}$, fitted"
                for exponent, line, label in (fitted, (durations.CELANI, "--", "$T^{-3/2}$")):
                    s = 1.0 - exponent
                    mass = np.log(law.last / law.first) if abs(s) < 1e-9 else (law.last**s - law.first**s) / s
                    y = inside * x**-exponent / mass
                    axis.plot(x, y, line, color=theme.INK, linewidth=1.1, label=label)
            axis.set(xlabel="duration T [s]", ylabel="density [1/s]", title=kind.name)
            axis.legend()
    return plot.png


def within(stats: OfProbe) -> bytes:
    """Draw the distribution of concentrations within whiffs, and its fits."""
    with panels() as plot:
        (axis,) = plot
        most = float(np.quantile(stats.within, 0.999))
        bins = np.linspace(0.0, most, 61).tolist()
        heights, *_ = axis.hist(stats.within, bins, density=True, color="#c9d6e2", label="samples")
        c = np.linspace(most / 400, most, 400)
        for fit, line, color in zip(stats.fits, ("-", "--"), (FIRST, SECOND), strict=True):
            name = {"gamma": "gamma", "lognorm": "lognormal"}[fit.kind]
            axis.plot(c, fit.density(c), line, color=color, label=f"{name}, distance {fit.distance:.3f}")
        highest = float(np.max(heights))
        axis.set_ylim(0.0, min(axis.get_ylim()[1], 1.6 * highest) if highest else None)
        axis.set(xlabel="concentration over its mean while there is gas", ylabel="density")
        axis.legend()
    return plot.png


def spectrum(several: list[OfProbe]) -> bytes:
    """Draw power spectral densities, with a line of slope -5/3."""
    with panels(tall=3.2) as plot:
        (axis,) = plot
        for n, stats in enumerate(several[:MOST_CURVES]):
            f, s = (values[stats.density > 0] for values in (stats.frequency, stats.density))
            axis.loglog(f, s, color=theme.robot(n), linewidth=1.0, label=theme.short(stats.probe.name))
        f, s = several[0].frequency, several[0].density
        if len(f) > 4 and s[0] > 0:
            x = np.geomspace(f[len(f) // 20], f[-1], 20)
            line = 2.0 * float(np.interp(x[0], f, s)) * (x / x[0]) ** KOLMOGOROV
            axis.plot(x, line, "--", color=theme.INK, linewidth=1.0, label="$f^{-5/3}$")
            axis.set_ylim(max(float(s.max()) * 1e-9, float(s[s > 0].min()) / 3), None)
        axis.set(xlabel="frequency f [Hz]", ylabel="density [ppm²/Hz]")
        for text in axis.legend().get_texts():
            text.set_parse_math(text.get_text().startswith("$f^"))
    return plot.png


def profiles(several: list[Profile]) -> bytes:
    """Draw mean and rms along a line, or along some rows of a grid, with the Gaussian of the mean."""
    chosen = several
    if len(several) > 4:
        fitted = [curve for curve in several if curve.gaussian is not None] or several
        chosen = [fitted[k] for k in np.unique(np.linspace(0, len(fitted) - 1, 4).round().astype(int))]
    with panels(2, 2, 3.0) as plot:
        for n, curve in enumerate(chosen):
            color, label = theme.robot(n), curve.at or None
            plot[0].plot(curve.place, curve.mean, "o", color=color, markersize=3, label=label)
            if curve.gaussian is not None:
                fine = np.linspace(curve.place.min(), curve.place.max(), 300)
                plot[0].plot(fine, curve.gaussian.at(fine), color=color, linewidth=1.0)
            plot[1].plot(curve.place, curve.rms, "o-", color=color, markersize=3, linewidth=0.8, label=label)
        for axis, title in zip(plot, ("mean [ppm]", "rms of the fluctuation [ppm]"), strict=True):
            axis.set(xlabel=f"{chosen[0].along} [m]", ylim=(0.0, None), title=title)
        if chosen[0].at:
            plot[0].legend()
    return plot.png


def widths(several: list[Profile], along: str) -> bytes | None:
    """Draw width and centre of the mean of each row; None if fewer than three rows have a good fit."""
    fits = [(p, p.gaussian) for p in several if p.gaussian is not None and p.gaussian.share > 0.5]
    if len(fits) < 3:
        return None
    titles = "width [m]", f"centre, {fits[0][0].along} [m]"
    values = [fit.width for _, fit in fits], [fit.centre for _, fit in fits]
    with panels(2, 2, 2.6) as plot:
        for axis, title, y in zip(plot, titles, values, strict=True):
            axis.plot([p.station for p, _ in fits], y, "o-", color=FIRST, markersize=3)
            axis.set(xlabel=f"{along} [m]", title=title)
        plot[0].set_ylim(0.0, None)
    return plot.png


def correlations(several: list[Correlation]) -> bytes:
    """Draw curves of two-point correlation against separation; return a PNG."""
    with panels() as plot:
        (axis,) = plot
        for n, c in enumerate(several):
            label = f"along {c.along}: length {'' if c.whole else 'at least '}{c.length:.3g} m"
            axis.plot(c.separation, c.values, "o-", markersize=3, color=theme.robot(n), label=label)
        axis.axhline(0.0, color=theme.FAINT, linewidth=0.8)
        axis.set(xlabel="separation [m]", ylabel="correlation")
        axis.legend()
    return plot.png


def maps(x: np.ndarray, y: np.ndarray, values: dict[str, np.ndarray], axes_names: str = AXES) -> bytes:
    """Draw maps over a plane, (x, y) each, one above the other or side by side."""
    wide, count = np.ptp(x) >= 1.2 * np.ptp(y), len(values)
    ratio = np.ptp(y) / max(np.ptp(x), 1e-9)
    tall = (min(3.2, 6.0 * ratio) + 0.75) * count if wide else theme.WIDE / count * ratio + 0.9
    with panels(count, 1 if wide else count, float(np.clip(tall, 2.4, 14.0))) as plot:
        for axis, (title, grid) in zip(plot, values.items(), strict=True):
            finite = grid[np.isfinite(grid)]
            top = float(np.quantile(finite, 0.995)) if len(finite) else 1.0
            colors = {"cmap": theme.GAS, "vmin": 0.0, "vmax": top or 1.0}
            axis.grid(False)
            image = axis.pcolormesh(x, y, grid.T, shading="nearest", **colors)
            axis.set(
                aspect="equal", xlabel=f"{axes_names[0]} [m]", ylabel=f"{axes_names[1]} [m]", title=title
            )
            plot.figure.colorbar(image, ax=axis, fraction=0.04, pad=0.02, extend="max")
    return plot.png


def records(comparison: SensorComparison, threshold: float, begin: float) -> bytes:
    """Draw the concentration at a point, and the readings of the slow and the fast sensor, in ppm of this gas."""
    n = min(len(comparison.true), max(2, round(SHOWN / comparison.step)))
    first = _liveliest(comparison.true > threshold, n)
    t = begin + comparison.step * np.arange(first, first + n)
    shown = [("in the air", comparison.true, theme.INK)]
    for k, color in ((1, FIRST), (0, SECOND)):
        sensor = comparison.sensors[k]
        scale = threshold / sensor.threshold if sensor.threshold > 0 else 1.0
        shown.append((sensor.sensor.name, comparison.readings[k] * scale, color))
    with panels(3, 1, 4.2, sharex=True) as plot:
        for axis, (title, values, color) in zip(plot, shown, strict=True):
            axis.plot(t, values[first : first + n], color=color, linewidth=0.8)
            axis.axhline(threshold, color=theme.FAINT, linewidth=0.8, linestyle="--")
            axis.set(ylabel="ppm", ylim=(0.0, None), title=title)
        plot[-1].set_xlabel("time [s]")
    return plot.png


def _liveliest(present: np.ndarray, n: int) -> int:
    """Return the start of the window of n samples in which gas comes and goes most often; present: bool (samples,)."""
    changes = np.concatenate([[0], np.cumsum(present[1:] != present[:-1])])
    if len(present) <= n:
        return 0
    return int(np.argmax(changes[n - 1 :] - changes[: len(changes) - n + 1]))


def bouts(table: BoutTable, names: list[str]) -> bytes:
    """Draw the number of bouts and the standard deviation of the signal against the distance from the source.

    names: of the probes.
    """
    titles = {"bouts per minute": table.per_min, "std of ln(R_air/R)": table.deviation}
    with panels(2, 2, math=False) as plot:
        for axis, (title, values) in zip(plot, titles.items(), strict=True):
            for n in np.unique(table.probe)[:MOST_CURVES]:
                x, y = (of[table.probe == n] for of in (table.distance, values))
                axis.plot(x, y, "o", color=theme.robot(n), markersize=3, label=theme.short(names[n]))
            axis.set(xlabel="distance from the source [m]", ylim=(0.0, None), title=title)
        plot[0].legend()
    return plot.png


def sensors(comparison: SensorComparison) -> bytes:
    """Draw the fraction of whiffs that each sensor keeps."""
    shares = [100 * sensor.share for sensor in comparison.sensors]
    names = [theme.short(sensor.sensor.name, 70) for sensor in comparison.sensors]
    with panels(tall=0.34 * len(shares) + 0.9, math=False) as plot:
        (axis,) = plot
        y = np.arange(len(shares))[::-1]
        axis.barh(y, shares, color=[SECOND, FIRST, *[theme.FAINT] * (len(y) - 2)])
        axis.set_yticks(y, names)
        for place, share in zip(y, shares, strict=True):
            axis.text(share + 1, place, f"{share:.0f}%", va="center", fontsize=8)
        axis.set(xlim=(0, 112), xlabel="whiffs kept [%]")
    return plot.png
